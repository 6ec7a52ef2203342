"""Boards of triggers with links and responders with states, as arrays, for tests of models of relations."""

from dataclasses import dataclass

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.reason.inputs.sequence import CHANNELS, BoardSequence

LINK_SPACING = 0.14
THROW = 0.05
"""A link's contact point moves so far per state, board units."""
SPREAD = 0.02
"""Standard deviation of contact points on a link, board units."""


@dataclass(frozen=True)
class Board:
    """A sequence and, for assertions only, the truth behind it. N objects, T steps.

    Attributes:
        edges: bool (N, N).
        states: int (T + 1, N), of responders.
        succeeded: bool (T,).
    """

    seen: BoardSequence
    edges: np.ndarray
    states: np.ndarray
    succeeded: np.ndarray


@dataclass
class _Link:
    trigger: int
    responder: int
    place: np.ndarray
    axis: np.ndarray
    stages: int
    state: int

    def contact(self, rng: np.random.Generator) -> np.ndarray:
        moved = THROW * (self.state - (self.stages - 1) / 2) * self.axis
        return np.asarray(self.place + moved + rng.normal(0, SPREAD, 3))

    def pull(self, direction: np.ndarray) -> int:
        """The state after pulling along the direction and then against it."""
        along = float(direction @ self.axis)
        if abs(along) < 0.5:
            return self.state
        for sign in (1, -1):
            wanted = self.state + int(np.sign(along)) * sign
            if 0 <= wanted < self.stages:
                return wanted
        return self.state


def make_board(
    rng: np.random.Generator,
    steps: int = 30,
    triggers: int | None = None,
    responders: int | None = None,
    failing: float = 0.05,
    noise: float = 0.01,
) -> Board:
    """A random board watched while its links are pulled.

    Args:
        failing: share of actions that change nothing although they should.
        noise: of each feature in frames in which something changed, in units of the features' spread.
    """
    triggers = triggers or int(rng.integers(2, 4))
    responders = responders or int(rng.integers(5, 8))
    objects = triggers + responders
    order = rng.permutation(objects)
    positions = np.column_stack([rng.uniform(-1.6, 1.6, (objects, 2)), rng.uniform(0.1, 0.3, objects)])
    links = _links(rng, order[:triggers], order[triggers:], positions)
    looks = rng.normal(0, 1, (objects, 3, CHANNELS)) * rng.uniform(0.3, 1, (objects, 1, 1))
    state = np.zeros(objects, int)
    for link in links:
        state[link.responder] = link.state
    states, features, succeeded = [state.copy()], [_look(looks, state, rng, noise)], []
    actions, acted = np.empty((steps, 6)), np.empty(steps, int)
    for step in range(steps):
        link = links[rng.integers(len(links))]
        direction = DIRECTIONS[rng.integers(len(DIRECTIONS))] if rng.random() < 0.3 else _near(link.axis, rng)
        actions[step] = *link.contact(rng), *direction
        acted[step] = link.trigger
        reached = link.state if rng.random() < failing else link.pull(direction)
        succeeded.append(reached != link.state)
        link.state = state[link.responder] = reached
        states.append(state.copy())
        features.append(_look(looks, state, rng, noise) if succeeded[-1] else features[-1])
    edges = np.zeros((objects, objects), bool)
    for link in links:
        edges[link.trigger, link.responder] = True
    is_trigger = np.isin(np.arange(objects), order[:triggers])
    shown = np.where(is_trigger[None, :, None], 0, np.stack(features))
    sequence = BoardSequence(
        shown.astype(np.float32),
        positions.astype(np.float32),
        actions.astype(np.float32),
        acted,
        is_trigger,
        ~is_trigger,
    )
    return Board(sequence, edges, np.stack(states), np.array(succeeded))


def make_boards(count: int, seed: int = 0, **options: float) -> list[Board]:
    """Several of them; each depends on the seed and its number alone."""
    return [make_board(np.random.Generator(np.random.PCG64([seed, index])), **options) for index in range(count)]  # type: ignore[arg-type]


def _links(rng: np.random.Generator, triggers: np.ndarray, free: np.ndarray, positions: np.ndarray) -> list[_Link]:
    links: list[_Link] = []
    left = list(free)
    for trigger in triggers:
        axis = np.asarray(DIRECTIONS[rng.integers(len(DIRECTIONS))])
        stages = 3 if rng.random() < 0.25 else 2
        count = 1 if stages == 3 else int(rng.integers(1, 3))
        for number in range(min(count, len(left))):
            place = positions[trigger] + np.array([0, (number - (count - 1) / 2) * LINK_SPACING, 0.1])
            links.append(_Link(int(trigger), int(left.pop()), place, axis, stages, int(rng.integers(stages))))
    return links


def _near(axis: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """One of the directions that move along the axis, either way."""
    return np.asarray(axis if rng.random() < 0.5 else -axis)


def _look(looks: np.ndarray, state: np.ndarray, rng: np.random.Generator, noise: float) -> np.ndarray:
    seen = looks[np.arange(len(state)), state]
    return np.asarray(seen + noise * rng.normal(0, 1, seen.shape))
