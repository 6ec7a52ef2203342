"""Where an evaluation's results lie, so that one that was stopped can go on, and its recorded episodes.

settings.json       what is measured: another measurement is refused in the same folder
boards.jsonl        one judged board per line, in the order in which they were finished
result.json         all metrics, when every board is judged
"""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from busybot.episodes.dataset import Dataset
from busybot.episodes.dataset_info import CollectInfo
from busybot.errors import BusybotError
from busybot.files import read_json, write_json
from busybot.interact.metrics import JudgedBoard

SETTINGS, BOARDS, RESULT = "settings.json", "boards.jsonl", "result.json"


def begin(out: Path, settings: dict[str, Any]) -> dict[int, JudgedBoard]:
    """Start or continue a folder; returns the boards that are judged already.

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
    return dict(_judged_lines(out / BOARDS))


def plain(values: dict[str, Any]) -> dict[str, Any]:
    """As it comes back from a JSON file."""
    return dict(json.loads(json.dumps(values)))


def _judged_lines(file: Path) -> Iterator[tuple[int, JudgedBoard]]:
    """Whole lines; one that a killed evaluation left unfinished is cut off."""
    if not file.exists():
        return
    data = file.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) < len(data):
        os.truncate(file, len(whole))
    for number, line in enumerate(whole.splitlines(), start=1):
        try:
            board = JudgedBoard.model_validate_json(line)
        except ValidationError as error:
            raise BusybotError(f"{file}: line {number}: {error.errors()[0]['msg']}", "remove the folder") from None
        yield board.board, board


def append(out: Path, line: str) -> None:
    """Remember a judged board, given as JSON."""
    with open(out / BOARDS, "a", encoding="utf-8") as lines:
        lines.write(line + "\n")
        lines.flush()


@contextmanager
def recording(path: Path, dataset: Dataset, settings: dict[str, Any]) -> Iterator[Dataset]:
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
    config = settings["config"]
    with target.locked():
        target.begin_collecting(
            CollectInfo(
                policy=settings["policy"],
                steps=settings["actions"],
                strict=settings["strict"],
                delta=config["interaction"]["delta"],
                seed=settings["seed"],
                settings={name: config[name] for name in ("responders", "interaction", "render")}
                | {"chooser": settings["provenance"]},
            )
        )
        target.remove_leftovers()
        try:
            yield target
        finally:
            target.write_tables()
