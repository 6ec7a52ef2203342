"""The virtual environment `.venv` with the pinned packages: the lock with its hashes, torch, and busybot itself."""

from __future__ import annotations

import hashlib
import json
import platform
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from provision.steps import Log, SetupError, clean_environment, say

STAMP = "busybot-setup.json"
CONSTRAINTS = "requirements/constraints.txt"
REGISTRY_HINT = (
    "Check that the package registry can be reached (`python3 -m pip download six`), then run `make setup` again."
)
PIP_INSTALL = ("install", "--disable-pip-version-check", "--progress-bar", "off", "--no-compile")
"""Compiled is what is imported, when it is."""
EXACTLY = ("--no-deps", "--require-hashes", "--only-binary", ":all:")
IMPATIENT = {"UV_HTTP_RETRIES": "1"}
"""Another way stands behind it."""
READ_TORCH = (
    "import importlib.metadata as m, json\n"
    "print(json.dumps({d.metadata['Name']: d.version for d in m.distributions()}))\n"
)


@dataclass(frozen=True)
class Environment:
    """Where the virtual environment is and what it is made from."""

    root: Path
    gpu: bool

    @property
    def folder(self) -> Path:
        return self.root / ".venv"

    @property
    def python(self) -> Path:
        return self.folder / "bin" / "python"

    @property
    def lock(self) -> Path:
        return self.root / "requirements" / "lock.txt"

    def key(self) -> str:
        """Changes when anything changes that the installed packages depend on."""
        files = (self.lock, self.root / CONSTRAINTS, self.root / "pyproject.toml", Path(__file__))
        parts = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
        parts += [sys.version, str(Path(sys.executable).resolve()), str(self.root), f"gpu={self.gpu}"]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def ready(self) -> bool:
        """Whether an earlier set-up with the same key came to its end."""
        try:
            stamp = json.loads((self.folder / STAMP).read_text(encoding="utf-8"))
            return bool(stamp["key"] == self.key()) and self.python.exists()
        except (OSError, ValueError, KeyError, TypeError):
            return False


def has_nvidia_gpu() -> bool:
    """Whether an NVIDIA GPU is here, by its device file or by the driver's own tool."""
    if Path("/dev/nvidia0").exists():
        return True
    tool = shutil.which("nvidia-smi")
    if tool is None:
        return False
    try:
        listed = subprocess.run([tool, "-L"], capture_output=True, text=True, timeout=30)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return listed.returncode == 0 and "GPU" in listed.stdout


def torch_pin(constraints: str) -> str:
    """The exact version of torch that `CONSTRAINTS` names."""
    found = re.search(r"^torch==([0-9]\S*)$", constraints, re.MULTILINE)
    if found is None:
        raise SetupError(f"{CONSTRAINTS} does not pin torch with ==", "Restore the line `torch==VERSION` there.")
    return found[1]


def torch_commands(python: str, version: str, gpu: bool, machine: str) -> list[tuple[str, list[str]]]:
    """Ways to install torch, each with a word about it; the first that works is taken.

    Everything that a CPU build depends on is in the lock, so it comes alone. A build with CUDA brings its own packages.
    """
    pip = [python, "-m", "pip", *PIP_INSTALL]
    with_cuda = [*pip, f"torch=={version}"]
    if gpu:
        return [("with CUDA", with_cuda)]
    if machine != "x86_64":
        return [("for this machine", with_cuda)]
    uv = [python, "-m", "uv", "pip", "install", "--python", python, "--no-deps", "--torch-backend", "cpu"]
    return [
        ("CPU build", [*pip, "--no-deps", f"torch=={version}+cpu"]),
        ("CPU build", [*uv, f"torch=={version}"]),
        ("the build with CUDA, SEVERAL GIGABYTES, because no CPU build can be reached", with_cuda),
    ]


def installed(python: Path) -> dict[str, str]:
    """Names (lower case) and versions of all packages in the environment."""
    done = subprocess.run([python, "-I", "-c", READ_TORCH], capture_output=True, text=True, env=clean_environment())
    return {name.lower(): version for name, version in json.loads(done.stdout or "{}").items()}


