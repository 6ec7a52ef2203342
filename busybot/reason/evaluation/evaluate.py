"""`busybot eval reason`: infer the graphs of a dataset's boards, predict what follows, compare both with the truth.

The graph is inferred from the first 23 images, as in the paper; each later step is predicted from its true current
features. Models see what `observation` lets through; the truth is read here, after it.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from busybot.boards.spec import PAPER, BoardSpec
from busybot.boards.task import affectable
from busybot.common.errors import BusybotError, UsageError, naming
from busybot.common.process_pool import Progress, default_workers, share
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import collect_command
from busybot.datasets.summary import origin_of
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.judgements import log_judgement
from busybot.evaluation.results import package_versions, stamp
from busybot.objects.library import Library
from busybot.reason.evaluation.causes import ACTIONS, Watched, judge_causes
from busybot.reason.evaluation.causes_summary import EARLY
from busybot.reason.evaluation.decoders import (
    DecodedState,
    Linear,
    NearestState,
    StateReadout,
    appearances,
    judged_objects,
    train_decoders,
)
from busybot.reason.evaluation.graph_files import GivenGraphs
from busybot.reason.evaluation.ground_truth import states_of, truth_of
from busybot.reason.evaluation.prediction import DECODED, NEAREST, EvaluatedBoard, judge_prediction
from busybot.reason.evaluation.proposed import (
    BOXES,
    GIVEN,
    PROPOSED,
    PlacedReasoner,
    PlacedStates,
    Proposed,
    propose_objects,
)
from busybot.reason.evaluation.summary import JudgedGraph, summarise
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.inputs.observation import acted_objects, observe_episode, pushes_of
from busybot.reason.inputs.sequence import BoardSequence, clusters_of, sequence_of, threshold_of
from busybot.reason.models.base import InferredGraph, Reasoner, believed
from busybot.reason.models.registry import GRAPHS, ReasonerInfo, config_class, infer, reasoner_of, without_training
from busybot.training.model_cards import file_hashes, find_folder, read_info

IMAGES = 23
"""The paper infers the graph from so many images, one more than actions."""

CURVE = (2, 5, 8, 11, 14, 17, 20, 23)
"""Numbers of observed images after which predictions are judged, beside the number asked for."""

BOARDS_PER_WORKER = 30
"""A process more costs about as much time as so many boards."""

FeaturesOf = Mapping[int, np.ndarray]


@dataclass(frozen=True)
class ReasonEvaluation:
    """How boards are judged; plain data for worker processes.

    Attributes:
        model: of `registry`, by name or folder.
        images: observed ones.
        config: parameters of the model; None for its defaults.
        decoders: by category, for the second judge; None to do without it.
        library: the boards' objects; needed with decoders, which name their appearance, and in all worlds but the
            paper's.
        given: graphs that somebody else inferred, to be judged in place of the model's.
        boxes: of `BOXES`: whether the model is given the true objects, or has to do with proposed ones (`proposed`).
        curve: numbers of observed images after which predictions are judged, beside `images`.
        told: whether the model is told in which world the board was drawn.
        what_if: whether the model is asked what would have happened otherwise, and by that about mechanisms; the
            dearest part where predictions are slow.
    """

    model: str = "count"
    images: int = IMAGES
    config: BaseModel | None = None
    decoders: dict[str, Linear] | None = None
    library: Library | None = None
    given: GivenGraphs | None = None
    boxes: str = GIVEN
    curve: tuple[int, ...] = CURVE
    told: bool = True
    what_if: bool = True


def judge_episode(
    episode: Episode, judging: ReasonEvaluation | None = None, features: np.ndarray | None = None
) -> JudgedGraph:
    """Infer the board's graph from the first images, predict what follows, and put the truth beside both.

    Args:
        features: float (T + 1, N, 256) of the model's encoder; what infers a graph alone needs none.
    """
    judging = judging or ReasonEvaluation()
    return _Recording(episode, judging).judge(judging, features)


class _Recording:
    """A recording that several models are judged on; what does not depend on them is found out once.

    Args:
        judging: how; they may differ in model and parameters.
    """

    def __init__(self, episode: Episode, judging: ReasonEvaluation):
        observed = observe_episode(episode, again=True)
        self.episode, self.truth = episode, states_of(episode)
        self.observed = observed if judging.told else replace(observed, world="")
        self.judged = judged_objects(self.observed)
        self.proposed = propose_objects(self.observed, judging.images) if judging.boxes == PROPOSED else None
        self._sequences: dict[str, BoardSequence] = {}
        self._read: dict[str, _Read] = {}

    def sequence(self, encoder: str, features: np.ndarray) -> BoardSequence:
        """What models see that read the features of this encoder."""
        if encoder not in self._sequences:
            self._sequences[encoder] = sequence_of(self.observed, features)
        return self._sequences[encoder]

    def read(self, judging: ReasonEvaluation, sequence: BoardSequence | None) -> "_Read":
        """The recording as the features of a model's encoder show it.

        Args:
            sequence: None for a model that infers a graph alone.
        """
        encoder = "" if sequence is None else _encoder_of(judging) or ""
        if encoder not in self._read:
            self._read[encoder] = _Read(self, judging, sequence)
        return self._read[encoder]

    def judge(self, judging: ReasonEvaluation, features: np.ndarray | None) -> JudgedGraph:
        """See `judge_episode`."""
        episode, proposed = self.episode, self.proposed
        told = self._told(judging, features)
        graph, longer, early = told.graph, told.longer, told.early
        spurious, forecast, causes = None, None, None
        if proposed is not None:
            if episode.board.relations_known:
                numbers = range(min(len(episode.steps), max(ACTIONS, judging.images - 1)) + 1)
                spurious = np.array([proposed.spurious(early.get(number, longer), number) for number in numbers])
            graph, longer = proposed.true_part(graph), proposed.true_part(longer)
            early = {actions: proposed.true_part(one) for actions, one in early.items()}
        read = self.read(judging, told.sequence)
        if read.board is not None:
            forecast = judge_prediction(read.board, told.reasoner, judging.images, (*judging.curve, judging.images))
        if episode.board.relations_known:
            asked = told.reasoner if judging.what_if else None
            causes = judge_causes(read.watched, replace(longer, kinds=graph.kinds, lags=graph.lags), asked, early)
            causes = replace(causes, spurious=spurious)
        return JudgedGraph(
            episode.board,
            graph,
            truth_of(episode),
            steps=min(judging.images - 1, len(episode.steps)),
            policy=episode.policy,
            oracle=episode.oracle,
            forecast=forecast,
            causes=causes,
            proposals=None if proposed is None else proposed.judged,
            spurious=None if spurious is None else spurious[:, 0],
        )

    def _told(self, judging: ReasonEvaluation, features: np.ndarray | None) -> "_Told":
        proposed = self.proposed
        if judging.given is not None:
            graph = judging.given.of(self.episode)
            return _Told(graph, graph)
        if judging.model in GRAPHS or (features is None and proposed is None):
            seen = self.observed if proposed is None else proposed.observed
            longer = infer(seen.first(max(judging.images, ACTIONS + 1)), judging.model, judging.config)
            longer = longer if proposed is None else proposed.placed(longer)
            # after each action they know what was seen until then
            return _Told(replace(longer, probabilities=longer.probabilities[: max(1, judging.images - 1)]), longer)
        reasoner = reasoner_of(judging.model, judging.config)
        if proposed is not None:
            reasoner = PlacedReasoner(reasoner, proposed)
            sequence = reasoner.sequence
        else:
            assert features is not None
            sequence = self.sequence(reasoner.encoder, features)
        graph = longer = reasoner.graph(sequence.first(judging.images))
        if judging.images <= min(ACTIONS, sequence.steps):
            longer = reasoner.graph(sequence.first(ACTIONS + 1))
        early = {judging.images - 1: graph}
        if self.episode.board.relations_known:  # else nobody judges it
            asked = [actions for actions in EARLY if actions < sequence.steps and actions not in early]
            early |= {actions: believed(reasoner, sequence.first(actions + 1)) for actions in asked}
        return _Told(graph, longer, reasoner, sequence, early)


class _Read:
    """A recording as an encoder's features show it, or without any.

    Attributes:
        board: to judge predictions on; None where none can be judged.
        watched: to judge causes on.
    """

    def __init__(self, recording: _Recording, judging: ReasonEvaluation, sequence: BoardSequence | None):
        episode, truth, judged = recording.episode, recording.truth, recording.judged
        judges: dict[str, StateReadout] = {}
        if sequence is not None and truth is not None:
            judges = _judges(episode.board, judging, sequence, truth.states, judged, recording.proposed)
        self.board = None
        if truth is not None and len(truth.links) >= judging.images:
            counted = judged & _controlled(episode.board)
            self.board = EvaluatedBoard(truth, recording.observed, counted, sequence, judges)
        acted = acted_objects(recording.observed) if recording.proposed is None else recording.proposed.acted
        self.watched = Watched(
            episode, pushes_of(recording.observed), acted, judged, judging.images, judging.library, sequence,
            judges.get(NEAREST),
        )  # fmt: skip


@dataclass(frozen=True)
class _Told:
    """What a model says of a board: a graph of the observed images and one that follows it on; who predicts, and with
    what; None for what infers a graph alone; and what it believes after some numbers of actions, when it has seen no
    more. With proposed objects all of it is at their places."""

    graph: InferredGraph
    longer: InferredGraph
    reasoner: Reasoner | None = None
    sequence: BoardSequence | None = None
    early: Mapping[int, InferredGraph] = field(default_factory=dict)


def _controlled(board: BoardSpec) -> np.ndarray:
    """bool (N,), whose prediction counts: in the paper's world all; in others those that links control, because nobody
    can predict what moves by itself."""
    everyone = np.arange(len(board.objects))
    return np.isin(everyone, affectable(board)) if board.world != PAPER else np.ones(len(everyone), bool)


def _judges(
    board: BoardSpec,
    judging: ReasonEvaluation,
    sequence: BoardSequence,
    states: np.ndarray,
    judged: np.ndarray,
    proposed: Proposed | None,
) -> dict[str, StateReadout]:
    """Judges of a board by name."""
    encoder = reasoner_of(judging.model, judging.config).encoder
    clusters = clusters_of(sequence.features, threshold_of(encoder, sequence.features))
    if proposed is not None:
        return {NEAREST: PlacedStates(proposed, sequence.features, clusters, states)}
    judges: dict[str, StateReadout] = {NEAREST: NearestState(sequence.features, clusters, states, judged)}
    if judging.decoders is not None and judging.library is not None:
        shown = appearances(board, judging.library, states)
        judges[DECODED] = DecodedState(judging.decoders, board, shown, judged)
    return judges


def _judge_file(
    task: tuple[int, Path], judgings: Sequence[ReasonEvaluation], features: Mapping[str, FeaturesOf]
) -> list[JudgedGraph]:
    (index, path), judged = task, []
    with naming(path):
        recording = _Recording(read_episode(path, "lazy"), judgings[0])
        for judging in judgings:
            known = features.get(_encoder_of(judging) or "")
            judged.append(recording.judge(judging, None if known is None else known[index]))
    return judged


def evaluate_dataset(
    dataset: Dataset,
    judging: ReasonEvaluation | None = None,
    training: Dataset | None = None,
    assets: str | None = None,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
    each: Callable[[Path, JudgedGraph], object] | None = None,
) -> dict[str, Any]:
    """Evaluate on every finished episode; JSON values, see `summary`, with the dataset's origin and hashes.

    Args:
        training: train decoders on this dataset, for the second judge of predictions.
        assets: the objects of both datasets, if they are not found by their hashes; decoders need them, and all
            worlds but the paper's.
        seed: of the bootstrap.
        workers: processes; None for one per core, as far as there are boards enough to pay for starting them.
        each: is told every judged board with its episode's file.

    Raises:
        BusybotError: no episode is finished, one is damaged, or there is no such model.
    """
    told = None if each is None else lambda file, judged: each(file, judged[0])
    asked = [judging or ReasonEvaluation()]
    return evaluate_models(dataset, asked, training, assets, seed, workers, progress, told)[0]


def evaluate_models(
    dataset: Dataset,
    judgings: Sequence[ReasonEvaluation],
    training: Dataset | None = None,
    assets: str | None = None,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
    each: Callable[[Path, Sequence[JudgedGraph]], object] | None = None,
) -> list[dict[str, Any]]:
    """Evaluate several models, each as `evaluate_dataset` does alone; what does not depend on them is found out once.

    Objects that are proposed, instead of given, are looked at for each model.

    Args:
        judgings: at least one, alike in all but models and their parameters.
        each: is told every board, as each model is judged on it, with its episode's file.

    Raises:
        ValueError: they are not alike.
    """
    package_versions()  # of what judges, whatever changes meanwhile
    for judging in judgings:
        _check(judging, training)
        if replace(judging, model=judgings[0].model, config=judgings[0].config) != judgings[0]:
            raise ValueError("models that are judged together are judged alike")
    encoders = [_encoder_of(judging) for judging in judgings]
    indices = sorted(dataset.finished())
    if not indices:
        what = f"{dataset.path}: none of its {dataset.info.boards} boards has an episode"
        raise BusybotError(what, collect_command(dataset.path, dataset.info))
    for judging in judgings:
        if judging.given is not None:
            judging.given.check(dataset.info.boards)
    features: dict[str, FeaturesOf] = {}
    if judgings[0].boxes == GIVEN:
        features = {one: features_of(dataset, one, workers=workers) for one in dict.fromkeys(encoders) if one}
    judgings = _prepared(judgings, dataset, training, assets, workers)
    judged: list[list[JudgedGraph]] = [[] for _ in judgings]
    processes = workers or min(default_workers(), 1 + len(indices) // BOARDS_PER_WORKER)
    tasks = [(index, dataset.episode_path(index)) for index in indices]
    work = partial(_judge_file, judgings=judgings, features=features)
    with _one_thread():
        for done, ((_, file), board) in enumerate(zip(tasks, share(work, tasks, processes), strict=True), start=1):
            for own, one in zip(judged, board, strict=True):
                own.append(one)
            if each is not None:
                each(file, board)
            if progress is not None:
                progress(done, len(indices))
    sets = [origin(one) for one in (dataset, training) if one is not None]
    results = [_result(*one, sets, seed) for one in zip(judgings, judged, strict=True)]
    return [{**one, "logged": log_judgement(dataset, indices, str(one["model"]), one)} for one in results]


def _one_thread() -> AbstractContextManager[None]:
    """PyTorch computes here as in a worker: networks so small gain nothing from more threads, which wait in a loop."""
    if "torch" not in sys.modules:  # whoever judges does without
        return nullcontext()
    from busybot.training.device import threads

    return threads(1)


def _prepared(
    judgings: Sequence[ReasonEvaluation],
    dataset: Dataset,
    training: Dataset | None,
    assets: str | None,
    workers: int | None,
) -> list[ReasonEvaluation]:
    """With decoders, which are trained once for each encoder, and with the objects, as far as they are needed."""
    decoders: dict[str, dict[str, Linear]] = {}
    if training is not None:
        for encoder in {_encoder_of(judging) for judging in judgings} - {None}:
            learnt = features_of(training, str(encoder), workers=workers)
            decoders[str(encoder)] = train_decoders(training, learnt, library_of(training, assets))
    prepared = [replace(one, decoders=decoders.get(_encoder_of(one) or "", one.decoders)) for one in judgings]
    needed = any(one.decoders is not None for one in prepared)
    if needed or any(board.world != PAPER for board in dataset.boards()):
        library = library_of(dataset, assets)
        prepared = [replace(one, library=library) for one in prepared]
    return prepared


def _result(
    judging: ReasonEvaluation, judged: list[JudgedGraph], sets: Sequence[dict[str, Any]], seed: int
) -> dict[str, Any]:
    """One model's. `sets` are origins of the dataset, and of that on which decoders were trained, if there is one."""
    models = _model_hashes(judging.model) if judging.given is None else judging.given.hashes
    return {
        **stamp("reason", hashes={"models": models, "data": _hashes_of(sets)}),
        **_summarised(judged, judging, seed),
        "images_used": 1 + max(one.steps for one in judged),
        "config": {} if judging.given is not None else _config_of(judging).model_dump(mode="json"),
        "encoder": _encoder_of(judging),
        "dataset": sets[0],
        "trained_on_dataset": _trained_on(judging, sets[0]),
        "decoders": sets[1] if len(sets) > 1 else None,
    }


