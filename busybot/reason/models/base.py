"""The interface of reasoners: the graph that they infer and the predictions that they make.

What a reasoner says about one episode, as plain data: metrics, tables and pictures read it alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from busybot.reason.inputs.sequence import BoardSequence


@dataclass(frozen=True)
class InferredLinks:
    """Which link controls which object, of a model that tells a trigger's links apart: a link is a cluster of contacts.

    Attributes:
        clusters: int (T,), the link that each of T actions took hold of, numbered from 0; -1 for none.
        probabilities: float (T, K, N), after each step, that link k controls object j.
    """

    clusters: np.ndarray
    probabilities: np.ndarray

    def after(self, steps: int) -> np.ndarray:
        """Probabilities (K, N) after so many steps, 0 before the first and where there was none."""
        if steps <= 0 or not len(self.probabilities):
            return np.zeros(self.probabilities.shape[1:])
        return self.probabilities[min(steps, len(self.probabilities)) - 1]


@dataclass(frozen=True)
class ParentSet:
    """Inputs that decide an object together, and how probable it is that these do and no others.

    Attributes:
        links: their clusters, as of `InferredLinks`, rising.
        objects: numbers of responders among them, rising.
    """

    links: tuple[int, ...]
    objects: tuple[int, ...]
    probability: float


@dataclass(frozen=True)
class InferredGraph:
    """Which object controls which, as believed after each step.

    Attributes:
        name: of the reasoner, e.g. "count".
        probabilities: float (T, N, N), T >= 1 steps, N objects; `[t, i, j]` is the probability, after step t (from 0),
            that object i controls object j (a responder); i is a trigger, or a responder where the model can say so.
            What is believed after step T - 1 stays.
        threshold: an edge is claimed when its probability exceeds this, also one of a link.
        prior: float (N, N), what is believed before the first step; zeros if None.
        links: the same of single links; None where the model does not tell them apart.
        kinds: at the end, the kind of the mechanism that decides each object (`boards.mechanisms`), "" for nothing;
            None where the model does not tell kinds.
        lags: int (N,), at the end, after how many actions an input of each object shows at the earliest, -1 where
            there is none; None where the model does not tell lags.
        words: at the end, what decides each object, for people, with "object 3" for names; "" for what is no responder;
            None where the model has no words.
        parent_sets: at the end, of each object the likeliest sets of inputs, the likeliest first; none for what is no
            responder. They count links that moved, and no others. None where the model tells pairs alone.
        changed: float (T, N), after each step the probability that another mechanism decides each object than at the
            start, and stays so; 0 for what is no responder. None where the model does not tell.
        changed_at: int (N,), at the end, the number of the step (from 0) after which the new mechanism is believed to
            decide, as `Rewiring.step`; -1 where none is. None with `changed`.
    """

    name: str
    probabilities: np.ndarray
    threshold: float = 0.5
    prior: np.ndarray | None = None
    links: InferredLinks | None = None
    kinds: tuple[str, ...] | None = None
    lags: np.ndarray | None = None
    words: tuple[str, ...] | None = None
    parent_sets: tuple[tuple[ParentSet, ...], ...] | None = None
    changed: np.ndarray | None = None
    changed_at: np.ndarray | None = None

    def after(self, steps: int) -> np.ndarray:
        """Probabilities (N, N) after so many steps; the prior before the first."""
        if steps <= 0:
            return np.zeros(self.probabilities.shape[1:]) if self.prior is None else self.prior
        return self.probabilities[min(steps, len(self.probabilities)) - 1]

    def claimed(self, steps: int) -> np.ndarray:
        """Edges claimed after so many steps, bool (N, N)."""
        return np.asarray(self.after(steps) > self.threshold)


class Reasoner(Protocol):
    """Infers which trigger controls which responder and predicts what an action changes. N objects.

    Attributes:
        name: for tables.
        encoder: which features it reads (`busybot features --encoder`).
    """

    name: str
    encoder: str

    def graph(self, seen: BoardSequence) -> InferredGraph:
        """Edge probabilities after each of the T steps of `seen`; one entry, the prior, if there is none."""
        ...

    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Features after each of S steps that are not part of what was seen; every step is judged on its own.

        Args:
            seen: the observed part of the episode (23 images in the paper).
            current: float32 (S, N, 256), true features before each step.
            actions: float32 (S, 6), position (board frame, board units) and direction.
            acted: int (S,), index of the trigger acted on, -1 for none.

        Returns:
            float32 (S, N, 256).
        """
        ...


