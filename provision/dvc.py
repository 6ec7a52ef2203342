"""`python3 -m provision.dvc`: DVC in an environment of its own, `.tools/dvc`, where `make reproduce` and
`busybot dataset push` find it. Its packages would fight ours, so it is a tool beside the project, not an import.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
from pathlib import Path

from provision.packages import REGISTRY_MEND
from provision.steps import Log, SetupError, say

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / ".tools" / "dvc"
LOCK = ROOT / "requirements" / "dvc.txt"
STAMP = FOLDER / "lock.sha256"


def main() -> int:
    """Install DVC if it is not there yet; the exit code."""
    wanted = hashlib.sha256(LOCK.read_bytes() + sys.version.encode()).hexdigest()
    if STAMP.is_file() and STAMP.read_text(encoding="utf-8") == wanted and (FOLDER / "bin" / "dvc").exists():
        return 0
    say("installing DVC beside the project, in .tools/dvc")
    try:
        _install(Log(ROOT / ".setup.log"))
    except SetupError as error:
        say(f"error: {error.what}")
        print(error.mend, file=sys.stderr)
        return 1
    STAMP.write_text(wanted, encoding="utf-8")
    return 0


def _install(log: Log) -> None:
    shutil.rmtree(FOLDER, ignore_errors=True)
    uv = [str(ROOT / ".venv" / "bin" / "python"), "-m", "uv"]
    made = "the environment for DVC could not be made"
    log.must([*uv, "venv", "--quiet", "--python", sys.executable, str(FOLDER)], made, "Run `make setup` first.")
    packages = ["pip", "install", "--python", str(FOLDER / "bin" / "python"), "--require-hashes", "-r", str(LOCK)]
    log.must([*uv, *packages], "DVC could not be installed", REGISTRY_MEND)


if __name__ == "__main__":
    sys.exit(main())