def _config_of(judging: ReasonEvaluation) -> BaseModel:
    return judging.config or config_class(judging.model)()


def _encoder_of(judging: ReasonEvaluation) -> str | None:
    """Of what predicts; a graph alone needs no features."""
    alone = judging.given is not None or judging.model in GRAPHS
    return None if alone else reasoner_of(judging.model, judging.config).encoder


def _summarised(judged: list[JudgedGraph], judging: ReasonEvaluation, seed: int) -> dict[str, Any]:
    """All metrics; a graph from a file says nothing of earlier actions."""
    told, given = summarise(judged, judging.images, seed), judging.given is not None
    earlier: dict[str, Any] = {"discovery": [], "actions_until_found": None, "uncertain_by_images": [], "by_images": []}
    return {**told, **(earlier if given else {}), "given": given}


def _check(judging: ReasonEvaluation, training: Dataset | None) -> None:
    if judging.images < 2:
        raise BusybotError(f"{judging.images} images show no action", "take at least 2")
    if judging.boxes not in BOXES:
        raise UsageError(f"boxes are {' or '.join(BOXES)}, not {judging.boxes!r}", "choose one of them")
    if judging.boxes == PROPOSED and judging.given is not None:
        raise UsageError("a graph from a file says itself which objects it means", "leave --boxes out")
    if judging.boxes == PROPOSED and training is not None:
        raise UsageError(
            "decoders read objects by category, which nobody knows of proposed ones", "leave --decoders out"
        )


