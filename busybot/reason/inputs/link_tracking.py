"""How a link stands between its tries, before a camera that is not still: most tries move it to its next state, so a
picture that hardly shows it is understood by what came before and after."""

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
LASTS = 0.4
"""A link whose one move is seen differs by so large a share of it for good."""


def tracked(shown: np.ndarray, start: np.ndarray, change: float) -> tuple[float, np.ndarray]:
    """The likeliest states of a link between its tries, most of which move it to the next state; and how unlikely they
    are, infinitely where there are not so many, or they hardly differ.

    States and how they look are found in turns, by the Viterbi algorithm (Forney 1973).

    Args:
        shown: float (n, d), how it looked between them.
        start: int (n,), states to begin with.
        change: what a move usually changes.
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
        before, (states, cost) = states, _likeliest(np.minimum(away**2 / 2, OUTLIER) + np.log(spread))
        if (states == before).all():
            break
    if apart < APART * change:
        return np.inf, states
    return cost + count * shown.shape[1] * np.log(len(shown)) / 2, states  # more states have to be worth it


def _likeliest(costs: np.ndarray) -> tuple[np.ndarray, float]:
    """States int (n,) of a link that each try moves to the next one or, seldom, does not move; and what they cost.

    Args:
        costs: float (n, states), of each state.
    """
    number = np.arange(costs.shape[1])
    beside = np.abs(number[:, None] - number) == 1
    going = np.where(beside, np.log(beside.sum(1, keepdims=True)) - np.log(1 - FAILS), np.inf)
    np.fill_diagonal(going, -np.log(FAILS))
    total, came = costs[0], []
    for each in costs[1:]:
        ways = total[:, None] + going
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
