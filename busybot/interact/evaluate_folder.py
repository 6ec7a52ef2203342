"""Where an evaluation's results lie, so that one that was stopped can go on, and its recorded episodes.

settings.json       what is measured: another measurement is refused in the same folder
boards.jsonl        what was judged, one board per line, in the order in which they were finished
result.json         all metrics, when every board is judged
"""

import json
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from busybot import __version__
from busybot.episodes.dataset import Dataset
from busybot.episodes.dataset_info import CollectInfo
from busybot.errors import BusybotError
from busybot.files import append_line, read_json, write_atomically, write_json

SETTINGS, BOARDS, RESULT = "settings.json", "boards.jsonl", "result.json"


J = TypeVar("J", bound=BaseModel)


def begin(out: Path, settings: dict[str, Any], kind: type[J]) -> dict[int, J]:
    """Start or continue a folder; returns what is judged already, by board.

    Args:
        kind: of the lines; it has the number of the board as `board`.

    Raises:
        BusybotError: the folder holds something else, or a measurement with other settings.
    """
    file = out / SETTINGS
    if not file.exists():
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise BusybotError(f"{out}: it exists and holds no evaluation", "name another folder")
        write_json(file, plain(settings))
    known = read_json(file)
    if not isinstance(known, dict):
        raise BusybotError(f"{file}: not an object", "name another folder")
    differing = [key for key, value in plain(settings).items() if known.get(key) != value]
    if differing:
        what = f"{out}: an evaluation with other settings was begun there: {', '.join(differing)} differ"
        raise BusybotError(what, "name another folder, or repeat the command with which it was begun")
    return dict(_judged_lines(out / BOARDS, kind))


def versions() -> dict[str, str]:
    """Of what results depend on."""
    packages = {name: version(name) for name in ("numpy", "sapien", "torch")}
    return {"busybot": __version__, "python": platform.python_version(), **packages}


def plain(values: dict[str, Any]) -> dict[str, Any]:
    """As it comes back from a JSON file."""
    return dict(json.loads(json.dumps(values)))


def _judged_lines(file: Path, kind: type[J]) -> Iterator[tuple[int, J]]:
    """Whole lines; one that a killed evaluation left unfinished is cut off."""
    if not file.exists():
        return
    data = file.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) < len(data):
        write_atomically(file, whole)
    for number, line in enumerate(whole.splitlines(), start=1):
        try:
            judged = kind.model_validate_json(line)
        except ValidationError as error:
            raise BusybotError(f"{file}: line {number}: {error.errors()[0]['msg']}", "remove the folder") from None
        yield judged.model_dump(include={"board"})["board"], judged


def append(out: Path, line: str) -> None:
    """Remember a judged board, given as JSON."""
    append_line(out / BOARDS, line)


@contextmanager
def recording(path: Path, dataset: Dataset, collected: CollectInfo) -> Iterator[Dataset]:
    """A dataset with the same boards, locked, for the episodes of an evaluation; its tables are written at the end.

    Raises:
        BusybotError: it has other boards, or its episodes were begun with other settings.
    """
    if path.exists() and any(path.iterdir()):
        target = Dataset.open(path)
        if target.hashes().board != dataset.hashes().board:
            raise BusybotError(f"{path}: its boards are not those of {dataset.path}", "name another folder")
    else:
        info = dataset.info.model_copy(update={"collect": None})
        target = Dataset.create(path, info, dataset.boards())
    with target.locked():
        target.begin_collecting(collected)
        target.remove_leftovers()
        try:
            yield target
        finally:
            target.write_tables()
