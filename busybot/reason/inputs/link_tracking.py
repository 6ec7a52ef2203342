"""How a link stands between its tries, before a camera that is not still: most tries move it to its next state, so a
picture that hardly shows it is understood by what came before and after, and by whether responders changed."""

from itertools import combinations

import numpy as np

FAILS, OUTLIER, TURNS = 0.1, 6.0, 8
"""So large a share of the tries moves nothing, about; no picture of a link speaks more against a state, nats;
and so often, at most, states and how they look are found anew."""
SPREAD, NOISE = 0.2, 1.5
"""A link in one state looks so differently, as a share of how much states differ or moves change, at least; or so many
times as differently as it usually does."""
APART = 0.15
"""States differ by at least so large a share of what moves change: what drifts by less is no move."""
EFFECTS, BELIEVED = (0.1, 0.6), 4.0
"""Responders change in so large a share of the tries that move nothing, and of those that move a link, about: that
counts as much as so many tries that were seen."""
LASTS = 0.4
"""A link whose one move is seen differs by so large a share of it for good."""


def tracked(
    shown: np.ndarray, start: np.ndarray, change: float, effects: np.ndarray | None = None
) -> tuple[float, np.ndarray]:
    """The likeliest states of a link between its tries, most of which move it to the next state; and how unlikely they
    are, infinitely where there are not so many, or they hardly differ.

    States and how they look are found in turns, by the Viterbi algorithm (Forney 1973).

    Args:
        shown: float (n, d), how it looked between them.
        start: int (n,), states to begin with.
        change: what a move usually changes.
        effects: bool (n - 1,), after which tries any responder changed; None if nobody knows.
    """
    states, count, cost = start, int(start.max()) + 1, np.inf
    for _ in range(TURNS):
        if count < 2 or len(np.unique(states)) < count:
            return np.inf, states
        looks = np.array([np.median(shown[states == one], axis=0) for one in range(count)])
        apart = min(float(np.linalg.norm(one - other)) for one, other in combinations(looks, 2))
        usual = float(np.median(np.linalg.norm(shown - looks[states], axis=1)))
        spread = max(SPREAD * max(apart, change), NOISE * usual, 1e-6)
        away = np.linalg.norm(shown[:, None] - looks, axis=-1) / spread
        costs, tries = np.minimum(away**2 / 2, OUTLIER) + np.log(spread), _surprise(states, effects)
        before, (states, cost) = states, _likeliest(costs, tries)
        if (states == before).all():
            break
    if apart < APART * change:
        return np.inf, states
    return cost + count * shown.shape[1] * np.log(len(shown)) / 2, states  # more states have to be worth it


def _surprise(states: np.ndarray, effects: np.ndarray | None) -> np.ndarray:
    """What it costs to believe of each try, as far as responders tell, that it moved nothing, and that it moved the
    link, nats, float (n - 1, 2): by how often they change then and then, if it stood so, int (n,), between them."""
    if effects is None:
        return np.zeros((len(states) - 1, 2))
    moved, told = states[1:] != states[:-1], []
    for of, usual in zip((~moved, moved), EFFECTS, strict=True):
        share = (effects[of].sum() + BELIEVED * usual) / (of.sum() + BELIEVED)
        told.append(-np.log(np.where(effects, share, 1 - share)))
    return np.stack(told, axis=1)


def _likeliest(costs: np.ndarray, tries: np.ndarray) -> tuple[np.ndarray, float]:
    """States int (n,) of a link that each try moves to the next one or, seldom, does not move; and what they cost.

    Args:
        costs: float (n, states), of each state.
        tries: float (n - 1, 2), of each try that it moved nothing, and that it moved the link.
    """
    number = np.arange(costs.shape[1])
    beside = np.abs(number[:, None] - number) == 1
    going = np.where(beside, np.log(beside.sum(1, keepdims=True)) - np.log(1 - FAILS), np.inf)
    np.fill_diagonal(going, -np.log(FAILS))
    total, came = costs[0], []
    for each, (stays, moves) in zip(costs[1:], tries, strict=True):
        ways = total[:, None] + going + np.where(np.eye(len(number), dtype=bool), stays, moves)
        came.append(ways.argmin(0))
        total = ways.min(0) + each
    states = [int(total.argmin())]
    for back in reversed(came):
        states.append(int(back[states[-1]]))
    return np.array(states[::-1]), float(total.min())


def lasts(shown: np.ndarray, states: np.ndarray, change: float) -> bool:
    """Whether a link goes on looking as its one move left it: else something passed by."""
    looks = [np.median(shown[states == one], axis=0) for one in np.unique(states)]
    return all(np.linalg.norm(one - other) >= LASTS * change for one, other in combinations(looks, 2))
