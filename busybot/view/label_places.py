"""Where labels of a graph's edges, and of parts of a node, stand: over no other label, with edges that run past them.

A label is part of its edge, which bends where it stands. All is in units of which a letter of a label is
`LETTER_WIDTH` wide and its ground `LABEL_HEIGHT` high; y points down. No drawing here.
"""

from collections.abc import Iterator, Sequence
from itertools import permutations, product

import numpy as np

LABEL_HEIGHT, LETTER_WIDTH = 24.0, 8.0
SHARES = (0.5, 0.42, 0.58, 0.34, 0.66, 0.27, 0.73, 0.2, 0.8)
OFFSETS = (0.0, 14.0, -14.0, 28.0, -28.0, 42.0, -42.0, 56.0, -56.0, 84.0, -84.0)
"""Where an edge's label may be: share of the way along the edge, and units beside it."""
CIRCLES = (60.0, 90.0, 130.0)
"""Where the label of what has no cause may be: distances from its effects."""
CROSSING = 1000.0
"""Cost of an edge that runs through a name or a label; covering one square unit of them costs `COVERING`."""
COVERING = 3.0
CLEAR = 8.0
"""An edge keeps so far from another edge's label: an arrow head ends there."""
HEAD = 22.0
"""So far from a label its own edge ends at least, for its arrow head to be seen."""
SWEEPS = 3
"""Each label is placed so many times, later with all others in their places."""
GAP = 8.0
"""Between the labels of a row or column, and between it and what it belongs to."""
MOST_ORDERED = 4
"""With more labels in a row, only their own order and the reverse are tried."""
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
        named: where the names stand, (M, 2); those beyond the first N are of no node, and in the way all the same.
    """
    nodes, sizes = label_boxes(named, names), np.reshape([_size(text) for text in texts], (-1, 2))
    order = sorted(range(len(legs)), key=lambda number: -len(legs[number][0]) - len(legs[number][1]))
    chosen: dict[int, np.ndarray] = {}
    for number in order * SWEEPS:
        chosen.pop(number, None)
        causes, effects = legs[number]
        own = (*causes, *effects)
        labels = label_boxes(np.reshape(list(chosen.values()), (-1, 2)), [texts[other] for other in chosen])
        strangers = np.concatenate([np.delete(nodes, own, axis=0), labels])
        drawn = [(place, places[end]) for other, place in chosen.items() for end in sum(legs[other], ())]
        middle = places[list(effects)].mean(0)
        options, detours = _options(places[list(causes)].mean(0), middle) if causes else _around(middle)
        here = np.concatenate([options - sizes[number], options + sizes[number]], axis=1)
        lines = np.stack(np.broadcast_arrays(options[:, None], places[list(own)]), axis=2)
        past = _crossings(lines, nodes[list(own)]) & ~np.eye(len(own), dtype=bool)  # a line may end at its own node
        ends = np.repeat(places[list(effects)][:, None], 2, axis=1)
        costs = (
            detours
            + CROSSING * _crossings(ends, here + HEAD * np.array([-1, -1, 1, 1])).sum(0)
            + COVERING * _overlaps(here, np.concatenate([nodes, labels])).sum(1)
            + CROSSING * (_crossings(lines, strangers).sum((1, 2)) + past.sum((1, 2)))
            + CROSSING * 0.7 * _crossings(np.reshape(drawn, (-1, 2, 2)), here).sum(0)
            + CROSSING * 0.3 * _crossings(np.reshape(drawn, (-1, 2, 2)), here + CLEAR * np.array([-1, -1, 1, 1])).sum(0)
        )
        chosen[number] = options[int(np.argmin(costs))]
    return np.array([chosen[number] for number in range(len(legs))]).reshape(-1, 2)


def place_beside(
    box: np.ndarray,
    texts: list[str],
    targets: Sequence[np.ndarray],
    names: np.ndarray,
    objects: np.ndarray,
    bounds: np.ndarray,
) -> np.ndarray:
    """Points for the labels of a node's parts, (P, 2): in a row or a column beside its box, within `bounds`.

    Lines from them should cross little: each other, the labels, and the box.

    Args:
        box, bounds: u0, v0, u1, v1.
        targets: of each part, where the lines from it lead, (L, 2).
        names: boxes (A, 4) that labels must not cover.
        objects: boxes (B, 4) that they had better not cover.
    """

    def cost(middles: np.ndarray) -> float:
        own = label_boxes(middles, texts)
        hidden = (_overlaps(own, names) > 0).sum()
        lines = [np.stack([middles[part], end]) for part, ends in enumerate(targets) for end in ends]
        of = [part for part, ends in enumerate(targets) for _ in ends]
        ways = np.reshape(lines, (-1, 2, 2))
        through = _crossings(ways, own)
        through[np.arange(len(of)), of] = False
        return float(
            CROSSING * (100 * hidden + through.sum() + 0.5 * _crossings(ways, box[None]).sum())
            + CROSSING * 0.3 * _meetings(ways, of)
            + COVERING * _overlaps(own, objects).sum()
            + np.linalg.norm(ways[:, 1] - ways[:, 0], axis=1).sum()
        )

    return min((_within(middles, texts, bounds) for middles in _arrangements(box, texts)), key=cost)


def _arrangements(box: np.ndarray, texts: list[str]) -> Iterator[np.ndarray]:
    """Points for labels, (P, 2) each: at the four sides of a box, or farther out beyond its name, in all orders."""
    count, middle, half = len(texts), (box[:2] + box[2:]) / 2, (box[2:] - box[:2]) / 2
    size = np.array([2 * max(_size(text)[0] for text in texts), LABEL_HEIGHT])
    places = np.arange(count) - (count - 1) / 2
    orders = list(permutations(places)) if count <= MOST_ORDERED else [tuple(places), tuple(places[::-1])]
    for (beside, along), side, away, order in product(((0, 1), (1, 0)), (1, -1), (0.0, LABEL_HEIGHT + GAP), orders):
        points = np.repeat(middle[None], count, axis=0)
        points[:, beside] += side * (half[beside] + size[beside] / 2 + GAP + away)
        points[:, along] += np.array(order) * (size[along] + GAP)
        yield points


def _within(middles: np.ndarray, texts: list[str], bounds: np.ndarray) -> np.ndarray:
    """The labels moved together into a box as far as they leave it."""
    boxes = label_boxes(middles, texts)
    inwards = np.maximum(bounds[:2] - boxes[:, :2].min(0), 0)
    return np.asarray(middles + inwards - np.maximum(boxes[:, 2:].max(0) - bounds[2:], 0))


def _meetings(lines: np.ndarray, of: list[int]) -> int:
    """How many pairs of lines (L, 2, 2) of different parts cross."""
    starts, ways = lines[:, 0], lines[:, 1] - lines[:, 0]
    apart = starts[None] - starts[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = _cross(apart, ways[None]) / _cross(ways[:, None], ways[None])  # along the first, where they meet
    inside = (shares > 0) & (shares < 1)
    others = np.not_equal.outer(of, of) if of else np.zeros((0, 0), bool)
    return int((inside & inside.T & others).sum()) // 2


def _cross(ones: np.ndarray, others: np.ndarray) -> np.ndarray:
    return np.asarray(ones[..., 0] * others[..., 1] - ones[..., 1] * others[..., 0])


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


def label_boxes(middles: np.ndarray, texts: list[str]) -> np.ndarray:
    """Upper left and lower right corners of labels, (N, 4)."""
    halves = np.reshape([_size(text) for text in texts], (-1, 2))
    return np.concatenate([middles - halves, middles + halves], axis=1)


def _size(text: str) -> tuple[float, float]:
    """Half of a label's width and height."""
    return LETTER_WIDTH * len(text) / 2 + 6, LABEL_HEIGHT / 2
