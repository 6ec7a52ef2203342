"""Graphs as files: what a reasoner inferred of a board for other programs and people, and anybody's graph to be judged.

A file holds one graph, or a list of them, as JSON:

    {"board": 0, "model": "count", "actions": 22, "threshold": 0.5,
     "nodes": [{"id": 0, "name": "switch 0", "role": "trigger", "box": [12, 30, 48, 66], "position": [-1.2, 0.8, 0.1]}],
     "edges": [{"from": 0, "to": 4, "probability": 0.98, "claimed": true, "mechanism": null, "lag": null}]}

`box` is u0, v0, u1, v1 in the first picture, pixels; `position` in board units. What a reasoner does not tell is null;
pairs less probable than `LEAST` are left out. Of a graph that is read, `edges` with `from` and `to` suffice.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, ValidationError

from busybot.common.atomic_io import read_json, sha256_of, write_atomically, write_json
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import GivenModel, first_fault
from busybot.episodes.episode import Episode
from busybot.reason.models.base import InferredGraph

LEAST = 1e-3
OVERLAP = 0.5
"""A node is the object with whose box its box shares so much of what both cover."""
HINT = "docs/guides/reason.md shows such a file"


class Node(GivenModel):
    """An object; `box` decides which, or `id` as its number on the board where there is no box."""

    id: int | str
    box: tuple[float, float, float, float] | None = Field(None, strict=False)


class GraphEdge(GivenModel):
    """A claim that one node controls another."""

    cause: int | str = Field(alias="from")
    effect: int | str = Field(alias="to")
    probability: float = Field(1.0, ge=0, le=1, allow_inf_nan=False)
    mechanism: str | None = None
    lag: int | None = Field(None, ge=0, le=1000)


class GraphFile(GivenModel):
    """Anybody's graph of a board; without nodes, `from` and `to` are numbers of objects."""

    board: int = 0
    model: str = Field("graph", max_length=200)
    threshold: float = Field(0.5, ge=0, lt=1)
    nodes: tuple[Node, ...] = Field((), strict=False)
    edges: tuple[GraphEdge, ...] = Field(strict=False)


@dataclass(frozen=True)
class GivenGraphs:
    """Graphs by board, where they come from, and by the name that they give themselves the SHA-256 of their files."""

    path: Path
    graphs: Mapping[int, GraphFile]
    hashes: Mapping[str, dict[str, str]]

    def of(self, episode: Episode) -> InferredGraph:
        """The graph of a board.

        Raises:
            BusybotError: there is none, an edge names what is no object of the board, or two nodes have one id.
        """
        index, count = episode.board.index, len(episode.board.objects)
        if index not in self.graphs:
            raise BusybotError(f"{self.path}: it has no graph of board {index}", "give each graph its board's number")
        told = self.graphs[index]
        objects: dict[int | str, int | None] = {number: number for number in range(count)}
        if told.nodes:
            objects = {node.id: _object(node, episode) for node in told.nodes}
            if len(objects) < len(told.nodes):
                ids = [node.id for node in told.nodes]
                twice = next(name for name in ids if ids.count(name) > 1)
                raise BusybotError(f"{self.path}: board {index}: two nodes with id {twice!r}", "give each node its own")
        probabilities, lags = np.zeros((1, count, count)), np.full(count, -1)
        kinds = [""] * count
        for edge in told.edges:
            for name in (edge.cause, edge.effect):
                if objects.get(name) is None:
                    what = f"{self.path}: board {index}: node {name!r} is no object of the board"
                    raise BusybotError(what, f"its box must overlap one, or its id be from 0 to {count - 1}; {HINT}")
            cause, effect = objects[edge.cause], objects[edge.effect]
            assert cause is not None and effect is not None
            probabilities[0, cause, effect] = max(probabilities[0, cause, effect], edge.probability)
            kinds[effect] = edge.mechanism or kinds[effect]
            if edge.lag is not None:  # the earliest of an object's inputs counts
                lags[effect] = edge.lag if lags[effect] < 0 else min(lags[effect], edge.lag)
        known = {"kinds": tuple(kinds) if any(kinds) else None, "lags": lags if (lags >= 0).any() else None}
        return InferredGraph(told.model, probabilities, told.threshold, **known)  # type: ignore[arg-type]


def _object(node: Node, episode: Episode) -> int | None:
    boxes = episode.images[episode.frame_of[0]].boxes
    if node.box is None:
        return node.id if isinstance(node.id, int) and 0 <= node.id < len(boxes) else None
    shared = overlaps(np.array([node.box]), boxes)[0]
    return int(shared.argmax()) if shared.max(initial=0) >= OVERLAP else None


