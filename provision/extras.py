"""`python3 -m provision.extras dvc|site|tables|lerobot|loader|packages`: what only some need, after the set-up.

- `dvc`: DVC in an environment of its own, `.tools/dvc`, where `make reproduce` and `busybot dataset push` find it. Its
  packages would fight ours, so it is a tool beside the project, not an import.
- `site`: MkDocs, which makes the documentation a site, in `.tools/site`.
- `tables` and `lerobot`: the packages that `make check-exports` opens exports with, in folders of `.tools`, too.
- `loader`: what Rerun's loader for PyTorch needs beside the project's packages, for `make check-loader`.
- `packages`: the optional packages of pyproject.toml (`cluster`, `causal`, `import`, `baselines`, `s3`) in `.venv`.
  Their lock lists only what the base does not have and is installed alone, so that no pinned package of the base
  changes.

What is there already is left alone.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from provision.packages import REGISTRY_HINT, STAMP, install_locked
from provision.steps import Log, SetupError, alone_in, say

ROOT = Path(__file__).resolve().parents[1]
BASE = ROOT / ".venv"
TOOLS = {
    "dvc": ("DVC", "dvc"),
    "site": ("MkDocs", "mkdocs"),
    "tables": ("readers of exported tables", "datasets-cli"),
    "lerobot": ("LeRobot", "lerobot-info"),
    "loader": ("Rerun's loader", "python"),
}
"""Name and program of each tool; its folder is `.tools/KEY`, its lock `requirements/KEY.txt`."""
PACKAGES_LOCK = ROOT / "requirements" / "extras.txt"
SETUP_FIRST = "Run `make setup` first."


def main() -> int:
    """Install what the command line names; the exit code."""
    ways: dict[str, Callable[[], None]] = {tool: partial(install_tool, tool) for tool in TOOLS}
    ways["packages"] = install_packages
    unknown = set(sys.argv[1:]) - set(ways)
    if unknown or not sys.argv[1:]:
        print(f"usage: python3 -m provision.extras {'|'.join(ways)}", file=sys.stderr)
        return 2
    try:
        with alone_in(ROOT):
            for name in sys.argv[1:]:
                ways[name]()
    except SetupError as error:
        say(f"error: {error.what}")
        print(error.hint, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        say("interrupted; the same command goes on from here")
        return 130
    return 0


def install_tool(tool: str) -> None:
    """A tool's own environment, made anew when its lock or Python changed."""
    (name, program), folder = TOOLS[tool], ROOT / ".tools" / tool
    lock = ROOT / "requirements" / f"{tool}.txt"
    key, stamp = _key(lock.read_bytes()), folder / "lock.sha256"
    if _is(stamp, key) and (folder / "bin" / program).exists():
        return
    say(f"installing {name} beside the project, in .tools/{tool}")
    log = Log(ROOT / ".setup.log")
    shutil.rmtree(folder, ignore_errors=True)
    uv = [str(BASE / "bin" / "python"), "-m", "uv"]
    made = f"the environment for {name} could not be made"
    log.must([*uv, "venv", "--quiet", "--python", sys.executable, str(folder)], made, SETUP_FIRST)
    packages = ["pip", "install", "--python", str(folder / "bin" / "python"), "--no-deps", "--require-hashes"]
    log.must([*uv, *packages, "-r", str(lock)], f"{name} could not be installed", REGISTRY_HINT)
    stamp.write_text(key, encoding="utf-8")


def install_packages() -> None:
    """The optional packages into `.venv`, again after the base was installed anew."""
    try:
        base = (BASE / STAMP).read_bytes()
    except OSError as error:
        raise SetupError(f"{BASE} is not set up: {error.strerror}", SETUP_FIRST) from None
    key, stamp = _key(PACKAGES_LOCK.read_bytes() + base), BASE / "busybot-extras.sha256"
    if _is(stamp, key):
        return
    say("installing the optional packages (Ray, causal-learn, h5py, Stable-Baselines3, s3fs)")
    failed = "the optional packages could not be installed"
    install_locked(BASE / "bin" / "python", PACKAGES_LOCK, failed, Log(ROOT / ".setup.log"))
    stamp.write_text(key, encoding="utf-8")


def _key(what: bytes) -> str:
    return hashlib.sha256(what + sys.version.encode()).hexdigest()


def _is(stamp: Path, key: str) -> bool:
    return stamp.is_file() and stamp.read_text(encoding="utf-8") == key


if __name__ == "__main__":
    sys.exit(main())