def create(environment: Environment, log: Log) -> None:
    """Make `.venv`, or keep the one that is there when it belongs to this Python and this place."""
    folder = environment.folder
    if folder.exists():
        if not (folder / "pyvenv.cfg").is_file():
            raise SetupError(
                f"{folder} is in the way: it is no virtual environment", f"Move it away: mv {folder} {folder}.old"
            )
        if _usable(environment):
            return
        shutil.rmtree(folder) if not folder.is_symlink() else folder.unlink()
    say(f"creating .venv with Python {platform.python_version()}")
    log.must(
        [sys.executable, "-m", "venv", str(folder)],
        "the virtual environment could not be made",
        f"Try `{sys.executable} -m venv .venv` by hand; Debian and Ubuntu have its parts in python3-venv.",
    )


def _usable(environment: Environment) -> bool:
    """Whether the environment runs, has pip, is of this Python version and was made at this place."""
    code = "import sys, pip; print(sys.version); print(sys.prefix)"
    try:
        done = subprocess.run([environment.python, "-I", "-c", code], capture_output=True, text=True)
    except OSError:
        return False
    script = environment.folder / "bin" / "pip"
    at_home = script.is_file() and str(environment.folder) in script.read_text(encoding="utf-8", errors="replace")[:500]
    return done.returncode == 0 and done.stdout.strip() == f"{sys.version}\n{environment.folder}" and at_home


def locked(lock: str, name: str) -> str:
    """The lines of a lock about one package, with its version and hashes; none if it is not there."""
    found = re.search(rf"^{re.escape(name)}==(?:.*\\\n)*.*\n", lock, re.MULTILINE)
    return found[0] if found else ""


def install_locked(python: Path, lock: Path, failed: str, log: Log) -> None:
    """Install a lock's packages into the environment of `python`, which has pip.

    uv does it in a fraction of pip's processor time. Where it cannot, pip does: it alone reads its own configuration,
    which may name the only registry that can be reached.
    """
    words = [*EXACTLY, "-r", str(lock)]
    uv = [str(python), "-m", "uv", "pip", "install", "--python", str(python)]
    if not log.run([*uv, *words], extra=IMPATIENT):
        log.must([str(python), "-m", "pip", *PIP_INSTALL, *words], failed, REGISTRY_HINT)


def install(environment: Environment, log: Log) -> None:
    """Install everything that is not yet there, and write the stamp at the end."""
    pip = [str(environment.python), "-m", "pip", *PIP_INSTALL]
    say(f"installing the pinned packages, about a minute (details in {log.path})")
    uv = environment.folder / "uv.txt"
    uv.write_text(locked(environment.lock.read_text(encoding="utf-8"), "uv"), encoding="utf-8")
    log.run([*pip, *EXACTLY, "-r", str(uv)])
    install_locked(environment.python, environment.lock, "the pinned packages could not be installed", log)
    install_torch(environment, log)
    log.must(
        [*pip, "--no-deps", "--no-build-isolation", "-e", str(environment.root)],
        "busybot itself could not be installed",
        "The log says why; `git status` shows whether pyproject.toml was changed.",
    )
    stamp = {"key": environment.key(), "python": platform.python_version()}
    (environment.folder / STAMP).write_text(json.dumps(stamp) + "\n", encoding="utf-8")


def install_torch(environment: Environment, log: Log) -> None:
    """Install the pinned torch: with CUDA where a GPU is, else a CPU build where one can be had."""
    version = torch_pin((environment.root / CONSTRAINTS).read_text(encoding="utf-8"))
    here = installed(environment.python)
    have = here.get("torch", "")
    if have.split("+")[0] == version and (not environment.gpu or not have.endswith("+cpu")):
        return
    for word, command in torch_commands(str(environment.python), version, environment.gpu, platform.machine()):
        say(f"installing torch {version} ({word})")
        if log.run(command, extra=IMPATIENT):
            return
    raise SetupError(
        f"torch {version} could not be installed; the last lines of {log.path}:\n{log.tail()}", REGISTRY_HINT
    )
