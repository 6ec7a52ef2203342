"""Lets a program play the boards of a dataset as text (`text_game`) and measures the graphs that it claims.

Of the files that the agent's command names, programs are told from others: see `AgentFiles`. With another program no
evaluation goes on. Others may be what the run itself writes, such as a log or a cache of answers: they may change.
"""

import os
import shlex
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from busybot.boards.spec import BoardSpec
from busybot.common.atomic_io import read_json, sha256_of
from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_HASHED_BYTES
from busybot.common.process_pool import Progress
from busybot.common.text import one_line
from busybot.datasets.dataset import Dataset
from busybot.evaluation.folder import SETTINGS, BoardWork, conclude, judge_boards
from busybot.evaluation.judgements import log_judgement
from busybot.evaluation.results import of_this_code, stamp
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
PROGRAMS = frozenset(
    (
        *(".py", ".pyc", ".pyz", ".sh", ".bash", ".zsh", ".js", ".mjs", ".cjs", ".ts", ".mts", ".rb", ".pl", ".php"),
        *(".lua", ".r", ".jl", ".jar", ".java", ".go", ".rs", ".hs", ".ml", ".scala", ".wasm"),
    )
)
"""Ends of names of files that are programs, in small letters."""


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


@dataclass(frozen=True)
class AgentFiles:
    """Files that words of a command name, by these words: each has its SHA-256, or what `told_of` tells in its place.

    Attributes:
        programs: of the first word, and those that may be executed or whose name ends as in `PROGRAMS`.
        data: the others. Whether a program reads or writes them is not known, but that what changed while it played was
            written.
    """

    programs: dict[str, str]
    data: dict[str, str]

    @classmethod
    def of(cls, words: Sequence[str]) -> Self:
        """As they are now."""
        places = {word: Path(word) for word in words} | {words[0]: Path(shutil.which(words[0]) or words[0])}
        files = {word: told for word, place in places.items() if (told := told_of(place)) is not None}
        programs = {word for word in files if word == words[0] or _is_program(places[word])}
        return cls(
            {word: told for word, told in files.items() if word in programs},
            {word: told for word, told in files.items() if word not in programs},
        )


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
    (pairs of objects) were not exactly the true ones; `actions_used` is a mean over boards. `agent_data` has the data
    files of the command as they were at first, `agent_changed` names those that are others now; what did not change
    counts as part of the agent in `hashes` and in the log of judgings.

    Args:
        out: folder for the results, with which a stopped evaluation of the same program goes on.
        command: that gives this result again.

    Raises:
        BusybotError: nobody knows the relations, `out` holds something else or what another program did, or the program
            cannot be started.
    """
    dataset, info = games.dataset, games.dataset.info
    boards = dataset.boards()[: games.boards]
    for board in boards:
        if not board.relations_known:
            what = f"{dataset.path}: nobody knows the relations of board {board.index}: nothing can be judged"
            raise BusybotError(what, "use boards that `busybot generate` made")
    hashes, agent = dataset.hashes(), shlex.join(games.agent)
    files = at_first(out, agent, AgentFiles.of(games.agent))
    settings = {
        "agent": agent,
        "agent_files": files.programs,
        "agent_data": files.data,
        "most_actions": games.actions,
        "timeout_s": games.timeout_s,
        "seed": games.seed,
        "world": boards[0].world if boards else None,
        "dataset": {"name": info.name, "split": info.split, "boards": len(boards), "board_hash": hashes.board},
    }
    seconds = STARTING_S + games.timeout_s * (games.actions + MOST_REFUSED + 1)
    work = BoardWork(PlayedBoard, make_work, (games,), workers, seconds)
    played = judge_boards([board.index for board in boards], work, settings, progress, out)
    now = AgentFiles.of(games.agent).data
    same = {word: told for word, told in files.data.items() if now.get(word) == told}
    hashed: dict[str, dict[str, Any]] = {"models": {agent: files.programs | same}, "tasks": {info.name: hashes.board}}
    stamped = stamp("play", command=command, hashes=hashed)
    changed = {"agent_changed": sorted((files.data | now).keys() - same.keys())}
    result = {**stamped, **settings, **changed, **summarised(boards, played, games.seed)}
    result["logged"] = log_judgement(dataset, [one.index for one in boards], agent, result)
    return conclude(out, result)


def at_first(out: Path | None, agent: str, now: AgentFiles) -> AgentFiles:
    """The agent's files when the evaluation in `out` began; as they are now, where the same command began none there.

    Raises:
        BusybotError: a program is another one now.
    """
    known = read_json(out / SETTINGS) if out is not None and (out / SETTINGS).exists() else {}
    if not of_this_code(known) or known.get("agent") != agent:
        return now
    programs, data = known.get("agent_files"), known.get("agent_data")
    if not isinstance(programs, dict) or not isinstance(data, dict):
        return now
    differing = [word for word in now.programs | programs if now.programs.get(word) != programs.get(word)]
    if differing:
        names = one_line(", ".join(differing))
        what = f"{out}: another program began the evaluation there: agent_files differ: {names}"
        hint = "name another folder, or put back what was there; if the agent itself writes it, end its name as in .log"
        raise BusybotError(what, hint)
    return AgentFiles(now.programs, data)


def _is_program(place: Path) -> bool:
    return place.suffix.lower() in PROGRAMS or os.access(place, os.X_OK)


def told_of(place: Path) -> str | None:
    """The SHA-256 of a file that the program's command names, or its size and date where that is too much to read, or
    may not be read; None of a word that names no file."""
    try:
        about = place.stat() if place.is_file() else None
    except OSError:  # such as a piece of a program, longer than names are
        return None
    if about is None:
        return None
    if about.st_size <= MAX_HASHED_BYTES:
        with suppress(BusybotError, OSError):  # such as a log that a program of another user has just removed
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
