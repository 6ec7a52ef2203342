"""Direction pairs, their scores and probabilities, and pixels elevated enough to be held (paper section 4.1)."""

import numpy as np

from busybot.boards.directions import OPPOSITE

ELEVATED = 0.002
"""A pixel belongs to an object when it lies more than this above the board, board units."""
NOT_ELEVATED = -20.0
"""Logit of pixels that belong to the board: nothing to take hold of."""
PAIRS: np.ndarray = np.flatnonzero(np.arange(len(OPPOSITE)) < OPPOSITE)
"""First direction of each of the 9 pairs, shape (9,); a proposed direction is executed with its opposite."""
PAIR_OF: np.ndarray = np.searchsorted(PAIRS, np.minimum(np.arange(len(OPPOSITE)), OPPOSITE))
"""Pair of each direction, shape (18,)."""


def pair_scores(directions: np.ndarray) -> np.ndarray:
    """Probability (..., 9) that one of a pair works, from those of the 18 directions (..., 18)."""
    return 1 - (1 - directions[..., PAIRS]) * (1 - directions[..., OPPOSITE[PAIRS]])


def better_of_pairs(directions: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Of one pair per row, int (K,), the direction with the higher probability of (K, 18)."""
    first, rows = PAIRS[pairs], np.arange(len(pairs))
    swap = directions[rows, OPPOSITE[first]] > directions[rows, first]
    return np.where(swap, OPPOSITE[first], first)


def sigmoid(logits: np.ndarray) -> np.ndarray:
    """Probabilities of logits, without overflow."""
    return 1 / (1 + np.exp(-np.clip(np.asarray(logits, float), -30, 30)))


def logit(probabilities: np.ndarray) -> np.ndarray:
    """Logits of probabilities, finite."""
    sure = np.clip(probabilities, 1e-9, 1 - 1e-9)
    return np.asarray(np.log(sure / (1 - sure)))


def pixel_at(place: int | np.integer, shape: tuple[int, ...]) -> tuple[int, int]:
    """The pixel (u, v) with this flat index in a picture of this shape, (H, W)."""
    row, column = divmod(int(place), shape[1])
    return column, row


def random_pixel(elevated: np.ndarray, rng: np.random.Generator) -> tuple[int, int]:
    """One of the elevated pixels, bool (H, W), or of all if there are none."""
    places = np.flatnonzero(elevated)
    return pixel_at(rng.choice(places) if len(places) else rng.integers(elevated.size), elevated.shape)
