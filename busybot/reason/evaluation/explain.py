"""One episode step by step as a reasoner takes it, beside what happened: for people who look at it.

What it believes after each step, and what it had expected of the step: predicted from the true current features with
what was observed until then, at most the first 23 images as in the paper. Expectations are read as states by the
primary judge of `judge`; where a recording does not know states, clusters of looks stand in for them.
"""

from dataclasses import dataclass

import numpy as np

from busybot.episodes.episode import Episode
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.evaluation.ground_truth import states_of
from busybot.reason.evaluation.state_readout import NearestState, judged_objects
from busybot.reason.inputs.observation import observe_episode
from busybot.reason.inputs.sequence import sequence_of
from busybot.reason.inputs.state_clusters import clusters_of, threshold_of
from busybot.reason.models.base import InferredGraph, Reasoner
from busybot.reason.models.registry import GRAPHS, infer, reasoner_of


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


def inferred_over_time(episode: Episode, model: str, images: int = 23) -> InferredGraph:
    """What controls what, after each step of an episode, in the eyes of a model by its name or folder.

    Raises:
        BusybotError: there is no such model, or its features cannot be computed.
    """
    observed = observe_episode(episode).first(images)
    if model in GRAPHS:
        return infer(observed, model)
    reasoner = reasoner_of(model)
    return reasoner.graph(sequence_of(observed, make_extractor(reasoner.encoder).of(observed)))


def explain(episode: Episode, reasoner: Reasoner, images: int = 23) -> Explanation:
    """Go through an episode.

    Args:
        images: what is observed later teaches nothing more.

    Raises:
        BusybotError: the features of the reasoner cannot be computed.
    """
    observed = observe_episode(episode)
    sequence = sequence_of(observed, make_extractor(reasoner.encoder).of_episode(episode))
    features, judged, truth = sequence.features, judged_objects(observed), states_of(episode)
    clusters = clusters_of(features, threshold_of(reasoner.encoder))
    states = clusters if truth is None else truth.states
    judge = NearestState(features, clusters, states, judged)
    expected = np.full((sequence.steps, len(judged)), -1)
    for step in range(sequence.steps):
        now = slice(step, step + 1)
        seen = sequence.first(min(step + 1, images))
        looks = reasoner.predict(seen, features[now], sequence.actions[now], sequence.acted[now])
        expected[step] = judge.read(looks)[0]
    return Explanation(reasoner.graph(sequence.first(images)), states, expected, judged, truth is not None)
