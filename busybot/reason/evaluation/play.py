"""Lets a program play the boards of a dataset as text (`text_game`) and measures the graphs that it claims."""

import shlex
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from busybot.boards.spec import BoardSpec
from busybot.common.atomic_io import sha256_of
from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_HASHED_BYTES
from busybot.common.process_pool import Progress
from busybot.datasets.dataset import Dataset
from busybot.evaluation.folder import BoardWork, conclude, judge_boards
from busybot.evaluation.judgements import log_judgement
from busybot.evaluation.results import stamp
from busybot.objects.library import Library
from busybot.reason.evaluation.causes import JudgedCauses, candidates_of
from busybot.reason.evaluation.causes_summary import summarise_causes
from busybot.reason.evaluation.text_game import MOST_REFUSED, Game, Pairs, PlayedBoard, play

STARTING_S = 60.0
"""What a worker may need beside the child's answers."""
FIGURES = (
    *("parent_p", "parent_r", "parent_f1", "parent_f1_bound", "link_parent_p", "link_parent_r", "link_parent_f1"),
    *("link_parent_f1_bound", "shd", "shd_bound", "bound_boards"),
)
"""Figures of `causes_summary.KEYS` that a claimed graph has."""


@dataclass(frozen=True)
class TextGames:
    """What is played; plain data for worker processes.

    Attributes:
        dataset: only its boards are used.
        library: the boards' objects.
        agent: words of the command that is started for each board.
        actions: on each board, at most.
        timeout_s: of each answer, the first one's start included.
        boards: only so many, the first ones; None for all.
        seed: of which actions fail.
    """

    dataset: Dataset
    library: Library
    agent: tuple[str, ...]
    actions: int = 22
    timeout_s: float = 60.0
    boards: int | None = None
    seed: int = 0


def make_work(games: TextGames) -> Callable[[int], PlayedBoard]:
    """What a worker does with a board's number."""

    def work(index: int) -> PlayedBoard:
        board = games.dataset.board(index)
        return play(Game(board, games.library, games.actions, games.seed), games.agent, games.timeout_s)

    return work


def play_boards(
    games: TextGames,
    workers: int = 1,
    progress: Progress | None = None,
    out: Path | None = None,
    command: str | None = None,
) -> dict[str, Any]:
    """Let the program play all boards and judge it: `FIGURES` as `causes_summary.KEYS` says, and how boards ended.

    `wrong_early_stops` is the share of the boards on which it said what it knows with actions left, and its parents
    (pairs of objects) were not exactly the true ones; `actions_used` is a mean over boards.

    Args:
        out: folder for the results, with which a stopped evaluation of the same program goes on.
        command: that gives this result again.

    Raises:
        BusybotError: nobody knows the relations, `out` holds something else, or the program cannot be started.
    """
    dataset, info = games.dataset, games.dataset.info
    boards = dataset.boards()[: games.boards]
    for board in boards:
        if not board.relations_known:
            what = f"{dataset.path}: nobody knows the relations of board {board.index}: nothing can be judged"
            raise BusybotError(what, "use boards that `busybot generate` made")
    hashes = dataset.hashes()
    places = {word: Path(word) for word in games.agent} | {
        games.agent[0]: Path(shutil.which(games.agent[0]) or games.agent[0])
    }
    files = {word: told for word, place in places.items() if (told := told_of(place)) is not None}
    settings = {
        "agent": shlex.join(games.agent),
        "agent_files": files,
        "most_actions": games.actions,
        "timeout_s": games.timeout_s,
        "seed": games.seed,
        "world": boards[0].world if boards else None,
        "dataset": {"name": info.name, "split": info.split, "boards": len(boards), "board_hash": hashes.board},
    }
    seconds = STARTING_S + games.timeout_s * (games.actions + MOST_REFUSED + 1)
    work = BoardWork(PlayedBoard, make_work, (games,), workers, seconds)
    played = judge_boards([board.index for board in boards], work, settings, progress, out)
    hashed: dict[str, dict[str, Any]] = {"models": {shlex.join(games.agent): files}, "tasks": {info.name: hashes.board}}
    stamped = stamp("play", command=command, hashes=hashed)
    result = {**stamped, **settings, **summarised(boards, played, games.seed)}
    result["logged"] = log_judgement(dataset, [one.index for one in boards], str(settings["agent"]), result)
    return conclude(out, result)


def told_of(place: Path) -> str | None:
    """The SHA-256 of a file that the program's command names, or its size and date where that is too much to read; None
    of a word that names no file."""
    try:
        about = place.stat() if place.is_file() else None
    except OSError:  # such as a piece of a program, longer than names are
        return None
    if about is None:
        return None
    if about.st_size <= MAX_HASHED_BYTES:
        return sha256_of(place)
    return f"{about.st_size} bytes, changed at {about.st_mtime_ns} ns"


def summarised(boards: Sequence[BoardSpec], played: Sequence[PlayedBoard], seed: int) -> dict[str, Any]:
    """Figures of all boards, JSON values."""
    judged = [(board, _causes(board, one)) for board, one in zip(boards, played, strict=True)]
    told = summarise_causes(judged, 1, None, seed)
    wrong = sum(one.early and one.true != one.claimed for one in played)
    ends = {end: sum(one.end == end for one in played) for end in dict.fromkeys(one.end for one in played)}
    rows = [
        {name: row[name] for name in ("board", "parent_f1", "parent_f1_bound", "shd")}
        | one.model_dump(mode="json", include={"end", "note", "actions", "refused", "early"})
        for row, one in zip(told["cause_boards"], played, strict=True)
    ]
    return {
        "boards": len(played),
        **{name: told[name] for name in FIGURES},
        "intervals": {name: told["cause_intervals"]["boards"][f"parent_{name}"] for name in ("p", "r", "f1")},
        "actions_used": float(np.mean([one.actions for one in played])) if played else None,
        "early_stops": sum(one.early for one in played),
        "wrong_early_stops": wrong / len(played) if played else None,
        "refused": sum(one.refused for one in played),
        "ends": ends,
        "cause_boards": rows,
    }


def _causes(board: BoardSpec, one: PlayedBoard) -> JudgedCauses:
    """A played board, as it is at its end, for `summarise_causes`."""

    def matrix(pairs: Pairs) -> np.ndarray:
        found = np.zeros((1, len(board.objects), len(board.objects)), bool)
        for cause, effect in pairs:
            found[0, cause, effect] = True
        return found

    claimed = matrix(one.claimed)
    return JudgedCauses(
        candidates_of(board),
        matrix(one.true),
        claimed.astype(float),
        claimed,
        bound=None if one.bound is None else matrix(one.bound),
        links=np.array([one.links], int),
        links_bound=None if one.links_bound is None else np.array([one.links_bound], int),
    )
