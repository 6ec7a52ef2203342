"""A recording as a trace: states of links and responders as pictures show them, without labels.

A responder's states are clusters of its looks, numbered as they appear; where something hides it before a camera that
is not still, it was not seen. Links are those of `inputs.trigger_links`, and those that cannot be seen to move but are
felt: what happens tells that they do.
"""

from dataclasses import dataclass, replace

import numpy as np

from busybot.reason.inputs.sequence import BoardSequence, clusters_of, hidden_looks, threshold_of
from busybot.reason.inputs.trigger_links import REACH, ObservedLinks, directions_of
from busybot.reason.models.mechanism.contexts import STATES, Trace

STILL, APART, SHARE = 0.25, 2.75, 0.45
"""Under a camera that is not still: in so large a share of the steps a responder rests, two of its looks differ by so
many times what they do then, and by so large a share of what its most different ones do."""

AWAY = 0.05
"""A link that cannot be seen to move is taken hold of so far from where links that can be are, board units."""
BESIDE = 0.06
"""Such actions on one trigger may be on one link, if they are so near to each other, board units."""
EFFECTS, OFTEN = 2, 0.25
"""Responders changed in so many of its actions, and in so large a share of them."""

ON = 2.0
"""Who takes hold so near to pixels that tell how a link stands, of one link alone, holds it, pixels."""
THERE = 0.02
"""Two actions took hold of the same place, board units."""
WITHIN = 0.12
"""Who takes hold farther from where a link was taken hold of holds another one, board units."""
ALONG = 0.5
"""What a link that was pushed there stands away along that way counts so much: it goes to and fro on it."""
BACK = np.array([1, 1, 1, -1, -1, -1])
"""Turns an action round."""
UNTRIED, SAME, AROUND, UNLIKE = 0.5, 0.8, 0.1, -9.0
"""How much less an action is like one that led the other way, turned round, than like one that led this way, and as
much less again if that one met the link there; how much it is at least like one that failed to be expected to fail,
too; how much more where all responders show the same; and how much at the least."""


@dataclass(frozen=True)
class Perceived:
    """T actions, L links, R responders.

    Attributes:
        actions: as of `BoardSequence`, but for the direction that was tried last where something changed.
        acted: as of `BoardSequence`.
        responders: int (R,), their objects.
        looks: for each responder the mean feature of each of its states, float32 (S, 256).
    """

    trace: Trace
    links: ObservedLinks
    responders: np.ndarray
    looks: tuple[np.ndarray, ...]
    actions: np.ndarray
    acted: np.ndarray

    def moved(
        self, states: np.ndarray, action: np.ndarray, acted: int, shown: np.ndarray | None = None, beyond: bool = False
    ) -> np.ndarray:
        """States of the links after an action, int (L,).

        The link that it takes hold of goes where the seen action led that was most like it and met the link in this
        state; or the other way, if it is the opposite of that; or where an action led from whose way back this may be.
        That may be nowhere, for a link may be held as long as responders stand as they do.

        Args:
            acted: the object that is acted on, -1 for none.
            shown: int (R,), what the responders show before it; None if it is known that something moved.
            beyond: whether a link may go on to a state that it was never seen in: -1, or the number of its states.
        """
        link, after = self.link_at(action, acted), states.copy()
        if link is None:
            return after
        now, size = int(states[link]), self.trace.sizes[link]
        if not 0 <= now < size:
            after[link] = np.clip(now, 0, size - 1)  # from beyond there is one way
            return after
        steps, stood = np.flatnonzero(self.links.clusters == link), self.trace.links[:, link]
        before, led, alike = stood[steps], stood[steps + 1], self._alike(steps, action, shown)
        back = self._alike(steps, action * BACK, shown) - UNTRIED

        def likeness(other: int) -> float:
            there, opposite = alike[(before == now) & (led == other)], back[(before == now) & (led == 2 * now - other)]
            from_there = back[(before == other) & (led == now)] - UNTRIED
            return float(np.concatenate([there, opposite, from_there]).max(initial=UNLIKE))

        best = max((other for other in (now - 1, now + 1) if 0 <= other < size), key=likeness)
        vain = float(alike[(before == now) & (led == now)].max(initial=UNLIKE))
        if shown is not None and vain >= SAME and vain > likeness(best):
            return after
        on = 2 * now - best
        goes_on = beyond and size < STATES and likeness(on) > max(likeness(best), SAME - UNTRIED)
        after[link] = on if goes_on else best
        return after

    def pushed_on(self, action: np.ndarray, acted: int) -> int | None:
        """The link that an action would push on from where it stands in the end, away from the only other state that it
        was seen in: it may have a third one there. None if there is none; arguments as of `moved`."""
        link = self.link_at(action, acted)
        if link is None or self.trace.sizes[link] != STATES - 1:
            return None
        now, ways = int(self.trace.links[-1, link]), self.links.directions[link]
        there = ways[1 - now, now] - ways[now, 1 - now]
        return link if there @ action[3:] > 0 else None

    def link_at(self, action: np.ndarray, acted: int) -> int | None:
        """The link of this trigger whose pixels lie where an action takes hold, and no other's; else the one that was
        taken hold of nearest to it, above all aside of its way, if that was near; None where an action took hold of
        none.

        Args:
            action: (6,), or its place alone, (3,).
        """
        shown = np.flatnonzero((self.links.owners == acted) & (self.links.away(action[:3]) <= ON))
        if len(shown) == 1:
            return int(shown[0])
        own = np.flatnonzero(self.acted == acted) if acted >= 0 else np.zeros(0, int)
        apart, links = self.actions[own, :2] - action[:2], self.links.clusters[own]
        away, along = np.linalg.norm(apart, axis=1), apart @ (action[3:5] if len(action) > 3 else np.zeros(2))
        if not (links >= 0).any() or away[links < 0].min(initial=np.inf) <= min(THERE, away[links >= 0].min()):
            return None
        nearest = np.where(links >= 0, away**2 - (1 - ALONG**2) * along**2, np.inf).argmin()
        return int(links[nearest]) if away[nearest] <= WITHIN else None

    def _alike(self, steps: np.ndarray, action: np.ndarray, shown: np.ndarray | None) -> np.ndarray:
        """How much these actions are like another one: cosine of the directions, less how far away they were, and a
        little more where the responders showed the same."""
        away = np.linalg.norm(self.actions[steps, :2] - action[:2], axis=1)
        alike = self.actions[steps, 3:] @ action[3:] - away / REACH
        if shown is not None and len(shown):
            alike = alike + AROUND * (self.trace.responders[steps] == shown).mean(1)
        return np.asarray(alike)

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
    """Links and states of a recording, of which the encoder's features are given; looked at once.

    Under a camera that was not still, looks are unlike that differ by more than noise: by much more than they do in
    the steps in which responders changed least.
    """
    return seen.once(("perceived", encoder), lambda: _perceived(seen, encoder))


