# The two commands of a newcomer: `make demo` and `make test`. Both set everything up first (see provision/).
PYTHON ?= python3
BIN := .venv/bin
PYTEST_ARGS ?=
WORKERS ?= auto
PYTEST := $(BIN)/python -m pytest -n $(WORKERS) --maxprocesses 4 --dist worksteal
PROFILE ?= smoke

# Packages are compiled when they are first imported. Where Python may not keep that (images for containers often forbid
# it), each of the thousand processes of the tests would compile PyTorch anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup demo test test-all lint reproduce dvc site extras lock check-resolve check-exports check-lerobot \
	check-loader check-install clean

help:
	@echo "make demo           set up and run the demo: boards, recordings, relations, a report and pictures"
	@echo "make test           set up and run the fast tests, in as many processes as there are processors, 4 at most"
	@echo "                    (WORKERS=N: in N; WORKERS=0: in one, as a debugger needs it)"
	@echo "make test-all       the linter, the type checker and all tests, the site, exports and examples in others' tools"
	@echo "make lint           the linter, the type checker, and is the documentation what is generated?"
	@echo "make site           the documentation as a site in build/site, with an API reference"
	@echo "make reproduce      run the whole pipeline, PROFILE=smoke by default; what is up to date is not run again"
	@echo "                    (ASSETS=DIR names the objects of the profiles laptop and paper)"
	@echo "make setup          only set up: .venv, pinned packages, a Vulkan driver"
	@echo "make extras         install the optional packages: Ray, causal-learn, h5py, Stable-Baselines3, s3fs"
	@echo "make lock           write the locks in requirements/ anew from pyproject.toml (needs the registry)"
	@echo "                    (UPGRADE=--upgrade: in newer versions)"
	@echo "make check-exports  open exports of the tiny dataset in the real tools, installed beside the project (1.4 GB)"
	@echo "make check-lerobot  open one in the newest LeRobot, in a Debian 13 below .tools (needs root, mmdebstrap; 2 GB)"
	@echo "make check-loader   run the example of Rerun's loader for PyTorch, with its packages beside the project (0.3 GB)"
	@echo "make check-install  install the reading side alone, with the lowest versions, and use it (needs the registry)"
	@echo "make check-resolve  do the pins resolve for every supported Python? (needs the registry)"

setup:
	@$(PYTHON) -m provision

demo: setup
	@$(BIN)/busybot demo

test: setup
	@$(PYTEST) -m "not long" $(PYTEST_ARGS)

# What comes before the tests keeps one processor busy each, so two of them run at a time; each says what it has to say
# when it is done, where make can do that (since 4.0).
test-all: setup extras dvc
	@$(MAKE) --no-print-directory -j 2 $(if $(filter output-sync,$(.FEATURES)),--output-sync=target) ONLY=lowest \
		check-install lint check-exports site check-loader
	@$(PYTEST) --require-extras $(PYTEST_ARGS)

lint: setup
	@$(BIN)/ruff check .
	@$(BIN)/mypy
	@$(BIN)/python -m tools.docs --check

dvc: setup
	@$(PYTHON) -m provision.extras dvc

# Whatever MkDocs warns of, a dead link first of all, is an error.
site: setup
	@$(PYTHON) -m provision.extras site
	@NO_MKDOCS_2_WARNING=1 .tools/site/bin/mkdocs build --quiet --strict
	@echo "the documentation is build/site/index.html"

extras: setup
	@$(PYTHON) -m provision.extras packages

# The chosen profile's values become params.yaml; DVC runs what changed and goes on where it was interrupted.
reproduce: dvc
	@$(BIN)/python -m pipelines.profile $(PROFILE) $(if $(ASSETS),--assets "$(ASSETS)")
	@PATH="$(CURDIR)/$(BIN):$$PATH" .tools/dvc/bin/dvc repro
	@.tools/dvc/bin/dvc metrics show --precision 3
	@.tools/dvc/bin/dvc status

