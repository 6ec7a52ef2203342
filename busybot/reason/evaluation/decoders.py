"""Judges of features: they read the states that one board's objects show, beside the true ones; for evaluators only.

The primary judge (Pred-A) takes the nearest of the states that the same object showed on this
board. The other one uses decoders, trained on training boards only (the paper's authors pooled the test splits into the
training of theirs): one linear classifier for each category, doors and toys by their state, lamps by their colour or
off, because a lamp's state index means different colours on different lamps.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple, Protocol

import numpy as np

from busybot.boards.spec import BoardSpec
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.objects.library import Library
from busybot.reason.evaluation.ground_truth import states_of
from busybot.reason.inputs.observation import ObservedEpisode, observe_episode


class StateReadout(Protocol):
    """Reads features.

    Attributes:
        truth: (T + 1, N), what each object truly shows in each frame, in the judge's own terms.
    """

    truth: np.ndarray

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
        self.truth = states
        self._shown: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        for index in np.flatnonzero(judged):
            members = [clusters[:, index] == number for number in np.unique(clusters[:, index])]
            centres = [features[own, index].mean(axis=0) for own in members]
            commonest = [np.bincount(states[own, index]).argmax() for own in members]
            self._shown[int(index)] = (np.array(centres, np.float32), np.array(commonest))

    def read(self, features: np.ndarray) -> np.ndarray:
        """Features float (F, N, C) to states int (F, N), -1 for objects that are not judged."""
        found = np.full(features.shape[:2], -1)
        for index, (centres, states) in self._shown.items():
            apart = np.linalg.norm(features[:, index, None] - centres[None], axis=-1)
            found[:, index] = states[apart.argmin(axis=1)]
        return found


def judged_objects(observed: ObservedEpisode) -> np.ndarray:
    """The responders that show in the first frame, bool (N,): only of them can a picture be expected."""
    left, top, right, bottom = np.asarray(observed.boxes).reshape(-1, 4).T
    return np.asarray((np.array(observed.roles, str) == "responder") & (right > left) & (bottom > top))


BOARDS = 300
"""Decoders are trained on so many boards, the first ones."""
RIDGE = 1e-2
"""Weight of the penalty on the classifier's coefficients, in units of the number of examples."""
LEAST_SPREAD = 0.1
"""Channels that vary less than this share of the average one are not blown up to its size."""
NAMES = "U16"
"""Type of arrays of names of what is shown."""
UNKNOWN = ""
"""Of objects whose appearance has no name: triggers, categories without examples."""


class Examples(NamedTuple):
    """What objects of training boards look like.

    Attributes:
        features: float (M, C).
        categories: str (M,), of the objects.
        shown: str (M,), as `appearances` names it.
    """

    features: np.ndarray
    categories: np.ndarray
    shown: np.ndarray


def appearances(board: BoardSpec, library: Library, states: np.ndarray) -> np.ndarray:
    """Names of what responders show, str (F, N), from states int (F, N): "1", or for lamps "off" or "#ff00ff"."""
    stages = {relation.responder: relation.stage for relation in board.relations}
    names = np.full(states.shape, UNKNOWN, NAMES)
    for index, placed in enumerate(board.objects):
        effect = library.get(placed.key).effect
        if effect is None:
            continue
        stage = stages.get(index, "multi" if effect.single is None else "single")
        values = effect.multi if stage == "multi" else effect.single
        for state in np.unique(states[:, index]):
            name = str(state)
            if effect.type == "color" and values is not None and state < len(values):
                name = _color(values[state])
            names[states[:, index] == state, index] = name
    return names


def _color(rgb: tuple[float, ...]) -> str:
    red, green, blue = (round(255 * channel) for channel in rgb)
    return f"#{red:02x}{green:02x}{blue:02x}" if red or green or blue else "off"


def examples(board: BoardSpec, features: np.ndarray, shown: np.ndarray, judged: np.ndarray) -> Examples:
    """One example for everything that each judged object shows on a board: its mean feature over those frames.

    Args:
        features: float (F, N, C).
        shown: str (F, N) of `appearances`.
        judged: bool (N,).
    """
    rows, categories, names = [], [], []
    for index in np.flatnonzero(judged):
        for name in np.unique(shown[:, index]):
            rows.append(features[shown[:, index] == name, index].mean(axis=0))
            categories.append(board.objects[index].category)
            names.append(str(name))
    return Examples(np.array(rows).reshape(-1, features.shape[-1]), np.array(categories, "U64"), np.array(names, NAMES))


class Linear:
    """Standardised features times weights; the greatest score names the class.

    Fitted by regularised least squares onto the classes, each class with the same total weight.

    Args:
        features: float (M, C).
        shown: str (M,), the classes.
    """

    def __init__(self, features: np.ndarray, shown: np.ndarray):
        spread = features.std(axis=0)
        self._mean = features.mean(axis=0)
        self._spread = np.maximum(spread, max(LEAST_SPREAD * float(spread.mean()), 1e-9))
        self._classes, number, size = np.unique(shown, return_inverse=True, return_counts=True)
        inputs, weight = self._inputs(features), (1 / size)[number][:, None] / len(self._classes)
        targets = np.eye(len(self._classes))[number]
        penalty = RIDGE * np.eye(inputs.shape[1])
        penalty[-1, -1] = 0
        self._weights = np.linalg.solve(inputs.T @ (weight * inputs) + penalty, inputs.T @ (weight * targets))

    def read(self, features: np.ndarray) -> np.ndarray:
        """Features (M, C) to classes, str (M,)."""
        return np.asarray(self._classes[(self._inputs(features) @ self._weights).argmax(axis=1)])

    def _inputs(self, features: np.ndarray) -> np.ndarray:
        scaled = (features.astype(float) - self._mean) / self._spread
        return np.concatenate([scaled, np.ones((len(scaled), 1))], axis=1)


def fit_decoders(parts: Iterable[Examples]) -> dict[str, Linear]:
    """A decoder for each category of which there are examples, from many boards."""
    boards = list(parts)
    if not boards:
        return {}
    features, categories, shown = map(np.concatenate, zip(*boards, strict=True))
    return {
        str(category): Linear(features[categories == category], shown[categories == category])
        for category in np.unique(categories)
    }


def train_decoders(dataset: Dataset, features: Mapping[int, np.ndarray], library: Library) -> dict[str, Linear]:
    """Decoders from the first boards of a training dataset.

    Args:
        features: float (T + 1, N, C) by episode.
        library: with the dataset's objects.
    """
    parts = []
    for index in sorted(features)[:BOARDS]:
        episode = read_episode(dataset.episode_path(index), "lazy")
        truth = states_of(episode)
        if truth is not None:
            shown = appearances(episode.board, library, truth.states)
            parts.append(examples(episode.board, features[index], shown, judged_objects(observe_episode(episode))))
    return fit_decoders(parts)


class DecodedState:
    """A judge that reads each object by the decoder of its category."""

    def __init__(self, decoders: dict[str, Linear], board: BoardSpec, shown: np.ndarray, judged: np.ndarray):
        """`shown` is str (T + 1, N) of `appearances`, `judged` bool (N,)."""
        self.truth = shown
        self._of = {int(i): decoders.get(board.objects[i].category) for i in np.flatnonzero(judged)}

    def read(self, features: np.ndarray) -> np.ndarray:
        """Features float (F, N, C) to names, str (F, N); `UNKNOWN` where there is no decoder."""
        found = np.full(features.shape[:2], UNKNOWN, NAMES)
        for index, decoder in self._of.items():
            if decoder is not None:
                found[:, index] = decoder.read(features[:, index])
        return found
