"""Run a stage of dvc.yaml so that it goes on where it was interrupted.

    python -m pipelines.stage OUT... [--input PATH...] -- BUSYBOT-ARGUMENTS [-- BUSYBOT-ARGUMENTS ...]

busybot's commands continue in the folders that they began. So what a stage left behind is kept (`persist: true`) as
long as it comes from the same commands, inputs and code; otherwise it is removed first.
"""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from busybot.files import write_json

ROOT = Path(__file__).resolve().parents[1]
CODE = ROOT / "busybot"
STATE = ".stages"


def digest(path: Path) -> str:
    """Of a file, or of all files of a folder with their names; caches of the interpreter are no part of it."""
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    total = hashlib.sha256()
    for file in files:
        if "__pycache__" not in file.parts:
            total.update(f"{file.relative_to(path.parent).as_posix()}\0".encode())
            total.update(hashlib.sha256(file.read_bytes()).digest())
    return total.hexdigest()


def begin(outs: list[Path], key: str) -> None:
    """Note what the outputs are made from; remove what was made from something else."""
    note = outs[0].parent / STATE / f"{outs[0].name}.json"
    known = json.loads(note.read_text())["key"] if note.is_file() else None
    if known != key:
        for out in outs:
            shutil.rmtree(out, ignore_errors=True)
        write_json(note, {"key": key})


def main() -> int:
    """The exit code of the first command that fails, or 0."""
    own, *commands = _split(sys.argv[1:])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", nargs="+", type=Path)
    parser.add_argument("--input", nargs="*", type=Path, default=[])
    arguments = parser.parse_args(own)
    parts = [digest(path) for path in (CODE, *arguments.input)]
    begin(arguments.out, hashlib.sha256(json.dumps([commands, parts]).encode()).hexdigest())
    for command in commands:
        code = subprocess.run([sys.executable, "-m", "busybot", *command], cwd=os.getcwd()).returncode
        if code:
            return code
    return 0


def _split(words: list[str]) -> list[list[str]]:
    """Parts between the words `--`."""
    parts: list[list[str]] = [[]]
    for word in words:
        if word == "--":
            parts.append([])
        else:
            parts[-1].append(word)
    return parts


if __name__ == "__main__":
    sys.exit(main())