def overlaps(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Intersection over union of boxes (P, 4) and (N, 4), float (P, N)."""
    one, other = boxes[:, None].astype(float), others[None].astype(float)
    sides = np.minimum(one[..., 2:], other[..., 2:]) - np.maximum(one[..., :2], other[..., :2])
    inside = np.where((sides > 0).all(-1), sides.prod(-1), 0)
    both = (one[..., 2:] - one[..., :2]).prod(-1) + (other[..., 2:] - other[..., :2]).prod(-1) - inside
    return np.divide(inside, both, out=np.zeros_like(inside), where=both > 0)


def read_graphs(path: Path) -> GivenGraphs:
    """Read graphs from a file, or from all files NAME.json of a folder.

    Raises:
        BusybotError: naming the file and what is wrong with it.
    """
    files = sorted(path.glob("*.json")) if path.is_dir() else [path]
    if not files:
        raise BusybotError(f"{path}: no file in it ends in .json", HINT)
    graphs: dict[int, GraphFile] = {}
    hashes: dict[str, dict[str, str]] = {}
    for file in files:
        values = read_json(file)
        for one in values if isinstance(values, list) else [values]:
            try:
                graph = GraphFile.model_validate(one)
            except ValidationError as error:
                raise BusybotError(f"{file}: {first_fault(error)}", HINT) from None
            if graph.board in graphs:
                raise BusybotError(f"{file}: a second graph of board {graph.board}", "give each its board's number")
            graphs[graph.board] = graph
            hashes.setdefault(graph.model, {})[file.name] = sha256_of(file)
    return GivenGraphs(path, graphs, hashes)


def graph_values(episode: Episode, inferred: InferredGraph, steps: int) -> dict[str, Any]:
    """What was inferred of a board after so many steps, JSON values."""
    boxes = episode.images[episode.frame_of[0]].boxes
    probabilities, claimed = inferred.after(steps), inferred.claimed(steps)
    nodes = [
        {
            "id": number,
            "name": f"{placed.category.lower()} {number}",
            "role": placed.role,
            "box": boxes[number].tolist() if (boxes[number] >= 0).all() else None,
            "position": episode.positions[number].tolist() if np.isfinite(episode.positions[number]).all() else None,
        }
        for number, placed in enumerate(episode.board.objects)
    ]
    for node, words in zip(nodes, inferred.words or (), strict=False):
        if words:
            node["words"] = words
    edges = [
        {
            "from": int(i),
            "to": int(j),
            "probability": round(float(probabilities[i, j]), 6),
            "claimed": bool(claimed[i, j]),
            "mechanism": (inferred.kinds[j] or None) if inferred.kinds else None,
            "lag": int(inferred.lags[j]) if inferred.lags is not None and inferred.lags[j] >= 0 else None,
        }
        for i, j in np.argwhere((probabilities >= LEAST) | claimed)
    ]
    edges.sort(key=lambda edge: (-edge["probability"], edge["to"], edge["from"]))  # type: ignore[operator]
    board = {"board": episode.board.index, "model": inferred.name, "actions": steps, "threshold": inferred.threshold}
    return {**board, "nodes": nodes, "edges": edges}


def graph_lines(values: dict[str, Any]) -> list[str]:
    """The claimed edges for people, the likeliest first; a line tells when there is none. Then what the model says of
    objects in words, if it has any."""
    names = {node["id"]: node["name"] for node in values["nodes"]}
    lines = []
    for edge in values["edges"]:
        if edge["claimed"]:
            words = [f"{names[edge['from']]} -> {names[edge['to']]}", f"{edge['probability']:.3f}"]
            words += [edge["mechanism"]] if edge["mechanism"] else []
            words += [f"after {edge['lag']} more action{'s' * (edge['lag'] > 1)}"] if edge["lag"] else []
            lines.append(", ".join(words))
    told = [f"{node['name']} {node['words']}" for node in values["nodes"] if "words" in node]
    told = [re.sub(r"\bobject (\d+)", lambda at: names[int(at[1])], one) for one in told]
    return [*(lines or [f"nothing is claimed{_without_boxes(values['nodes'])}"]), *told]


def _without_boxes(nodes: list[dict[str, Any]]) -> str:
    """Why nothing could be claimed, if that is because nobody drew what it would be about."""
    boxed = {node["role"] for node in nodes if node["box"]}
    missing = [role for role in ("trigger", "responder") if role not in boxed]
    return f": no {' and no '.join(missing)} has a box; `busybot annotate` draws them" if missing else ""


def write_graph(folder: Path, values: dict[str, Any]) -> None:
    """Write a board's graph as JSON, and for people as text."""
    name = f"{values['board']:06d}"
    write_json(folder / f"{name}.json", values, folder)
    head = f"board {values['board']}, inferred by {values['model']} after {values['actions']} actions"
    write_atomically(folder / f"{name}.txt", "\n".join([head, *graph_lines(values), ""]).encode(), folder)
