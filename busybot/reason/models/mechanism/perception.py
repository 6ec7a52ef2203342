"""A recording as a trace: states of links and responders as pictures show them, without labels.

A responder's states are clusters of its looks, numbered as they appear; links are those of `inputs.trigger_links`.
"""

from dataclasses import dataclass

import numpy as np

from busybot.reason.inputs.sequence import BoardSequence, clusters_of, threshold_of
from busybot.reason.inputs.trigger_links import REACH, ObservedLinks
from busybot.reason.models.mechanism.contexts import STATES, Trace

STILL, APART = 0.3, 2.0
"""Under a camera that is not still: in so large a share of the steps a responder rests, and two of its looks differ by
so many times what they do then."""


@dataclass(frozen=True)
class Perceived:
    """T actions, L links, R responders.

    Attributes:
        responders: int (R,), their objects.
        looks: for each responder the mean feature of each of its states, float32 (S, 256).
    """

    trace: Trace
    links: ObservedLinks
    responders: np.ndarray
    looks: tuple[np.ndarray, ...]

    def moved(self, states: np.ndarray, action: np.ndarray, acted: int) -> np.ndarray:
        """States of the links after an action, if it works; int (L,).

        It moves the nearest link of its trigger into the state to which the seen actions that were most like it led.
        """
        link, after = self.link_at(action, acted), states.copy()
        if link is None:
            return after
        now = int(states[link])
        others = [one for one in (now - 1, now + 1) if 0 <= one < self.trace.sizes[link]]
        after[link] = max(others, key=lambda one: float(self.links.directions[link][now, one] @ action[3:]))
        return after

    def link_at(self, action: np.ndarray, acted: int) -> int | None:
        """The nearest link of the trigger that is acted on, if it is near."""
        own = np.flatnonzero(self.links.owners == acted)
        away = np.linalg.norm(self.links.places[own] - action[:2], axis=1)
        return int(own[away.argmin()]) if len(own) and away.min() <= 2 * REACH else None

    def pushed_from(self, link: int, action: np.ndarray) -> np.ndarray:
        """For each state of a link, how well the action fits those that moved it from there: cosines, float (S,)."""
        size = self.trace.sizes[link]
        return (self.links.directions[link][:size, :size] @ action[3:]).max(1)

    def states_of(self, looks: np.ndarray) -> np.ndarray:
        """The responders' states that objects' features (N, 256) are nearest to, int (R,)."""
        pairs = zip(self.responders, self.looks, strict=True)
        return np.array([np.linalg.norm(known - looks[index], axis=1).argmin() for index, known in pairs], int)

    def shown(self, states: np.ndarray, looks: np.ndarray) -> np.ndarray:
        """Objects' features with those of responders in these states (R,) in their place, float32 (N, 256)."""
        told = np.array(looks, np.float32)
        for index, known, state in zip(self.responders, self.looks, states, strict=True):
            told[index] = known[min(int(state), len(known) - 1)]
        return told


def perceive(seen: BoardSequence, encoder: str) -> Perceived:
    """Links and states of a recording, of which the encoder's features are given.

    Under a camera that was not still, looks are unlike that differ by more than noise: by much more than they do in
    the steps in which responders changed least.
    """
    links, responders = seen.links, np.flatnonzero(seen.responders)
    unlike = threshold_of(encoder)
    if links.steadied:
        steps = np.linalg.norm(np.diff(seen.features[:, responders], axis=0), axis=-1)
        unlike = max(unlike, APART * float(np.median(np.quantile(steps, STILL, axis=0))))
    shown = clusters_of(seen.features, unlike)[:, responders].clip(0, STATES - 1)
    looks = tuple(
        np.stack([seen.features[states == state, index].mean(0) for state in range(int(states.max()) + 1)])
        for index, states in zip(responders, shown.T, strict=True)
    )
    return Perceived(Trace(links.states, shown, links.sizes), links, responders, looks)