def _perceived(seen: BoardSequence, encoder: str) -> Perceived:
    links, responders = seen.links, np.flatnonzero(seen.responders)
    unlike, share = threshold_of(encoder, seen.features), 0.0
    if links.steadied and len(responders) and seen.steps:
        steps = np.linalg.norm(np.diff(seen.features[:, responders], axis=0), axis=-1)
        unlike, share = max(unlike, APART * float(np.median(np.quantile(steps, STILL, axis=0)))), SHARE
    shown = clusters_of(seen.features, unlike, share)[:, responders].clip(0, STATES - 1).astype(int)
    looks = tuple(
        np.stack([seen.features[states == state, index].mean(0) for state in range(int(states.max()) + 1)])
        for index, states in zip(responders, shown.T, strict=True)
    )
    effects, hidden = shown[1:] != shown[:-1], None
    if links.steadied and seen.watch is not None:
        hidden = hidden_looks(seen.features[:, responders], few=0)
        effects &= ~hidden[1:] & ~hidden[:-1]  # what it led to behind a hand, nobody knows
        links = seen.watch(seen.steps, tuple(effects.any(1).tolist()))
    links = _with_felt(links, seen, effects.any(1))
    actions = seen.actions if links.pushed is None else np.hstack([seen.actions[:, :3], links.pushed])
    return Perceived(Trace(links.states, shown, links.sizes, hidden), links, responders, looks, actions, seen.acted)


def _with_felt(links: ObservedLinks, seen: BoardSequence, effects: np.ndarray) -> ObservedLinks:
    """With links that are too small, or too well hidden, to be seen moving.

    There is one where actions on a trigger changed no pixel of it, away from its other links, went both ways, and often
    made responders change. How it stands is told by the way in which it was to be pushed last.

    Args:
        effects: bool (T,), whether any responder changed.
    """
    moved = (links.states[1:] != links.states[:-1]).any(1)
    for trigger in np.flatnonzero(seen.triggers):
        held = np.flatnonzero((seen.acted == trigger) & ~moved)
        others = seen.actions[(seen.acted == trigger) & moved, :2]
        away = np.linalg.norm(seen.actions[held, None, :2] - others, axis=-1)
        for steps in _groups(held[(away > AWAY).all(1)], seen.actions):
            pushed = _ways(seen.actions[steps, 3:])
            if effects[steps].sum() >= max(EFFECTS, OFTEN * len(steps)) and pushed.any() and not pushed.all():
                links = _joined(links, steps, pushed, seen.actions, int(trigger))
    return links


def _groups(steps: np.ndarray, actions: np.ndarray) -> list[np.ndarray]:
    """Steps whose contacts lie near to each other."""
    from scipy.cluster.hierarchy import fclusterdata  # what only reads features does without

    if len(steps) < EFFECTS:
        return []
    labels = fclusterdata(actions[steps, :2], BESIDE, "distance", method="average")
    return [steps[labels == label] for label in np.unique(labels)]


def _ways(directions: np.ndarray) -> np.ndarray:
    """Which way each of these was pushed along their axis, bool (n,)."""
    return np.asarray(directions @ np.linalg.svd(directions)[2][0] > 0)


def _joined(
    links: ObservedLinks, steps: np.ndarray, pushed: np.ndarray, actions: np.ndarray, trigger: int
) -> ObservedLinks:
    """With one more link, which these steps pushed one way or the other."""
    states = np.zeros(len(links.states), int)
    for step, way in zip(steps.tolist(), pushed != pushed[0], strict=True):
        states[step + 1 :] = 0 if way else 1
    clusters = links.clusters.copy()
    clusters[steps] = len(links.owners)
    return replace(
        links,
        clusters=clusters,
        states=np.concatenate([links.states, states[:, None]], axis=1),
        owners=np.append(links.owners, trigger),
        places=np.vstack([links.places, actions[steps, :2].mean(0)]),
        directions=(*links.directions, directions_of(actions[:, 3:], states, steps)),
        pixels=(*links.pixels, np.zeros((0, 2), int)) if links.camera else (),
        outlines=None if links.outlines is None else np.vstack([links.outlines, np.full(6, np.nan)]),
    )
