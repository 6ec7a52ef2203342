"""The process that reads copies: what it reads may take all memory, hang, or end it."""

import json
import os
import resource
import shutil
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from tests.hostile.containers import CONTAINERS
from tests.hostile.damage import damage
from tests.hostile.doors import DOORS
from tests.hostile.lerobot import LEROBOT
from tests.hostile.places import PLACES
from tests.hostile.targets import NOTICED, TARGETS, Target, exchange

KINDS_OF_FILES = TARGETS | DOORS | CONTAINERS | LEROBOT | PLACES
MEGABYTES = 1500
"""So much more memory than the process had before may the reading of a copy take."""


def child(name: str, first: int, cases: int, scratch: Path, told: Connection) -> None:
    """Read the copies from `first` on and tell one line of JSON of each; what else is said goes into a file."""
    with (scratch / "said").open("wb") as said:
        os.dup2(said.fileno(), 1)
        os.dup2(said.fileno(), 2)
    target, pristine, outside = KINDS_OF_FILES[name], scratch / "pristine", scratch / "work"
    if not pristine.exists():
        pristine.mkdir(parents=True)
        target.make(pristine)
    outside.mkdir(exist_ok=True)
    os.chdir(outside)
    expected = target.read(pristine)
    status = dict(line.split(":\t", 1) for line in Path("/proc/self/status").read_text().splitlines())
    limit = int(status["VmData"].split()[0]) * 1024 + MEGABYTES * 1_000_000
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    for number in range(first, cases):
        told.send_bytes(json.dumps(one(name, target, number, pristine, outside, expected)).encode())


def one(name: str, target: Target, number: int, pristine: Path, outside: Path, expected: Any) -> dict[str, Any]:
    """One damaged copy; `finding` is None if it passes."""
    folder = outside / "copy"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(pristine, folder)
    rng = generator(0, "hostile", number, name)
    if target.ways:
        files = sorted(path for path in folder.glob(target.files) if path.is_file())
        file = files[int(rng.integers(len(files)))]
        before = file.read_bytes()
        what = damage(file, target.ways, rng)
        unchanged = (
            file.is_file() and not file.is_symlink() and file.stat().st_size < 1e9 and file.read_bytes() == before
        )
    else:
        (file, what), unchanged = (target.spoil or exchange)(folder, rng), False
    result, finding = read(target, folder, file, expected, unchanged)
    if {path.name for path in outside.iterdir()} != {"copy"}:
        finding = f"it wrote elsewhere: {sorted(path.name for path in outside.iterdir())}"
        shutil.rmtree(outside / "pickle-was-run", ignore_errors=True)
    return {"number": number, "damage": what, "file": file.name, "result": result, "finding": finding}


def read(target: Target, folder: Path, file: Path, expected: Any, unchanged: bool) -> tuple[str, str | None]:
    """How reading ended, and what is wrong with that."""
    try:
        answer = target.read(folder)
    except BusybotError as error:
        if file.name not in error.what:
            said = error.what.replace(str(folder), folder.name)
            return "refused", f"the error does not name {file.name}: {said[:200]}"
        return "refused", None if len(error.what) < 2000 else "an endless message"
    except BaseException as error:
        return "raised", f"{type(error).__name__}: {str(error)[:200]}"
    if isinstance(answer, str) and answer == NOTICED:
        return "noticed", None
    same = bool(answer == expected)
    if same:
        return "same answer", None
    return "another answer", "a wrong answer" if target.strict and not unchanged else None
