"""Where the labels of a graph's edges stand so that it can be read: over no other label, with edges that run past them.

A label is part of its edge, which bends where it stands. All is in units of which a letter of a label is
`LETTER_WIDTH` wide and its ground `LABEL_HEIGHT` high; y points down. No drawing here.
"""

import numpy as np

LABEL_HEIGHT, LETTER_WIDTH = 24.0, 8.0
SHARES = (0.5, 0.42, 0.58, 0.34, 0.66, 0.27, 0.73)
OFFSETS = (0.0, 28.0, -28.0, 56.0, -56.0, 84.0, -84.0)
"""Where an edge's label may be: share of the way along the edge, and units beside it."""
CIRCLES = (60.0, 90.0, 130.0)
"""Where the label of what has no cause may be: distances from its effects."""
CROSSING = 1000.0
"""Cost of an edge that runs through a name or a label; covering one square unit of them costs `COVERING`."""
COVERING = 3.0
SWEEPS = 3
"""Each label is placed so many times, later with all others in their places."""
Legs = tuple[tuple[int, ...], tuple[int, ...]]


def place_labels(places: np.ndarray, names: list[str], pairs: list[tuple[int, int]], texts: list[str]) -> np.ndarray:
    """A point for each edge's label, (E, 2), so that label and edge cover little of nodes and other labels.

    A label may stand beside the straight line: the edge then bends through it, around what was in its way.
    """
    return place_between(places, places, names, [((cause,), (effect,)) for cause, effect in pairs], texts)


def place_between(
    places: np.ndarray, named: np.ndarray, names: list[str], legs: list[Legs], texts: list[str]
) -> np.ndarray:
    """The same for labels with several causes and effects, or without causes.

    Args:
        places: where edges begin and end, (N, 2).
        named: where the names stand, (N, 2).
    """
    nodes, sizes = _boxes(named, names), np.reshape([_size(text) for text in texts], (-1, 2))
    order = sorted(range(len(legs)), key=lambda number: -len(legs[number][0]) - len(legs[number][1]))
    chosen: dict[int, np.ndarray] = {}
    for number in order * SWEEPS:
        chosen.pop(number, None)
        causes, effects = legs[number]
        own = (*causes, *effects)
        labels = _boxes(np.reshape(list(chosen.values()), (-1, 2)), [texts[other] for other in chosen])
        strangers = np.concatenate([np.delete(nodes, own, axis=0), labels])
        drawn = [(place, places[end]) for other, place in chosen.items() for end in sum(legs[other], ())]
        middle = places[list(effects)].mean(0)
        options, detours = _options(places[list(causes)].mean(0), middle) if causes else _around(middle)
        here = np.concatenate([options - sizes[number], options + sizes[number]], axis=1)
        lines = np.stack(np.broadcast_arrays(options[:, None], places[list(own)]), axis=2)
        costs = (
            detours
            + COVERING * _overlaps(here, np.concatenate([nodes, labels])).sum(1)
            + CROSSING * _crossings(lines, strangers).sum((1, 2))
            + CROSSING * _crossings(np.reshape(drawn, (-1, 2, 2)), here).sum(0)
        )
        chosen[number] = options[int(np.argmin(costs))]
    return np.array([chosen[number] for number in range(len(legs))]).reshape(-1, 2)


def _around(middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points in circles around a node, (O, 2), with what they cost by themselves, (O,)."""
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([middle + radius * rays for radius in CIRCLES]), np.repeat(CIRCLES, len(rays))


def _options(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points on and beside the line from start to end, (O, 2), with what they cost by themselves, (O,)."""
    along = end - start
    across = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    offsets, shares = (grid.reshape(-1, 1) for grid in np.meshgrid(OFFSETS, SHARES, indexing="ij"))
    return start + shares * along + offsets * across, (100 * abs(shares - 0.5) + 3 * abs(offsets))[:, 0]


def _crossings(lines: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Whether lines (..., 2, 2) run through boxes (B, 4), by points along them; bool (..., B)."""
    shares = np.linspace(0, 1, 25)[:, None]
    points = (lines[..., None, 0, :] * (1 - shares) + lines[..., None, 1, :] * shares)[..., None, :]
    return np.all((points > boxes[:, :2]) & (points < boxes[:, 2:]), axis=-1).any(-2)


def _overlaps(ones: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Area that boxes (A, 4) have in common with others (B, 4); (A, B)."""
    sides = np.minimum(ones[:, None, 2:], others[:, 2:]) - np.maximum(ones[:, None, :2], others[:, :2])
    return np.maximum(sides, 0).prod(-1)


def _boxes(middles: np.ndarray, texts: list[str]) -> np.ndarray:
    """Upper left and lower right corners of labels, (N, 4)."""
    halves = np.reshape([_size(text) for text in texts], (-1, 2))
    return np.concatenate([middles - halves, middles + halves], axis=1)


def _size(text: str) -> tuple[float, float]:
    """Half of a label's width and height."""
    return LETTER_WIDTH * len(text) / 2 + 6, LABEL_HEIGHT / 2
