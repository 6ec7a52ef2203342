"""Reads the state that a predicted feature shows (protocol "Reasoning", Pred-A); for evaluators only.

Judges read features of one board's objects into states and hold what they should read. The primary judge takes the
nearest of the states that the same object showed on this board. The other one uses decoders, see `decoders`.
"""

from typing import Protocol

import numpy as np

from busybot.reason.inputs.observation import ObservedEpisode


class StateReadout(Protocol):
    """Reads features.

    Attributes:
        truth: (T + 1, N), what each object truly shows in each frame, in the judge's own terms.
        judged: bool (N,), the objects that it reads.
    """

    truth: np.ndarray
    judged: np.ndarray

    def read(self, features: np.ndarray) -> np.ndarray:
        """Features float (F, N, C) to what they show, (F, N)."""
        ...


class NearestState:
    """The nearest of the states that the same object showed on this board.

    The states are label-free clusters of the object's true features over all frames. Evaluator code alone knows which
    true state a cluster shows most often.
    """

    def __init__(self, features: np.ndarray, clusters: np.ndarray, states: np.ndarray, judged: np.ndarray):
        """Compare clusters with the truth.

        Args:
            features: float (T + 1, N, C), true features.
            clusters: int (T + 1, N), cluster of each object in each frame, numbered from 0 for each object.
            states: int (T + 1, N), true states.
            judged: bool (N,).
        """
        self.truth, self.judged = states, judged
        self._shown: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        for index in np.flatnonzero(judged):
            members = [clusters[:, index] == number for number in np.unique(clusters[:, index])]
            centres = [features[own, index].mean(axis=0) for own in members]
            commonest = [_commonest(states[own, index]) for own in members]
            self._shown[int(index)] = (np.array(centres, np.float32), np.array(commonest))

    def read(self, features: np.ndarray) -> np.ndarray:
        """Features float (F, N, C) to states int (F, N), -1 for objects that are not judged."""
        found = np.full(features.shape[:2], -1)
        for index, (centres, states) in self._shown.items():
            apart = np.linalg.norm(features[:, index, None] - centres[None], axis=-1)
            found[:, index] = states[apart.argmin(axis=1)]
        return found


def _commonest(values: np.ndarray) -> int:
    found, times = np.unique(values, return_counts=True)
    return int(found[times.argmax()])


def judged_objects(observed: ObservedEpisode) -> np.ndarray:
    """The responders that show in the first frame, bool (N,): only of them can a picture be expected."""
    left, top, right, bottom = np.asarray(observed.boxes).reshape(-1, 4).T
    return np.array([role == "responder" for role in observed.roles], bool) & (right > left) & (bottom > top)
