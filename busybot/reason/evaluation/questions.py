"""`busybot eval what-if`: paired questions "what if" with their answers as a file, and anybody's answers to be judged.

They are the questions that `busybot eval reason` asks its models (`what_if.pairs`), in words that need none of our
code, one line of JSON each:

    {"board": 3, "question": 0, "step": 5, "link": "switch_0.link_1", "actions": 3,
     "answers": {"lamp_4": {"happened": [0, 1, 1], "otherwise": [0, 0, 0]}}}

After the first `step` recorded actions of the board the next one moved `link`. What does each responder show after
this and the following ones, `actions` in all: as it `happened`, and `otherwise`, had that one action moved nothing?
Variables are named, and states counted, as in the tables of `busybot dataset export --to causal`. A file to be judged
has the same lines, with answers of its own.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from busybot.boards.spec import PAPER
from busybot.boards.true_causes import VariableNames
from busybot.common.atomic_io import parse_json, read_text, sha256_of
from busybot.common.errors import BusybotError, naming
from busybot.common.frozen_model import first_fault
from busybot.common.process_pool import Progress, share
from busybot.common.rng import generator
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import collect_command
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.judgements import log_judgement
from busybot.evaluation.results import stamp
from busybot.evaluation.statistics import DRAWS, interval_over_boards
from busybot.objects.library import Library
from busybot.reason.evaluation.causes import Watched, link_names
from busybot.reason.evaluation.decoders import judged_objects
from busybot.reason.evaluation.evaluate import IMAGES, origin
from busybot.reason.evaluation.what_if import moved_link
from busybot.reason.inputs.observation import acted_objects, observe_episode, pushes_of

KIND = "what-if"
MAX_FILE_BYTES = 256 * 1024 * 1024
HINT = "`busybot eval what-if DATASET --questions FILE` writes such lines"
States = tuple[int, ...]


class _Read(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


class Answer(_Read):
    """States of a responder after each action, as it happened and had the first one moved nothing."""

    happened: States = Field(strict=False)
    otherwise: States = Field(strict=False)


class Question(_Read):
    """A pair of questions; see the module.

    Attributes:
        answers: by the responder's name, of all whose answers count.
    """

    board: int = Field(ge=0)
    question: int = Field(ge=0)
    step: int = 0
    link: str = ""
    actions: int = 0
    answers: dict[str, Answer]


def questions_of(episode: Episode, library: Library | None, images: int = IMAGES) -> list[Question]:
    """The pairs about a recorded board; none where nobody knows its states, or they are not what its law makes of them.

    Args:
        library: with the board's objects; in the paper's world the board tells what is needed of them.
        images: questions are about the actions between so many.
    """
    observed = observe_episode(episode, again=True)
    seen = (pushes_of(observed), acted_objects(observed), judged_objects(observed))
    watched = Watched(episode, *seen, images, library)
    if watched.replayed is None or watched.pairs is None:
        return []
    names, links, found = VariableNames(episode.board), link_names(episode), []
    happened, otherwise = watched.pairs
    for number, step in enumerate(happened.steps.tolist()):
        link, actions = moved_link(episode.steps[step]), int(happened.asked[number].sum())
        assert link is not None
        after = [told.shown[number, 1 : actions + 1] for told in (happened, otherwise)]
        answers = {
            names.body(index): Answer(happened=after[0][:, index].tolist(), otherwise=after[1][:, index].tolist())
            for index in np.flatnonzero(watched.controlled).tolist()
        }
        told = {"step": step, "link": names.of(links[link]), "actions": actions}
        found.append(Question(board=episode.board.index, question=number, answers=answers, **told))
    return found


def asked_about(
    dataset: Dataset,
    assets: str | None = None,
    images: int = IMAGES,
    workers: int = 1,
    progress: Progress | None = None,
) -> Iterator[Question]:
    """The pairs about all recorded boards of a dataset, in their order.

    Raises:
        BusybotError: nothing is recorded.
    """
    indices = sorted(dataset.finished())
    if not indices:
        raise BusybotError(f"{dataset.path}: no board has an episode", collect_command(dataset.path, dataset.info))
    known = any(board.world != PAPER for board in dataset.boards())
    work = partial(_questions_in, library=library_of(dataset, assets) if known else None, images=images)
    files = [dataset.episode_path(index) for index in indices]
    for done, found in enumerate(share(work, files, workers), start=1):
        yield from found
        if progress is not None:
            progress(done, len(files))


def _questions_in(file: Path, library: Library | None, images: int) -> list[Question]:
    with naming(str(file)):
        return questions_of(read_episode(file, "lazy"), library, images)


def lines(questions: Iterable[Question]) -> str:
    """As a file has them."""
    return "".join(f"{one.model_dump_json()}\n" for one in questions)


def read_answers(path: Path) -> dict[tuple[int, int], Question]:
    """Answers by board and question.

    Raises:
        BusybotError: naming the line and what is wrong with it.
    """
    found: dict[tuple[int, int], Question] = {}
    for number, line in enumerate(read_text(path, MAX_FILE_BYTES, HINT).splitlines(), start=1):
        if not line.strip():
            continue
        with naming(f"{path}: line {number}"):
            try:
                told = Question.model_validate(parse_json(line))
            except ValidationError as error:
                raise BusybotError(first_fault(error), HINT) from None
            if (told.board, told.question) in found:
                what = f"a second answer to question {told.question} of board {told.board}"
                raise BusybotError(what, "answer each question once")
        found[told.board, told.question] = told
    return found


def judge_answers(
    dataset: Dataset, asked: Sequence[Question], path: Path, images: int = IMAGES, seed: int = 0
) -> dict[str, Any]:
    """Compare a file's answers with the truth; JSON values.

    `what_if` is the share of pairs of which every responder is told rightly after every action, both ways.

    Args:
        asked: all pairs about the dataset.
        seed: of the bootstrap.

    Raises:
        BusybotError: a question, or a responder of one, has no answer, or as many states as it has no actions.
    """
    given = read_answers(path)
    right = np.array([_told_rightly(one, given.get((one.board, one.question)), path) for one in asked], bool)
    boards = np.unique([one.board for one in asked], return_inverse=True)[1]
    part, whole = np.bincount(boards, right), np.bincount(boards)
    rng = generator(seed, dataset.info.split, 0, "reason/bootstrap-what-if")
    chosen = rng.integers(len(whole), size=(DRAWS, len(whole))) if len(whole) else np.zeros((DRAWS, 0), int)
    about = origin(dataset)
    data = {about["name"]: {key: about[key] for key in ("board_hash", "trace_hash", "content_hash")}}
    result = {
        **stamp(KIND, hashes={"models": {path.name: sha256_of(path)}, "data": data}),
        "images": images,
        "boards": len(whole),
        "pairs": len(asked),
        "right": int(right.sum()),
        "what_if": float(right.mean()) if len(asked) else None,
        "intervals": {"what_if": interval_over_boards(part, whole, chosen) if len(whole) else None},
        "dataset": about,
    }
    return {**result, "logged": log_judgement(dataset, {one.board for one in asked}, path.name, result)}


def _told_rightly(asked: Question, given: Question | None, path: Path) -> bool:
    place = f"{path}: board {asked.board}, question {asked.question}"
    if given is None:
        raise BusybotError(f"{place}: there is no answer", "answer all questions; a guess counts as one")
    for name in asked.answers:
        told = given.answers.get(name)
        if told is None:
            raise BusybotError(f"{place}: there is no answer for {name}", "answer for all responders that are named")
        for way in ("happened", "otherwise"):
            if len(getattr(told, way)) != asked.actions:
                what = f"{place}: {name}: {way} has {len(getattr(told, way))} states for {asked.actions} actions"
                raise BusybotError(what, "name the state after each action")
    return all(given.answers[name] == answer for name, answer in asked.answers.items())
