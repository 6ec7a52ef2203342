"""Places objects at random positions without overlap (paper appendix "Board Generation")."""

from collections.abc import Sequence

import numpy as np

from busybot.objects.model import ObjectModel

BOARD_HALF = 2.0
"""Half the board's side, board units."""
EDGE = 0.25
"""Free border, board units."""
QUARTER_TURN_CATEGORIES = frozenset({"Lamp", "Door"})
"""Only these are turned; switches and toys keep their orientation (paper appendix)."""
TRIES_PER_OBJECT = 50

Area = tuple[np.ndarray, np.ndarray]
"""Lower and upper corner (x, y) of a rectangle, board frame."""
Placement = tuple[tuple[float, float, float], float]
"""Position (x, y, z) and yaw of an object, board frame."""


def footprint(model: ObjectModel, yaw: float, margin: float) -> Area:
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
    limit = np.full(2, half - EDGE)
    taken: list[Area] = []
    placements: list[Placement] = []
    for model in models:
        yaw = float(rng.integers(4)) * np.pi / 2 if model.category in QUARTER_TURN_CATEGORIES else 0.0
        low, high = footprint(model, yaw, margin)
        spot = free_spot((low, high), (-limit, limit), taken, rng)
        if spot is None:
            return None
        taken.append((spot + low, spot + high))
        position = (round(float(spot[0]), 6), round(float(spot[1]), 6), round(model.offset_z, 6))
        placements.append((position, round(yaw, 6)))
    return placements


def free_spot(own: Area, within: Area, taken: Sequence[Area], rng: np.random.Generator) -> np.ndarray | None:
    """A random place (x, y) for an object in a rectangle, beside what is taken; None if none is found.

    Args:
        own: what the object covers around its origin.
    """
    spots = rng.uniform(*within, (TRIES_PER_OBJECT, 2))
    lows, highs = spots + own[0], spots + own[1]
    free = (lows >= within[0]).all(1) & (highs <= within[1]).all(1)
    for other_low, other_high in taken:
        free &= ~((lows < other_high).all(1) & (highs > other_low).all(1))
    hits = np.flatnonzero(free)
    return spots[hits[0]] if len(hits) else None