def _trained_on(judging: ReasonEvaluation, judged: dict[str, Any]) -> bool:
    """Whether the model's card names these boards among those that it was trained on, or more or fewer of one drawing:
    a dataset that grows keeps its boards."""
    if judging.given is not None or not _is_trained(judging.model):
        return False
    card = read_info(find_folder(judging.model, "reason"), ReasonerInfo)
    known = {one.get(key) for one in card.training.get("data", []) for key in ("board_hash", "drawing")} - {None}
    return not known.isdisjoint((judged["board_hash"], judged["drawing"]))


def _is_trained(model: str) -> bool:
    return model not in GRAPHS and model not in without_training()


def _model_hashes(model: str) -> dict[str, dict[str, str]]:
    """Of the files of a trained model."""
    if not _is_trained(model):
        return {}
    folder = find_folder(model, "reason")
    return {folder.name: file_hashes(folder)}


def _hashes_of(sets: Sequence[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """By name; that on which decoders were trained may have the same as the one that is judged."""
    whose = ("", "decoders: ")
    return {
        f"{who}{told['name']} ({told['split']})": {key: told[key] for key in told if key.endswith("_hash")}
        for who, told in zip(whose, sets, strict=False)
    }


def origin(dataset: Dataset) -> dict[str, Any]:
    """Which episodes a result is about."""
    return {**origin_of(dataset), "boards": dataset.info.boards, "trace_hash": dataset.hashes().trace}
