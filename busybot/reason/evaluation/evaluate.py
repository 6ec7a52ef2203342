"""`busybot eval reason`: infer the graphs of a dataset's boards, predict what follows, compare both with the truth.

The graph is inferred from the first 23 images, as in the paper; each later step is predicted from its true current
features (protocol "Reasoning"). Models see what `observed` lets through; the truth is read here, after it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from busybot.boards.spec import PAPER, BoardSpec
from busybot.boards.task import affectable
from busybot.common.errors import BusybotError, UsageError
from busybot.common.process_pool import Progress, default_workers, share
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import collect_command
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.judgements import log_judgement
from busybot.evaluation.results import stamp
from busybot.objects.library import Library
from busybot.reason.evaluation.causes import ACTIONS, Watched, judge_causes
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
from busybot.reason.inputs.observation import ObservedEpisode, acted_objects, observe_episode
from busybot.reason.inputs.sequence import BoardSequence, actions_of, clusters_of, sequence_of, threshold_of
from busybot.reason.models.base import InferredGraph, Reasoner
from busybot.reason.models.registry import GRAPHS, config_class, infer, reasoner_of, without_training
from busybot.training.model_cards import file_hashes, find_folder

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
        model: of `infer`, by name or folder.
        images: observed ones.
        config: parameters of the model; None for its defaults.
        decoders: by category, for the second judge; None to do without it.
        library: the boards' objects; needed with decoders, which name their appearance, and in all worlds but the
            paper's.
        given: graphs that somebody else inferred, to be judged in place of the model's.
        boxes: of `BOXES`: whether the model is given the true objects, or has to do with proposed ones (`proposed`).
        curve: numbers of observed images after which predictions are judged, beside `images`.
        told: whether the model is told in which world the board was drawn.
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


def judge_episode(
    episode: Episode, judging: ReasonEvaluation | None = None, features: np.ndarray | None = None
) -> JudgedGraph:
    """Infer the board's graph from the first images, predict what follows, and put the truth beside both.

    Args:
        features: float (T + 1, N, 256) of the model's encoder; what infers a graph alone needs none.
    """
    judging = judging or ReasonEvaluation()
    observed, truth = observe_episode(episode, again=True), states_of(episode)
    observed = observed if judging.told else replace(observed, world="")
    judged, predicted = judged_objects(observed), None
    proposed = propose_objects(observed, judging.images) if judging.boxes == PROPOSED else None
    told = _told(episode, observed, judging, features, proposed)
    graph, longer, reasoner, sequence = told.graph, told.longer, told.reasoner, told.sequence
    actions, acted, spurious = actions_of(observed), acted_objects(observed), None
    if proposed is not None:
        acted, spurious = proposed.acted, proposed.spurious(longer, min(len(episode.steps), ACTIONS))
        graph, longer = proposed.true_part(graph), proposed.true_part(longer)
    judges: dict[str, StateReadout] = {}
    if sequence is not None and truth is not None:
        judges = _judges(episode.board, judging, sequence, truth.states, judged, proposed)
    if truth is not None and len(truth.links) >= judging.images:
        watched = EvaluatedBoard(truth, observed, judged & _controlled(episode.board), sequence, judges)
        predicted = judge_prediction(watched, reasoner, judging.images, (*judging.curve, judging.images))
    read = judges.get(NEAREST)
    causes = None
    recorded = Watched(episode, actions, acted, judged, judging.images, judging.library, sequence, reasoner, read)
    if episode.board.relations_known:
        causes = judge_causes(recorded, replace(longer, kinds=graph.kinds, lags=graph.lags))
        causes = replace(causes, spurious=spurious)
    return JudgedGraph(
        episode.board,
        graph,
        truth_of(episode),
        steps=min(judging.images - 1, len(episode.steps)),
        policy=episode.policy,
        oracle=episode.oracle,
        forecast=predicted,
        causes=causes,
        proposals=None if proposed is None else proposed.judged,
        spurious=None if spurious is None else spurious[:, 0],
    )


@dataclass(frozen=True)
class _Told:
    """What a model says of a board: a graph of the observed images and one that follows it on; who predicts, and with
    what; None for what infers a graph alone. With proposed objects all of it is at their places."""

    graph: InferredGraph
    longer: InferredGraph
    reasoner: Reasoner | None = None
    sequence: BoardSequence | None = None


def _told(
    episode: Episode,
    observed: ObservedEpisode,
    judging: ReasonEvaluation,
    features: np.ndarray | None,
    proposed: Proposed | None,
) -> _Told:
    if judging.given is not None:
        graph = judging.given.of(episode)
        return _Told(graph, graph)
    if judging.model in GRAPHS or (features is None and proposed is None):
        seen = observed if proposed is None else proposed.observed
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
        sequence = sequence_of(observed, features)
    graph = longer = reasoner.graph(sequence.first(judging.images))
    if judging.images <= min(ACTIONS, sequence.steps):
        longer = reasoner.graph(sequence.first(ACTIONS + 1))
    return _Told(graph, longer, reasoner, sequence)


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


def _judge_file(task: tuple[int, Path], judging: ReasonEvaluation, features: FeaturesOf | None) -> JudgedGraph:
    index, path = task
    return judge_episode(read_episode(path, "lazy"), judging, None if features is None else features[index])


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
    judging = judging or ReasonEvaluation()
    if judging.images < 2:
        raise BusybotError(f"{judging.images} images show no action", "take at least 2")
    _check_boxes(judging, training)
    encoder = _encoder_of(judging)
    indices = sorted(dataset.finished())
    if not indices:
        what = f"{dataset.path}: none of its {dataset.info.boards} boards has an episode"
        raise BusybotError(what, collect_command(dataset.path, dataset.info))
    sets = {one.path: origin(one) for one in (dataset, training) if one is not None}
    features = features_of(dataset, encoder, workers=workers) if encoder and judging.boxes == GIVEN else None
    if training is not None and encoder is not None:
        learnt = features_of(training, encoder, workers=workers)
        trained = train_decoders(training, learnt, library_of(training, assets))
        judging = replace(judging, decoders=trained)
    if judging.decoders is not None or any(board.world != PAPER for board in dataset.boards()):
        judging = replace(judging, library=library_of(dataset, assets))
    judged: list[JudgedGraph] = []
    processes = workers or min(default_workers(), 1 + len(indices) // BOARDS_PER_WORKER)
    tasks = [(index, dataset.episode_path(index)) for index in indices]
    for one in share(partial(_judge_file, judging=judging, features=features), tasks, processes):
        judged.append(one)
        if each is not None:
            each(tasks[len(judged) - 1][1], one)
        if progress is not None:
            progress(len(judged), len(indices))
    models = _model_hashes(judging.model) if judging.given is None else judging.given.hashes
    result = {
        **stamp("reason", hashes={"models": models, "data": dict(map(_hashes, sets.values()))}),
        **_summarised(judged, judging, seed),
        "images_used": 1 + max(one.steps for one in judged),
        "config": (judging.config or config_class(judging.model)()).model_dump(mode="json"),
        "encoder": encoder,
        "dataset": sets[dataset.path],
        "decoders": None if training is None else sets[training.path],
    }
    return {**result, "logged": log_judgement(dataset, indices, str(result["model"]), result)}


def _encoder_of(judging: ReasonEvaluation) -> str | None:
    """Of what predicts; a graph alone needs no features."""
    alone = judging.given is not None or judging.model in GRAPHS
    return None if alone else reasoner_of(judging.model, judging.config).encoder


def _summarised(judged: list[JudgedGraph], judging: ReasonEvaluation, seed: int) -> dict[str, Any]:
    """All metrics; a graph from a file says nothing of earlier actions."""
    earlier: dict[str, Any] = {} if judging.given is None else {"discovery": [], "actions_until_found": None}
    return {**summarise(judged, judging.images, seed), **earlier, "given": judging.given is not None}


def _check_boxes(judging: ReasonEvaluation, training: Dataset | None) -> None:
    if judging.boxes not in BOXES:
        raise UsageError(f"boxes are {' or '.join(BOXES)}, not {judging.boxes!r}", "choose one of them")
    if judging.boxes == PROPOSED and judging.given is not None:
        raise UsageError("a graph from a file says itself which objects it means", "leave --boxes out")
    if judging.boxes == PROPOSED and training is not None:
        raise UsageError(
            "decoders read objects by category, which nobody knows of proposed ones", "leave --decoders out"
        )


def _model_hashes(model: str) -> dict[str, dict[str, str]]:
    """Of the files of a trained model."""
    if model in GRAPHS or model in without_training():
        return {}
    folder = find_folder(model, "reason")
    return {folder.name: file_hashes(folder)}


def _hashes(told: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    return f"{told['name']} ({told['split']})", {key: told[key] for key in told if key.endswith("_hash")}


def origin(dataset: Dataset) -> dict[str, Any]:
    """Which episodes a result is about."""
    hashes = dataset.hashes()
    return {
        "name": dataset.info.name,
        "split": dataset.info.split,
        "boards": dataset.info.boards,
        "episodes": len(dataset.finished()),
        "board_hash": hashes.board,
        "trace_hash": hashes.trace,
        "content_hash": hashes.content,
    }