UV_COMPILE := $(BIN)/uv pip compile --quiet --no-emit-index-url --no-annotate -c requirements/constraints.txt
TORCHLESS := --excludes requirements/without-cuda.txt --no-emit-package torch
ROBOTLESS := --excludes requirements/without-robots.txt --custom-compile-command "make lock"
EXTRAS := --extra cluster --extra causal --extra import --extra baselines --extra s3 --extra s3-server

# The lock of the optional packages lists what they need beside the base, and takes the base as it is locked; what the
# base needs under PyPy alone is not there.
lock: setup
	@$(UV_COMPILE) --universal --python-version 3.11 --generate-hashes $(UPGRADE) $(TORCHLESS) \
		--custom-compile-command "make lock" --extra all --extra dev -o requirements/lock.txt pyproject.toml
	@$(UV_COMPILE) --universal --python-version 3.11 --generate-hashes $(UPGRADE) $(TORCHLESS) \
		$$(sed -n '/pypy/d; s/^\([a-z0-9._-]*\).*==.*/--no-emit-package \1/p' requirements/lock.txt) \
		-c requirements/lock.txt --custom-compile-command "make lock" $(EXTRAS) -o requirements/extras.txt pyproject.toml
	@echo "dvc[s3]" | $(UV_COMPILE) --universal --python-version 3.11 --generate-hashes $(UPGRADE) \
		--custom-compile-command "make lock" -o requirements/dvc.txt -
	@printf '%s\n' datasets duckdb polars pandas pyarrow mlcroissant pillow lerobot-doctor | $(UV_COMPILE) --universal \
		--python-version 3.11 --generate-hashes $(UPGRADE) --custom-compile-command "make lock" -o requirements/tables.txt -
	@echo "lerobot==0.4.*" | $(UV_COMPILE) --universal --python-version 3.11 --generate-hashes $(UPGRADE) $(ROBOTLESS) \
		-o requirements/lerobot.txt -
	@echo "lerobot[dataset]" | $(UV_COMPILE) --python-version 3.13 --python-platform x86_64-manylinux_2_36 \
		--generate-hashes $(UPGRADE) $(ROBOTLESS) --no-emit-package torchvision -o requirements/lerobot-debian.txt -
	@printf '%s\n' "datafusion==54.0.0" "torchvision==0.28.*" "av==17.*" | $(UV_COMPILE) --universal --no-deps \
		--python-version 3.11 --generate-hashes $(UPGRADE) --custom-compile-command "make lock" -o requirements/loader.txt -
	@printf '%s\n' "mkdocs==1.*" mkdocs-material "mkdocstrings[python]" ruff | $(UV_COMPILE) --universal --python-version 3.11 \
		--generate-hashes $(UPGRADE) --custom-compile-command "make lock" -o requirements/site.txt -

# Built packages only, for the platform that the set-up knows; with and without CUDA, and the extras.
check-resolve: setup
	@for version in 3.11 3.12 3.13; do \
		for input in requirements/lock.txt "pyproject.toml --extra all --extra dev $(EXTRAS)"; do \
			$(UV_COMPILE) --no-header --only-binary :all: --python-version $$version \
				--python-platform x86_64-manylinux_2_36 $$input > .resolved.txt || exit 1; \
			echo "Python $$version: $$input: $$(wc -l < .resolved.txt) packages resolve"; \
		done; \
	done; rm -f .resolved.txt

check-exports: setup
	@$(PYTHON) -m provision.extras tables lerobot
	@$(BIN)/python tools/check_exports.py --tools .tools --only tables lerobot

check-loader: setup
	@$(PYTHON) -m provision.extras loader
	@$(BIN)/python tools/check_loader.py --tools .tools

check-lerobot: setup
	@tools/debian_root.sh .tools/debian
	@$(BIN)/python tools/check_exports.py --tools .tools --only debian

# Does an install without simulator and torch read recordings, with the lowest versions, and beside others' packages?
# (ONLY=lowest: the first of the environments alone, as all tests do.)
check-install: setup
	@$(BIN)/python tools/check_install.py --environments .tools/install $(if $(ONLY),--only $(ONLY))

clean:
	rm -rf .venv build *.egg-info .setup.log .pytest_cache .mypy_cache .ruff_cache
