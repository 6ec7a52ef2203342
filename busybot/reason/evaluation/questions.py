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

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, ValidationError

from busybot.boards.spec import PAPER
from busybot.boards.true_causes import VariableNames
from busybot.common.atomic_io import parse_json, read_text, sha256_of
from busybot.common.errors import BusybotError, naming
from busybot.common.frozen_model import GivenModel, first_fault
from busybot.common.limits import MAX_ANSWERS_BYTES
from busybot.common.process_pool import Progress, share
from busybot.common.rng import generator
from busybot.common.text import one_line
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
HINT = "`busybot eval what-if DATASET --questions FILE` writes such lines"
States = tuple[int, ...]


class Answer(GivenModel):
    """States of a responder after each action, as it happened and had the first one moved nothing."""

    happened: States = Field(strict=False)
    otherwise: States = Field(strict=False)


class Question(GivenModel):
    """A pair of questions; see the module.

    Attributes:
        answers: by the responder's name, of all whose answers count.
    """

    board: int = Field(ge=0)
    question: int = Field(ge=0)
    step: int
    link: str
    actions: int
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
    happened, otherwise = watched.pairs.happened, watched.pairs.otherwise
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
) -> list[Question]:
    """The pairs about all recorded boards of a dataset, in their order.

    Raises:
        BusybotError: nothing is recorded, or there is nothing to ask about it.
    """
    indices = sorted(dataset.finished())
    if not indices:
        raise BusybotError(f"{dataset.path}: no board has an episode", collect_command(dataset.path, dataset.info))
    needed = any(board.world != PAPER for board in dataset.boards())
    work = partial(_questions_in, library=library_of(dataset, assets) if needed else None, images=images)
    files, asked = [dataset.episode_path(index) for index in indices], list[Question]()
    for done, found in enumerate(share(work, files, workers), start=1):
        asked += found
        if progress is not None:
            progress(done, len(files))
    if not asked:
        what = f"{dataset.path}: nothing to ask: no board knows its states, or no action made a difference"
        raise BusybotError(what, "record simulated boards, with a policy that moves links")
    return asked


def _questions_in(file: Path, library: Library | None, images: int) -> list[Question]:
    with naming(str(file)):
        return questions_of(read_episode(file, "lazy"), library, images)


def lines(questions: Iterable[Question]) -> str:
    """As a file has them."""
    return "".join(f"{one.model_dump_json()}\n" for one in questions)


@dataclass(frozen=True)
class GivenAnswers:
    """Anybody's answers, by board and question, and where they come from."""

    path: Path
    answers: dict[tuple[int, int], Question]

    def to(self, asked: Question) -> Question:
        """The answers to a pair of questions.

        Raises:
            BusybotError: there are none, they are to another question, or a responder has none.
        """
        place = f"{self.path}: board {asked.board}, question {asked.question}"
        given = self.answers.get((asked.board, asked.question))
        if given is None:
            raise BusybotError(f"{place}: there is no answer", "answer all questions; a guess counts as one")
        about = [(one.step, one.link, one.actions) for one in (asked, given)]
        if about[0] != about[1]:
            what = f"{place}: it is about {_words(given)}, what is asked about {_words(asked)}"
            raise BusybotError(what, "keep the questions as they were written; --images asks others")
        for name in asked.answers:
            told = given.answers.get(name)
            if told is None:
                raise BusybotError(
                    f"{place}: there is no answer for {name}", "answer for all responders that are named"
                )
            for way in ("happened", "otherwise"):
                if len(getattr(told, way)) != asked.actions:
                    what = f"{place}: {name}: {way} has {len(getattr(told, way))} states for {asked.actions} actions"
                    raise BusybotError(what, "name the state after each action")
        return given


def _words(one: Question) -> str:
    return f"{one_line(one.link)} after step {one.step}, {one.actions} actions"


def read_answers(path: Path) -> GivenAnswers:
    """Read a file of answers.

    Raises:
        BusybotError: naming the line and what is wrong with it.
    """
    found: dict[tuple[int, int], Question] = {}
    for number, line in enumerate(read_text(path, MAX_ANSWERS_BYTES, HINT).split("\n"), start=1):
        if not line.strip():
            continue
        with naming(f"{path}: line {number}"):
            told = _question(line)
            if (told.board, told.question) in found:
                what = f"a second answer to question {told.question} of board {told.board}"
                raise BusybotError(what, "answer each question once")
        found[told.board, told.question] = told
    return GivenAnswers(path, found)


def _question(line: str) -> Question:
    try:
        return Question.model_validate(parse_json(line))
    except ValidationError as error:
        raise BusybotError(first_fault(error), HINT) from None
    except (ValueError, RecursionError) as error:  # of JSON, and of numbers with thousands of digits
        raise BusybotError(f"not valid JSON: {error}", HINT) from None


def judge_answers(
    dataset: Dataset, asked: Sequence[Question], given: GivenAnswers, images: int = IMAGES, seed: int = 0
) -> dict[str, Any]:
    """Compare answers with the truth; JSON values.

    `what_if` is the share of pairs of which every responder is told rightly after every action, both ways.

    Args:
        asked: all pairs about the dataset.
        images: that they were asked about.
        seed: of the bootstrap.

    Raises:
        BusybotError: a pair is not answered as it was asked, or one is answered that was not asked.
    """
    if others := given.answers.keys() - {(one.board, one.question) for one in asked}:
        board, question = min(others)
        what = f"{given.path}: board {board}, question {question}: nobody asked that"
        raise BusybotError(what, "answer the questions about this dataset, with the same --images")
    right = np.array([_rightly(one, given.to(one)) for one in asked], bool)
    boards = np.unique([one.board for one in asked], return_inverse=True)[1]
    part, whole = np.bincount(boards, right), np.bincount(boards)
    chosen = generator(seed, dataset.info.split, 0, "reason/bootstrap-what-if").integers(
        len(whole), size=(DRAWS, len(whole))
    )
    about, file = origin(dataset), given.path
    data = {about["name"]: {key: about[key] for key in ("board_hash", "trace_hash", "content_hash")}}
    result = {
        **stamp(KIND, seed=seed, hashes={"models": {file.name: sha256_of(file)}, "data": data}),
        "images": images,
        "boards": len(whole),
        "pairs": len(asked),
        "right": int(right.sum()),
        "what_if": float(right.mean()),
        "intervals": {"what_if": interval_over_boards(part, whole, chosen)},
        "dataset": about,
    }
    return {**result, "logged": log_judgement(dataset, {one.board for one in asked}, file.name, result)}


def _rightly(asked: Question, given: Question) -> bool:
    return all(given.answers[name] == answer for name, answer in asked.answers.items())
