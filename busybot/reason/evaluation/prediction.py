"""The predicted steps of one board beside what happened (Pred-A); for evaluators only.

For figures (`judge_prediction`) a graph is inferred from the first images, and each later step is predicted by itself,
from its true current features.

For people who look at an episode (`explain`) it is gone through step by step: what a reasoner believes after each step,
and what it had expected of it with what was observed until then, at most the first 23 images as in the paper. The
primary judge reads expectations as states; where a recording does not know states, clusters of looks stand in for them.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from busybot.episodes.episode import Episode
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.evaluation.decoders import NearestState, StateReadout, judged_objects
from busybot.reason.evaluation.ground_truth import StateTruth, determined, states_of
from busybot.reason.inputs.observation import ObservedEpisode, acted_objects, observe_episode
from busybot.reason.inputs.sequence import BoardSequence, clusters_of, sequence_of, threshold_of
from busybot.reason.models.base import InferredGraph, Reasoner
from busybot.reason.models.registry import GRAPHS, infer, reasoner_of

NEAREST, DECODED = "nearest", "decoded"
PERSISTENCE, BOUND, BOUND_KNOWING = "persistence", "bound", "bound_knowing"


@dataclass(frozen=True)
class JudgedPrediction:
    """What was predicted, and whether it came true. S predicted steps of T, N objects.

    Attributes:
        changed: bool (S, N), whether the true state changed.
        judged: bool (N,), responders whose prediction counts.
        successful: bool (S,), whether the step's action changed a trigger's state.
        held: int (S,), the trigger that was held, -1 for none.
        kinds: S times the kinds of the relations that read the held link.
        right: bool (S, N) by name: the reasoner's predictions by the judges `NEAREST` and `DECODED`, and `PERSISTENCE`
            (by `NEAREST`), `BOUND` and `BOUND_KNOWING`.
        reads: bool (T + 1, N) by judge: whether it reads the true features rightly.
        by_images: number of observed images to `right`, with `NEAREST` and `BOUND`.
    """

    changed: np.ndarray
    judged: np.ndarray
    successful: np.ndarray
    held: np.ndarray
    kinds: tuple[tuple[str, ...], ...]
    right: dict[str, np.ndarray]
    reads: dict[str, np.ndarray]
    by_images: dict[int, dict[str, np.ndarray]]


@dataclass(frozen=True)
class EvaluatedBoard:
    """A board as evaluators have it. T steps, N objects.

    Attributes:
        truth: what happened.
        observed: what reasoners may read.
        judged: bool (N,), responders that show in the first frame.
        sequence: the same with features; None if there are none.
        judges: by name; empty without features.
    """

    truth: StateTruth
    observed: ObservedEpisode
    judged: np.ndarray
    sequence: BoardSequence | None
    judges: Mapping[str, StateReadout]
    _bounds: dict[tuple[int, int, bool], np.ndarray] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def bound(self, observed: int, start: int, knowing: bool = False) -> np.ndarray:
        """What the first `observed` steps determine of those from `start` on, bool (S, N), found out once."""
        asked = observed, start, knowing
        if asked not in self._bounds:
            contacts = np.array([action.position for action in self.observed.actions], float).reshape(-1, 3)
            acted = acted_objects(self.observed)
            self._bounds[asked] = determined(self.truth, contacts, acted, observed, knowing, start)
        return self._bounds[asked]


def judge_prediction(
    watched: EvaluatedBoard, reasoner: Reasoner | None, images: int, curve: Iterable[int] = ()
) -> JudgedPrediction:
    """Predict and judge every step after the first `images` images.

    Args:
        reasoner: None for one that predicts nothing; the bounds are there all the same.
        curve: judge the same steps after so many observed images, too; more than `images` are left out.
    """
    truth, start = watched.truth, images - 1
    right = {
        BOUND: watched.bound(start, start),
        BOUND_KNOWING: watched.bound(start, start, knowing=True),
    }
    by_images = {number: {BOUND: watched.bound(number - 1, start)} for number in curve if number <= images}
    reads: dict[str, np.ndarray] = {}
    if watched.sequence is not None:
        features = watched.sequence.features
        right[PERSISTENCE] = _judge(watched.judges[NEAREST], features[start:-1], start)
        reads = {name: np.asarray(judge.read(features) == judge.truth) for name, judge in watched.judges.items()}
    if watched.sequence is not None and reasoner is not None:
        predicted = _predict(reasoner, watched.sequence, images, start)
        right |= {name: _judge(judge, predicted, start) for name, judge in watched.judges.items()}
        for number, judged in by_images.items():
            features = predicted if number == images else _predict(reasoner, watched.sequence, number, start)
            judged[NEAREST] = _judge(watched.judges[NEAREST], features, start)
    return JudgedPrediction(
        changed=truth.states[start:-1] != truth.states[start + 1 :],
        judged=watched.judged,
        successful=truth.success[start:],
        held=truth.held[start:],
        kinds=truth.kinds[start:],
        right=right,
        reads=reads,
        by_images=by_images,
    )


def _predict(reasoner: Reasoner, sequence: BoardSequence, images: int, start: int) -> np.ndarray:
    """Features after the steps from `start` on, (S, N, C), knowing the first `images` images."""
    return reasoner.predict(
        sequence.first(images), sequence.features[start:-1], sequence.actions[start:], sequence.acted[start:]
    )


def _judge(judge: StateReadout, features: np.ndarray, start: int) -> np.ndarray:
    return np.asarray(judge.read(features) == judge.truth[start + 1 :])


@dataclass(frozen=True)
class Explanation:
    """Beliefs and expectations about T steps on a board of N objects.

    Attributes:
        graph: what is believed to control what.
        states: int (T + 1, N), what each object shows in each frame.
        expected: int (T, N), what was expected of it after each step.
        judged: bool (N,), objects of which something was expected.
        known: whether `states` are the true ones.
    """

    graph: InferredGraph
    states: np.ndarray
    expected: np.ndarray
    judged: np.ndarray
    known: bool

    def wrong(self, step: int) -> np.ndarray:
        """Indices of the objects that step `step` (from 0) left otherwise than expected."""
        return np.flatnonzero(self.judged & (self.expected[step] != self.states[step + 1]))

    def changed(self, step: int) -> np.ndarray:
        """Indices of the objects that changed in the step or were expected to."""
        before = self.states[step]
        return np.flatnonzero(self.judged & ((self.expected[step] != before) | (self.states[step + 1] != before)))


def inferred_over_time(episode: Episode, model: str, images: int | None = None) -> InferredGraph:
    """What controls what, after each step of an episode, in the eyes of a model by its name or folder.

    Args:
        images: of the first so many; of all by default.

    Raises:
        BusybotError: there is no such model, or its features cannot be computed.
    """
    observed = observe_episode(episode)
    observed = observed if images is None else observed.first(images)
    if model in GRAPHS:
        return infer(observed, model)
    reasoner = reasoner_of(model)
    return reasoner.graph(sequence_of(observed, make_extractor(reasoner.encoder).of(observed)))


def explain(episode: Episode, reasoner: Reasoner, images: int | None = None) -> Explanation:
    """Go through an episode.

    Args:
        images: what is observed after so many teaches nothing more; by default all of it does.

    Raises:
        BusybotError: the features of the reasoner cannot be computed.
    """
    observed = observe_episode(episode)
    sequence = sequence_of(observed, make_extractor(reasoner.encoder).of_episode(episode))
    features, truth = sequence.features, states_of(episode)
    images = sequence.steps + 1 if images is None else images
    clusters = clusters_of(features, threshold_of(reasoner.encoder, features))
    states = clusters if truth is None else truth.states
    judged = judged_objects(observed) & (states >= 0).all(axis=0)  # smaller boxes may cover a whole one
    judge = NearestState(features, clusters, states, judged)
    expected = np.full((sequence.steps, len(judged)), -1)
    for step in range(sequence.steps):
        now = slice(step, step + 1)
        seen = sequence.first(min(step + 1, images))
        looks = reasoner.predict(seen, features[now], sequence.actions[now], sequence.acted[now])
        expected[step] = judge.read(looks)[0]
    return Explanation(reasoner.graph(sequence.first(images)), states, expected, judged, truth is not None)
