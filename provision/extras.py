"""`python3 -m provision.extras dvc|packages`: what only some people need, after the set-up of `python3 -m provision`.

- `dvc`: DVC in an environment of its own, `.tools/dvc`, where `make reproduce` and `busybot dataset push` find it. Its
  packages would fight ours, so it is a tool beside the project, not an import.
- `packages`: the optional packages of pyproject.toml (`cluster`, `causal`, `baselines`) in `.venv`. Their lock lists
  only what the base does not have and is installed alone, so that no pinned package of the base changes.

What is there already is left alone.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
from pathlib import Path

from provision.packages import REGISTRY_HINT, STAMP
from provision.steps import Log, SetupError, say

ROOT = Path(__file__).resolve().parents[1]
BASE = ROOT / ".venv"
DVC_FOLDER = ROOT / ".tools" / "dvc"
DVC_LOCK = ROOT / "requirements" / "dvc.txt"
PACKAGES_LOCK = ROOT / "requirements" / "extras.txt"
SETUP_FIRST = "Run `make setup` first."


def main() -> int:
    """Install what the command line names; the exit code."""
    ways = {"dvc": install_dvc, "packages": install_packages}
    unknown = set(sys.argv[1:]) - set(ways)
    if unknown or not sys.argv[1:]:
        print(f"usage: python3 -m provision.extras {'|'.join(ways)}", file=sys.stderr)
        return 2
    try:
        for name in sys.argv[1:]:
            ways[name]()
    except SetupError as error:
        say(f"error: {error.what}")
        print(error.hint, file=sys.stderr)
        return 1
    return 0


def install_dvc() -> None:
    """DVC's own environment, made anew when its lock or Python changed."""
    key, stamp = _key(DVC_LOCK.read_bytes()), DVC_FOLDER / "lock.sha256"
    if _is(stamp, key) and (DVC_FOLDER / "bin" / "dvc").exists():
        return
    say("installing DVC beside the project, in .tools/dvc")
    log = Log(ROOT / ".setup.log")
    shutil.rmtree(DVC_FOLDER, ignore_errors=True)
    uv = [str(BASE / "bin" / "python"), "-m", "uv"]
    made = "the environment for DVC could not be made"
    log.must([*uv, "venv", "--quiet", "--python", sys.executable, str(DVC_FOLDER)], made, SETUP_FIRST)
    packages = ["pip", "install", "--python", str(DVC_FOLDER / "bin" / "python"), "--require-hashes"]
    log.must([*uv, *packages, "-r", str(DVC_LOCK)], "DVC could not be installed", REGISTRY_HINT)
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
    say("installing the optional packages (Ray, causal-learn, Stable-Baselines3)")
    pip = [str(BASE / "bin" / "python"), "-m", "pip", "install", "--disable-pip-version-check", "--progress-bar", "off"]
    exact = ["--no-deps", "--require-hashes", "--only-binary", ":all:", "-r", str(PACKAGES_LOCK)]
    Log(ROOT / ".setup.log").must([*pip, *exact], "the optional packages could not be installed", REGISTRY_HINT)
    stamp.write_text(key, encoding="utf-8")


def _key(what: bytes) -> str:
    return hashlib.sha256(what + sys.version.encode()).hexdigest()


def _is(stamp: Path, key: str) -> bool:
    return stamp.is_file() and stamp.read_text(encoding="utf-8") == key


if __name__ == "__main__":
    sys.exit(main())
