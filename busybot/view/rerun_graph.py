"""Rerun, the scene graph at the board's layout.

Rerun's edges have neither colour nor label, so an edge runs through a small node of its own that has both: the
probability, in the verdict's colour.
"""

import numpy as np
import rerun as rr

from busybot.episodes.episode import Episode
from busybot.view.palette import ROLES, TRUTH, VERDICTS
from busybot.view.scene import Edge, anchors, object_names

SPREAD = 1.25
"""Graph units per pixel of the camera: labels keep their size, so more spread is more room."""
LABEL_HEIGHT, LETTER_WIDTH = 24.0, 8.0
"""Size of a labelled node, graph units."""
PLACES = (0.5, 0.42, 0.58, 0.34, 0.66, 0.27, 0.73)
"""Where on an edge its label may be, the best first."""


def graph_positions(episode: Episode) -> np.ndarray:
    """Where each object's node is, (N, 2) graph units: x right, y down."""
    return anchors(episode) * SPREAD


def log_graph(
    recording: rr.RecordingStream, path: list[str], episode: Episode, edges: list[Edge], truth: bool = False
) -> None:
    """Objects as nodes where they are in the image, and the edges between them."""
    names, places = object_names(episode.board), graph_positions(episode)
    texts = ["controls" if truth else _text(edge) for edge in edges]
    ids = [f"{names[edge.cause]} to {names[edge.effect]}" for edge in edges]
    middles = place_labels(places, names, [(edge.cause, edge.effect) for edge in edges], texts)
    colors = [ROLES[placed.role] for placed in episode.board.objects]
    colors += [TRUTH if truth else VERDICTS[edge.verdict] for edge in edges]
    nodes = rr.GraphNodes(
        [*names, *ids], positions=np.concatenate([places, middles]), colors=colors, labels=[*names, *texts]
    )
    pairs = [(names[edge.cause], middle) for edge, middle in zip(edges, ids, strict=True)]
    pairs += [(middle, names[edge.effect]) for edge, middle in zip(edges, ids, strict=True)]
    recording.log(path, nodes, rr.GraphEdges(pairs, graph_type="directed"), static=truth)


def _text(edge: Edge) -> str:
    return f"{edge.probability:.2f}" if edge.verdict == "correct" else f"{edge.verdict} {edge.probability:.2f}"


def place_labels(
    places: np.ndarray, names: list[str], pairs: list[tuple[int, int]], texts: list[str]
) -> np.ndarray:
    """A point on each edge where its label covers as little as possible of nodes and other labels; (E, 2)."""
    taken = [_box(place, name) for place, name in zip(places, names, strict=True)]
    chosen = np.zeros((len(pairs), 2))
    for number, ((cause, effect), text) in enumerate(zip(pairs, texts, strict=True)):
        options = [places[cause] + share * (places[effect] - places[cause]) for share in PLACES]
        covered = [sum(_overlap(_box(option, text), other) for other in taken) for option in options]
        chosen[number] = options[int(np.argmin(covered))]
        taken.append(_box(chosen[number], text))
    return chosen


def _box(middle: np.ndarray, text: str) -> np.ndarray:
    half = np.array([LETTER_WIDTH * len(text) / 2 + 6, LABEL_HEIGHT / 2])
    return np.concatenate([middle - half, middle + half])


def _overlap(one: np.ndarray, other: np.ndarray) -> float:
    sides = np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2])
    return float(np.prod(np.maximum(sides, 0)))
