"""Places objects at random positions without overlap (paper appendix "Board Generation")."""

import numpy as np

from busybot.objects.model import ObjectModel

BOARD_HALF = 2.0
"""Half the board's side, board units."""
EDGE = 0.25
"""Free border, board units."""
QUARTER_TURN_CATEGORIES = frozenset({"Lamp", "Door"})
"""Only these are turned; switches and toys keep their orientation (paper appendix)."""
TRIES_PER_OBJECT = 50

Placement = tuple[tuple[float, float, float], float]
"""Position (x, y, z) and yaw of an object, board frame."""


def footprint(model: ObjectModel, yaw: float, margin: float) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (x, y) around the object's origin at this yaw, board units.

    Args:
        margin: free space on each side, object units.
    """
    low = np.array(model.bounds_min[:2]) - margin
    high = np.array(model.bounds_max[:2]) + margin
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])]) * model.scale
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    turned = corners @ turn.T
    return turned.min(0), turned.max(0)


def place(
    models: list[ObjectModel], rng: np.random.Generator, margin: float, half: float = BOARD_HALF
) -> list[Placement] | None:
    """Draw yaws and positions one object after the other; None if one finds no free place in its tries.

    Args:
        half: of the board's side, board units.
    """
    limit = half - EDGE
    taken: list[tuple[np.ndarray, np.ndarray]] = []
    placements: list[Placement] = []
    for model in models:
        yaw = float(rng.integers(4)) * np.pi / 2 if model.category in QUARTER_TURN_CATEGORIES else 0.0
        low, high = footprint(model, yaw, margin)
        spot = _free_spot(low, high, limit, taken, rng)
        if spot is None:
            return None
        taken.append((spot + low, spot + high))
        position = (round(float(spot[0]), 6), round(float(spot[1]), 6), round(model.offset_z, 6))
        placements.append((position, round(yaw, 6)))
    return placements


def _free_spot(
    low: np.ndarray,
    high: np.ndarray,
    limit: float,
    taken: list[tuple[np.ndarray, np.ndarray]],
    rng: np.random.Generator,
) -> np.ndarray | None:
    spots = rng.uniform(-limit, limit, (TRIES_PER_OBJECT, 2))
    lows, highs = spots + low, spots + high
    free = (lows >= -limit).all(1) & (highs <= limit).all(1)
    for other_low, other_high in taken:
        free &= ~((lows < other_high).all(1) & (highs > other_low).all(1))
    hits = np.flatnonzero(free)
    return spots[hits[0]] if len(hits) else None