@runtime_checkable
class Imagining(Protocol):
    """What a reasoner may have beside: answers to "what if", of which it may remember more than a picture shows.

    Evaluators ask a reasoner that has none by its own predictions, one after the other (`imagine`).
    """

    def what_if(self, seen: BoardSequence, steps: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Features after each of K actions in a row, which are done instead of what was done then; Q questions.

        Args:
            seen: all that was observed, also after the steps that are asked about: it tells how the board works.
            steps: int (Q,), how many of the observed actions come before, 0 to T.
            actions: float32 (Q, K, 6), as of `BoardSequence`; zeros where nothing is done.
            acted: int (Q, K), index of the trigger acted on, -1 for none.

        Returns:
            float32 (Q, K, N, 256).
        """
        ...


@runtime_checkable
class Brief(Protocol):
    """What a reasoner may have beside: what it believes at the end, where all that it believed before would be dear."""

    def graph_at_the_end(self, seen: BoardSequence) -> InferredGraph:
        """As `Reasoner.graph`, with what is believed after the last step for its one entry."""
        ...


def believed(reasoner: Reasoner, seen: BoardSequence) -> InferredGraph:
    """What a reasoner believes after the last step; what it has to say of earlier ones may be missing."""
    return reasoner.graph_at_the_end(seen) if isinstance(reasoner, Brief) else reasoner.graph(seen)


@runtime_checkable
class Curious(Protocol):
    """What a reasoner may have beside: how much it would learn from an action."""

    def expected_information(self, seen: BoardSequence, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Of each of S actions, one of which may be done next, if what it pushes goes that way, in nats, float (S,);
        arguments as of `predict`."""
        ...

    def released(
        self,
        seen: BoardSequence,
        tries: Sequence[Sequence[int]],
        actions: np.ndarray | None = None,
        acted: np.ndarray | None = None,
    ) -> np.ndarray:
        """How probable it is that each of F things may move now, if it could not because of how something else looked
        when it was tried, by the actions named, from 0; float (F,). Or after each of S actions, one of which may be
        done next, arguments as of `predict`; float (S, F)."""
        ...

    def yields(self, seen: BoardSequence, tries: Sequence[Sequence[tuple[int, bool, bool]]]) -> np.ndarray:
        """How probable it is that each of K links that were seen moving moves now; as a share of what is expected of
        one that nothing can hold; float (K,).

        Args:
            tries: of each link the actions that took hold of it, from 0, whether each moved it, and whether it is known
                that it moves if pushed like that.
        """
        ...

    def certainty(self, seen: BoardSequence) -> float:
        """The probability, 0 to 1, that the likeliest parents are the right ones, of the least sure responder."""
        ...


def imagine(
    reasoner: Reasoner, seen: BoardSequence, steps: np.ndarray, actions: np.ndarray, acted: np.ndarray
) -> np.ndarray:
    """A reasoner's answers, arguments and result as of `Imagining.what_if`; without it each prediction begins with the
    one before, the first with the features that were observed."""
    if isinstance(reasoner, Imagining):
        return reasoner.what_if(seen, steps, actions, acted)
    current, told = seen.features[steps], []
    for number in range(actions.shape[1]):
        current = reasoner.predict(seen, current, actions[:, number], acted[:, number])
        told.append(current)
    return np.stack(told, axis=1)
