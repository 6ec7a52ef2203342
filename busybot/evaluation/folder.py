"""Evaluates the boards of a dataset, each by itself; with a folder for the results, a stopped evaluation goes on.

A skill says what a worker process does with a board (`BoardWork`) and how judged boards become a result. The folder:

settings.json       what is measured, and by which versions: another measurement is refused in the same folder
boards.jsonl        what was judged, one board per line, in the order in which they were finished
result.json         all metrics, when every board is judged

The result of a board depends on the board, the settings and the code alone, so it is the same whatever the number of
workers and interruptions.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import BaseModel, ValidationError

from busybot.common.atomic_io import (
    append_line,
    make_folder,
    names_in,
    read_json,
    read_regular,
    remove_leftovers,
    write_atomically,
    write_json,
)
from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_LINES_BYTES
from busybot.common.process_pool import RECYCLE, TASK_SECONDS, Progress, run_tasks
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import CollectInfo
from busybot.evaluation.results import of_this_code, package_versions

SETTINGS, BOARDS, RESULT = "settings.json", "boards.jsonl", "result.json"
OTHER_CODE = "what is there was judged by another version of busybot"

J = TypeVar("J", bound=BaseModel)
"""A judged board; it has the board's number in its dataset as `board`."""


@dataclass(frozen=True)
class BoardWork(Generic[J]):
    """What worker processes do.

    Attributes:
        judged: what they make of a board.
        make: importable by name; what it returns for the arguments judges the board with a number.
        workers: processes that share the work.
        seconds: a board that takes longer is tried again.
    """

    judged: type[J]
    make: Callable[..., Callable[[int], J]]
    arguments: tuple[Any, ...]
    workers: int
    seconds: float = TASK_SECONDS


@dataclass(frozen=True)
class EvaluationRecording:
    """A new dataset for the episodes of an evaluation, or one to go on with.

    Attributes:
        dataset: which has the boards.
        collected: how the episodes come about.
        root: folder that the user named, if it is another one: below it no link is followed.
    """

    path: Path
    dataset: Dataset
    collected: CollectInfo
    root: Path | None = None


def judge_boards(
    boards: Sequence[int],
    work: BoardWork[J],
    settings: dict[str, Any],
    progress: Progress | None = None,
    out: Path | None = None,
    recordings: Sequence[EvaluationRecording] = (),
) -> list[J]:
    """Judge all of these boards that are not judged yet; returns them in this order.

    Args:
        boards: numbers.
        settings: what is measured, JSON values.
        out: folder for the results.
        recordings: boards without an episode in one of them are judged again.

    Raises:
        BusybotError: `out` or a recording hold something else, or a worker is at fault.
    """
    judged = begin(out, settings, work.judged) if out is not None else {}
    with ExitStack() as stack:
        done = set(judged)
        for recording in recordings:
            done &= stack.enter_context(_recorded(recording)).finished()
        missing = [index for index in boards if index not in done]
        tasks = run_tasks(missing, work.make, work.arguments, work.workers, RECYCLE, work.seconds)
        for finished, (index, one) in enumerate(tasks, start=len(boards) - len(missing) + 1):
            judged[index] = one
            if out is not None:
                append_line(out / BOARDS, one.model_dump_json())
            if progress:
                progress(finished, len(boards))
    return [judged[index] for index in boards]


def conclude(out: Path | None, result: dict[str, Any]) -> dict[str, Any]:
    """Write the result, if there is a folder for it; returns it as it comes back from there."""
    values = plain(result)
    if out is not None:
        write_json(out / RESULT, values)
    return values


def begin(out: Path, settings: dict[str, Any], kind: type[J]) -> dict[int, J]:
    """Start or continue a folder; returns what is judged already, by board.

    Raises:
        BusybotError: the folder holds something else, or a measurement with other settings or by other code.
    """
    settings, file = plain(settings) | {"versions": package_versions()}, out / SETTINGS
    if not file.exists():
        if out.exists() and (not out.is_dir() or names_in(out)):
            raise BusybotError(f"{out}: it exists and holds no evaluation", "name another folder")
        write_json(file, settings)
    known = read_json(file)
    if not isinstance(known, dict):
        raise BusybotError(f"{file}: not an object", "name another folder")
    differing = [key for key, value in settings.items() if known.get(key) != value]
    if not of_this_code(known):
        raise BusybotError(f"{out}: {OTHER_CODE}", "name another folder, or remove this one")
    if differing:
        what = f"{out}: an evaluation with other settings was begun there: {', '.join(differing)} differ"
        raise BusybotError(what, "name another folder, or repeat the command with which it was begun")
    remove_leftovers(out)
    return dict(judged_lines(out / BOARDS, kind))


def plain(values: dict[str, Any]) -> dict[str, Any]:
    """As it comes back from a JSON file."""
    return dict(json.loads(json.dumps(values)))


def judged_lines(file: Path, kind: type[J]) -> Iterator[tuple[int, J]]:
    """Judged boards with their numbers, as they were finished; a line that a killed evaluation left unfinished is cut
    off.

    Args:
        file: `BOARDS` of an evaluation's folder.

    Raises:
        BusybotError: a line is no judged board.
    """
    if not file.exists():
        return
    data = read_regular(file, MAX_LINES_BYTES, "remove the folder")
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) < len(data):
        write_atomically(file, whole)
    for number, line in enumerate(whole.splitlines(), start=1):
        try:
            judged = kind.model_validate_json(line)
        except ValidationError as error:
            raise BusybotError(f"{file}: line {number}: {error.errors()[0]['msg']}", "remove the folder") from None
        yield judged.model_dump(include={"board"})["board"], judged


@contextmanager
def _recorded(recording: EvaluationRecording) -> Iterator[Dataset]:
    """A dataset with the same boards, locked; its tables are written at the end.

    Raises:
        BusybotError: it has other boards, or its episodes were begun with other settings.
    """
    path, dataset = recording.path, recording.dataset
    if recording.root is not None:
        make_folder(path, recording.root)
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        target = Dataset.open(path)
        if target.hashes().board != dataset.hashes().board:
            raise BusybotError(f"{path}: its boards are not those of {dataset.path}", "name another folder")
    else:
        info = dataset.info.model_copy(update={"collect": None})
        target = Dataset.create(path, info, dataset.boards())
    with target.locked():
        target.begin_collecting(recording.collected)
        target.remove_leftovers()
        try:
            yield target
        finally:
            target.write_tables()
