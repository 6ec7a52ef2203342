"""Pins, the lock, the choice of torch, and when an environment is used again."""

import re
import shutil
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.version import Version

from provision import packages
from provision.steps import Log, SetupError

ROOT = Path(__file__).resolve().parents[2]
LOCK = (ROOT / "requirements" / "lock.txt").read_text()
TOML = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT, CONSTRAINTS = TOML["project"], (ROOT / packages.CONSTRAINTS).read_text()
GPU_PACKAGES = ("nvidia-", "cuda-", "triton")


def pins(lines: list[str]) -> dict[str, str]:
    found = [re.match(r"([A-Za-z0-9._-]+)==([^\s;\\]+)", line) for line in lines]
    return {match[1].lower(): match[2] for match in found if match is not None}


OPTIONAL = PROJECT["optional-dependencies"]
SETUP = [*PROJECT["dependencies"], *OPTIONAL["sim"], *OPTIONAL["learn"], *OPTIONAL["view"]]
"""What the set-up installs, but for what only developers need."""


def test_users_are_given_ranges_and_developers_pins() -> None:
    for line in SETUP:
        assert re.fullmatch(r"[a-z0-9-]+>=\d[\d.]*", line), line
    for line in [*OPTIONAL["dev"], *OPTIONAL["cluster"]]:
        assert re.fullmatch(r"[a-z0-9-]+==\d[\d.]*", line), line
    assert OPTIONAL["all"] == ["busybot[sim,learn,view]"]


def test_the_lock_agrees_with_pyproject() -> None:
    locked = pins(LOCK.splitlines())
    developers = pins(OPTIONAL["dev"])
    assert {name: locked.get(name) for name in developers} == developers
    for name, least in (line.split(">=") for line in SETUP if not line.startswith("torch>")):  # whose build is chosen
        assert Version(locked[name]) >= Version(least), name


def test_whatever_is_installed_for_users_is_imported_by_the_package() -> None:
    """But for pandas: what dataset cards tell readers to open the tables with."""
    modules = {
        "foxglove-sdk": "foxglove",
        "opencv-python": "cv2",
        "pillow": "PIL",
        "protobuf": "google.protobuf",
        "pyyaml": "yaml",
        "rerun-sdk": "rerun",
    }
    text = "\n".join(path.read_text() for path in (ROOT / "busybot").rglob("*.py"))
    named = {name: modules.get(name, name.replace("-", "_")) for name in (line.split(">=")[0] for line in SETUP)}
    idle = {name for name, module in named.items() if not re.search(rf"^ *(from|import) {module}\b", text, re.M)}
    assert idle == set() and "import pandas as pd" in text and "trimesh" not in named


def test_the_lock_has_hashes_and_no_place() -> None:
    requirements = re.findall(
        r"^[a-z0-9][^\n]*==[^\n]*\n(?:    --hash=sha256:[0-9a-f]{64}(?: \\)?\n)+", LOCK, re.MULTILINE
    )
    assert len(requirements) == len(pins(LOCK.splitlines())) + duplicates()
    assert "://" not in LOCK and "--index" not in LOCK and "--find-links" not in LOCK
    assert not re.search(r"(?<![A-Za-z0-9])/[a-z]+/", LOCK), "a path"


def test_the_locks_part_about_a_package_has_its_hashes_and_nothing_else() -> None:
    part = packages.locked(LOCK, "uv")
    assert list(pins(part.splitlines())) == ["uv"] and part.count("--hash=sha256:") > 1
    assert all(line.startswith(("uv==", "    --hash=")) for line in part.splitlines())
    assert packages.locked(LOCK, "no-such-package") == ""


def duplicates() -> int:
    """Packages that the lock has in two versions, for older and for newer Python."""
    names = re.findall(r"^([a-z0-9][a-z0-9._-]*)==", LOCK, re.MULTILINE)
    return len(names) - len(set(names))


def test_the_lock_forces_neither_torch_nor_cuda() -> None:
    names = pins(LOCK.splitlines())
    assert "torch" not in names
    assert not [name for name in names if name.startswith(GPU_PACKAGES)]


def test_the_lock_has_what_a_cpu_build_of_torch_imports() -> None:
    assert {"filelock", "typing-extensions", "setuptools", "sympy", "networkx", "jinja2", "fsspec"} <= set(
        pins(LOCK.splitlines())
    )


def test_without_a_gpu_cpu_builds_come_first() -> None:
    ways = packages.torch_commands("python", "2.13.0", gpu=False, machine="x86_64")
    assert [command[-1] for _, command in ways] == ["torch==2.13.0+cpu", "torch==2.13.0", "torch==2.13.0"]
    assert "--no-deps" in ways[0][1] and "--no-deps" in ways[1][1], "nothing for CUDA comes along"
    assert ways[1][1][-3:-1] == ["--torch-backend", "cpu"]
    assert "GIGABYTES" in ways[2][0]


def test_with_a_gpu_the_plain_build_is_taken() -> None:
    ways = packages.torch_commands("python", "2.13.0", gpu=True, machine="x86_64")
    assert [command[-1] for _, command in ways] == ["torch==2.13.0"]
    assert "--no-deps" not in ways[0][1]


def test_torch_is_taken_from_the_pins() -> None:
    assert packages.torch_pin(CONSTRAINTS) == pins(CONSTRAINTS.splitlines())["torch"]
    with pytest.raises(SetupError, match="pin torch"):
        packages.torch_pin("dependencies = []")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    shutil.copytree(ROOT / "requirements", tmp_path / "requirements")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def stamped(root: Path, gpu: bool = False) -> packages.Environment:
    environment = packages.Environment(root, gpu)
    environment.python.parent.mkdir(parents=True)
    environment.python.symlink_to(sys.executable)
    (environment.folder / packages.STAMP).write_text(f'{{"key": "{environment.key()}"}}')
    return environment


def test_a_finished_environment_is_used_again(project: Path) -> None:
    assert stamped(project).ready()


@pytest.mark.parametrize("file", ["pyproject.toml", "requirements/lock.txt", packages.CONSTRAINTS])
def test_changed_pins_are_installed(project: Path, file: str) -> None:
    environment = stamped(project)
    (project / file).write_text((project / file).read_text() + "\n# changed\n")
    assert not environment.ready()


def test_a_gpu_that_appears_is_noticed(project: Path) -> None:
    stamped(project)
    assert not packages.Environment(project, gpu=True).ready()


@pytest.mark.parametrize("stamp", ["", "{}", "[]", "null", '{"key": 1}'])
def test_a_broken_stamp_means_not_ready(project: Path, stamp: str) -> None:
    environment = stamped(project)
    (environment.folder / packages.STAMP).write_text(stamp)
    assert not environment.ready()


def test_a_folder_that_is_no_environment_is_left_alone(project: Path) -> None:
    (project / ".venv").mkdir()
    (project / ".venv" / "thesis.tex").write_text("mine")
    with pytest.raises(SetupError, match="in the way"):
        packages.create(packages.Environment(project, False), Log(project / "log"))
    assert (project / ".venv" / "thesis.tex").read_text() == "mine"


def test_a_failing_step_names_the_log_and_shows_its_end(tmp_path: Path) -> None:
    log = Log(tmp_path / "log")
    with pytest.raises(SetupError) as caught:
        log.must([sys.executable, "-c", "print('disk is full'); raise SystemExit(3)"], "it broke", "buy a disk")
    assert (
        "it broke" in caught.value.what and "disk is full" in caught.value.what and str(log.path) in caught.value.what
    )
    assert caught.value.hint == "buy a disk"
