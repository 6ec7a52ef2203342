"""Rerun, the scene graph at the board's layout.

Rerun's edges have neither colour nor label, so an edge runs through a small node of its own that has both: the
probability, in the verdict's colour. In the true graph of another world than the paper's it is a mechanism, with its
kind and lag, in its type's colour.
"""

import numpy as np
import rerun as rr

from busybot.episodes.episode import Episode
from busybot.view.annotations import Edge, anchors, drawing_scale, object_names
from busybot.view.label_places import label_boxes, place_between, place_labels
from busybot.view.mechanisms import MechanismView
from busybot.view.palette import ACTION, FACTORS, ROLES, TRUTH, VERDICTS

SPREAD = 1.25
"""Graph units per drawing unit: labels keep their size, so more spread is more room."""
LONGEST_LABEL = "missed 0.00"


def graph_positions(episode: Episode) -> np.ndarray:
    """Where each object's node is, (N, 2) graph units: x right, y down."""
    return anchors(episode) * drawing_scale(episode) * SPREAD


def edge_places(episode: Episode, pairs: list[tuple[int, int]]) -> dict[tuple[int, int], np.ndarray]:
    """Where the label of each edge is, for all steps: an edge that comes and goes moves no other."""
    names = object_names(episode.board)
    points = place_labels(graph_positions(episode), names, pairs, [LONGEST_LABEL] * len(pairs))
    return dict(zip(pairs, points, strict=True))


def label_extents(episode: Episode, pairs: list[tuple[int, int]]) -> np.ndarray:
    """Boxes of all labels of a graph of objects with these edges, (B, 4), graph units."""
    places, texts = list(edge_places(episode, pairs).values()), object_names(episode.board)
    middles = np.concatenate([graph_positions(episode), np.reshape(places, (-1, 2))])
    return label_boxes(middles, texts + [LONGEST_LABEL] * len(places))


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
    return (
        f"{edge.probability:.2f}"
        if edge.verdict in ("correct", "claimed")
        else f"{edge.verdict} {edge.probability:.2f}"
    )


def log_mechanisms(
    recording: rr.RecordingStream, path: list[object], view: MechanismView, frame: int, places: dict[str, np.ndarray]
) -> None:
    """The true graph at a frame: links, mechanisms by type, responders; what acted and changed with it is marked.

    Args:
        places: from `factor_places`.
    """
    factors, changed = view.factors(frame), {one.responder for one in view.changes if one.step == frame}
    acting = {n for n, node in enumerate(view.nodes) if node.object in changed} | set(view.moved(frame))
    colors = [ROLES[view.board.objects[node.object].role] for node in view.nodes]
    colors += [FACTORS[factor.kind] for factor in factors]
    for place in acting:
        colors[place] = ACTION
    names = [f"node {n}" for n in range(len(view.nodes))]
    nodes = rr.GraphNodes(
        [*names, *(factor.key for factor in factors)],
        positions=np.concatenate([view.places * SPREAD, np.reshape([places[f.key] for f in factors], (-1, 2))]),
        colors=colors,
        labels=[*(node.name for node in view.nodes), *(factor.label for factor in factors)],
    )
    edges = [(names[cause], factor.key) for factor in factors for cause in factor.causes]
    edges += [(factor.key, names[effect]) for factor in factors for effect in factor.effects]
    recording.log(path, nodes, rr.GraphEdges(edges, graph_type="directed"))


def factor_places(view: MechanismView) -> dict[str, np.ndarray]:
    """Where each mechanism's node is, for all steps."""
    factors = {factor.key: factor for moment in view.moments for factor in view.factors(moment)}
    names, texts = [node.name for node in view.nodes], [factor.label for factor in factors.values()]
    legs = [(factor.causes, factor.effects) for factor in factors.values()]
    places = view.places * SPREAD
    return dict(zip(factors, place_between(places, places, names, legs, texts), strict=True))


def mechanism_extents(view: MechanismView) -> np.ndarray:
    """Boxes of all labels of the true graph, (B, 4), graph units."""
    labels = {factor.key: factor.label for moment in view.moments for factor in view.factors(moment)}
    places = factor_places(view)
    middles = np.concatenate([view.places * SPREAD, np.reshape([places[key] for key in labels], (-1, 2))])
    return label_boxes(middles, [*(node.name for node in view.nodes), *labels.values()])
