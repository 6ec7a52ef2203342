"""What a recording shows of a board's links and of its responders' states, without labels.

A *link* is a cluster of contacts on one trigger. Its state follows from the direction of the last action that worked,
along the direction of the first one: a link of two states that was moved forwards is in the second, whatever was missed
before. One that moves the same way twice in a row, again and again, has three, and counts steps. Actions after which
everything looks as before did not work. A responder's states are clusters of its looks, numbered as they appear.

Pictures do not tell which of a link's ends is "on"; `contexts` does not ask.
"""

from dataclasses import dataclass

import numpy as np

from busybot.reason.inputs.sequence import BoardSequence, clusters_of, threshold_of
from busybot.reason.models.mechanism.contexts import STATES, Trace

AGAIN = 0.25
"""A link has three states when so large a share of its moves goes the same way as the one before, and at least two."""


@dataclass(frozen=True)
class Perceived:
    """A recording as a trace. T actions, L links, R responders.

    Attributes:
        clusters: int (T,), the link that each action took hold of, -1 for none.
        owners: int (L,), the object of each link.
        axes: float (L, 3), the direction that counts as forwards.
        places: float (L, 2), mean contact, board units.
        responders: int (R,), their objects.
        looks: for each responder the mean feature of each of its states, float32 (S, 256).
    """

    trace: Trace
    clusters: np.ndarray
    owners: np.ndarray
    axes: np.ndarray
    places: np.ndarray
    responders: np.ndarray
    looks: tuple[np.ndarray, ...]

    def link_at(self, action: np.ndarray, acted: int) -> int:
        """The link that an action takes hold of: the nearest one of the trigger, -1 if none is known."""
        own = np.flatnonzero(self.owners == acted)
        if not len(own):
            return -1
        return int(own[np.linalg.norm(self.places[own] - action[:2], axis=1).argmin()])

    def moved(self, links: np.ndarray, action: np.ndarray, acted: int) -> np.ndarray:
        """States of the links after an action, if it works; int (L,)."""
        link, after = self.link_at(action, acted), links.copy()
        if link >= 0:
            forwards = float(action[3:] @ self.axes[link]) >= 0
            step = after[link] + (1 if forwards else -1)
            after[link] = int(forwards) if self.trace.sizes[link] == 2 else np.clip(step, 0, STATES - 1)
        return after

    def states_of(self, looks: np.ndarray) -> np.ndarray:
        """The responders' states that objects' features (N, 256) are nearest to, int (R,)."""
        pairs = zip(self.responders, self.looks, strict=True)
        return np.array([np.linalg.norm(known - looks[index], axis=1).argmin() for index, known in pairs], int)


def perceive(seen: BoardSequence, encoder: str, reach: float) -> Perceived:
    """Links and states of a recording.

    Args:
        encoder: of the features.
        reach: greatest mean distance of contacts of one link, board units.
    """
    clusters = contact_clusters(seen, reach)
    count, worked = int(clusters.max(initial=-1)) + 1, seen.anything_new
    links, sizes = np.zeros((seen.steps + 1, count), int), []
    owners, axes, places = np.zeros(count, int), np.zeros((count, 3)), np.zeros((count, 2))
    for link in range(count):
        own = np.flatnonzero(clusters == link)
        moves = own[worked[own]]
        owners[link], places[link] = seen.acted[own[0]], seen.actions[own, :2].mean(0)
        axes[link] = seen.actions[moves[0] if len(moves) else own[0], 3:]
        forwards = seen.actions[moves, 3:] @ axes[link] >= 0
        size, states = _states(forwards)
        sizes.append(size)
        steps = np.searchsorted(moves, np.arange(seen.steps + 1))  # moves before each moment
        links[:, link] = states[steps]
    responders = np.flatnonzero(seen.responders)
    shown = clusters_of(seen.features, threshold_of(encoder))[:, responders].clip(0, STATES - 1)
    looks = tuple(_looks(seen.features[:, index], states) for index, states in zip(responders, shown.T, strict=True))
    return Perceived(Trace(links, shown, tuple(sizes)), clusters, owners, axes, places, responders, looks)


def contact_clusters(seen: BoardSequence, reach: float) -> np.ndarray:
    """int (T,), the link that each action took hold of as far as contacts tell, -1 for none."""
    from scipy.cluster.hierarchy import fcluster, linkage

    found, count = np.full(seen.steps, -1), 0
    for trigger in np.flatnonzero(seen.triggers):
        own = np.flatnonzero(seen.acted == trigger)
        if len(own):
            places = seen.actions[own, :2]
            labels = fcluster(linkage(places, "average"), reach, "distance") if len(own) > 1 else np.ones(1, int)
            found[own] = count + labels - 1
            count += labels.max()
    return found


def _states(forwards: np.ndarray) -> tuple[int, np.ndarray]:
    """How many states a link has, and int (M + 1,), its state before and after each of M moves."""
    if not len(forwards):
        return 2, np.zeros(1, int)
    same = forwards[1:] == forwards[:-1]
    if same.sum() < 2 or same.mean() < AGAIN:
        return 2, np.concatenate([[1 - int(forwards[0])], forwards.astype(int)])
    steps = np.where(forwards, 1, -1)
    walks = []
    for start in range(STATES):
        states = [start]
        for step in steps:
            states.append(int(np.clip(states[-1] + step, 0, STATES - 1)))
        walks.append((sum(np.diff(states) == 0), states))  # moves that would not have been possible
    return STATES, np.array(min(walks)[1])


def _looks(features: np.ndarray, states: np.ndarray) -> np.ndarray:
    return np.stack([features[states == state].mean(0) for state in range(int(states.max()) + 1)])
