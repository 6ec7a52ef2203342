"""Rerun, the scene graph at the board's layout.

Rerun's edges have neither colour nor label, so an edge runs through a small node of its own that has both: the
probability, in the verdict's colour.
"""

import numpy as np
import rerun as rr

from busybot.episodes.episode import Episode
from busybot.view.annotations import Edge, anchors, drawing_scale, object_names
from busybot.view.palette import ROLES, TRUTH, VERDICTS

SPREAD = 1.25
"""Graph units per drawing unit: labels keep their size, so more spread is more room."""
LABEL_HEIGHT, LETTER_WIDTH = 24.0, 8.0
"""Size of a labelled node, graph units."""
LONGEST_LABEL = "missed 0.00"
SHARES = (0.5, 0.42, 0.58, 0.34, 0.66, 0.27, 0.73)
OFFSETS = (0.0, 28.0, -28.0, 56.0, -56.0)
"""Where an edge's label may be: share of the way along the edge, and graph units beside it."""
CROSSING = 1000.0
"""Cost of an edge that runs through a node; covering one square graph unit costs 1."""


def graph_positions(episode: Episode) -> np.ndarray:
    """Where each object's node is, (N, 2) graph units: x right, y down."""
    return anchors(episode) * drawing_scale(episode) * SPREAD


def edge_places(episode: Episode, pairs: list[tuple[int, int]]) -> dict[tuple[int, int], np.ndarray]:
    """Where the label of each edge is, for all steps: an edge that comes and goes moves no other."""
    names = object_names(episode.board)
    points = place_labels(graph_positions(episode), names, pairs, [LONGEST_LABEL] * len(pairs))
    return dict(zip(pairs, points, strict=True))


def log_graph(
    recording: rr.RecordingStream,
    path: list[object],
    episode: Episode,
    edges: list[Edge],
    places: dict[tuple[int, int], np.ndarray],
    truth: bool = False,
) -> None:
    """Objects as nodes where they are in the image, and the edges between them.

    Args:
        places: from `edge_places`, for these edges at least.
    """
    names = object_names(episode.board)
    middles = [places[edge.cause, edge.effect] for edge in edges]
    positions = np.concatenate([graph_positions(episode), np.reshape(middles, (-1, 2))])
    labels = names + ["controls" if truth else _text(edge) for edge in edges]
    colors = [ROLES[placed.role] for placed in episode.board.objects]
    colors += [TRUTH if truth else VERDICTS[edge.verdict] for edge in edges]
    ids = [f"{names[edge.cause]} to {names[edge.effect]}" for edge in edges]
    nodes = rr.GraphNodes([*names, *ids], positions=positions, colors=colors, labels=labels)
    pairs = [(names[edge.cause], middle) for edge, middle in zip(edges, ids, strict=True)]
    pairs += [(middle, names[edge.effect]) for edge, middle in zip(edges, ids, strict=True)]
    recording.log(path, nodes, rr.GraphEdges(pairs, graph_type="directed"), static=truth)


def _text(edge: Edge) -> str:
    return f"{edge.probability:.2f}" if edge.verdict == "correct" else f"{edge.verdict} {edge.probability:.2f}"


def place_labels(places: np.ndarray, names: list[str], pairs: list[tuple[int, int]], texts: list[str]) -> np.ndarray:
    """A point for each edge's label, (E, 2), so that label and edge cover little of nodes and other labels.

    A label may stand beside the straight line: the edge then bends through it, around what was in its way.
    """
    nodes = [_box(place, name) for place, name in zip(places, names, strict=True)]
    labels: list[np.ndarray] = []
    chosen = np.zeros((len(pairs), 2))
    for number, ((cause, effect), text) in enumerate(zip(pairs, texts, strict=True)):
        others = [box for index, box in enumerate(nodes) if index not in (cause, effect)] + labels
        options = _options(places[cause], places[effect])
        costs = [
            sum(_overlap(_box(option, text), box) for box in (*nodes, *labels))
            + CROSSING * _crossed([places[cause], option, places[effect]], others)
            + detour
            for option, detour in options
        ]
        chosen[number] = options[int(np.argmin(costs))][0]
        labels.append(_box(chosen[number], text))
    return chosen


def _options(start: np.ndarray, end: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Points on and beside the line from start to end, each with what it costs by itself."""
    along = end - start
    across = np.array([-along[1], along[0]]) / max(float(np.hypot(*along)), 1e-9)
    return [
        (start + share * along + offset * across, 100 * abs(share - 0.5) + 3 * abs(offset))
        for offset in OFFSETS
        for share in SHARES
    ]


def _crossed(corners: list[np.ndarray], boxes: list[np.ndarray]) -> int:
    """How many boxes a polyline runs through, by points along it."""
    parts = [a + np.linspace(0, 1, 25)[:, None] * (b - a) for a, b in zip(corners, corners[1:], strict=False)]
    points = np.concatenate(parts)
    return sum(bool(np.all((points > box[:2]) & (points < box[2:]), axis=1).any()) for box in boxes)


def _box(middle: np.ndarray, text: str) -> np.ndarray:
    half = np.array([LETTER_WIDTH * len(text) / 2 + 6, LABEL_HEIGHT / 2])
    return np.concatenate([middle - half, middle + half])


def _overlap(one: np.ndarray, other: np.ndarray) -> float:
    sides = np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2])
    return float(np.prod(np.maximum(sides, 0)))
