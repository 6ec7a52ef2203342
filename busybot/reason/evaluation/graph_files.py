"""Graphs as files: what a reasoner inferred of a board for other programs and people, and anybody's graph to be judged.

A file holds one graph, or a list of them, as JSON:

    {"board": 0, "model": "count", "actions": 22, "threshold": 0.5,
     "nodes": [{"id": 0, "name": "switch 0", "role": "trigger", "box": [12, 30, 48, 66], "position": [-1.2, 0.8, 0.1]},
               {"id": 4, ..., "parent_sets": [{"links": ["0.1"], "objects": [], "probability": 0.97}]}],
     "links": [{"id": "0.1", "of": 0, "steps": [0, 3, 7]}],
     "edges": [{"from": 0, "to": 4, "link": null, "probability": 0.98, "claimed": true, "mechanism": null, "lag": 0}]}

`box` is u0, v0, u1, v1 in the first picture, pixels; `position` in board units. A link is what some recorded actions
took hold of, `steps` numbers them from 0; an edge whose `link` is its id is about it, others about whole objects. Sets
of parents are those that decide a responder together, at the end of what was seen, of links that moved. What
a reasoner does not tell is null; pairs less probable than `LEAST` are left out. Of a graph that is read, `edges` with
`from` and `to` suffice; an object's mechanism is that of the most probable edge to it that has one, its lag the least
of the claimed ones. All graphs that are read together have one model and one threshold.
"""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, ValidationError

from busybot.common.atomic_io import read_json, sha256_of, write_atomically, write_json
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import GivenModel, first_fault
from busybot.common.text import one_line
from busybot.episodes.episode import Episode
from busybot.reason.inputs.observation import acted_objects, observe_episode
from busybot.reason.models.base import InferredGraph, InferredLinks, ParentSet

LEAST = 1e-3
OVERLAP = 0.5
"""A node is the object with whose box its box shares so much of what both cover."""
HINT = "docs/guides/reason.md shows such a file"


class Node(GivenModel):
    """An object; `box` decides which, or `id` as its number on the board where there is no box."""

    id: int | str
    box: tuple[float, float, float, float] | None = Field(None, strict=False)


class GraphLink(GivenModel):
    """A link of a node: the recorded actions, counted from 0, that took hold of it."""

    id: int | str
    of: int | str
    steps: tuple[int, ...] = Field(min_length=1, strict=False)


class GraphEdge(GivenModel):
    """A claim that one node, or one link of it, controls another node."""

    cause: int | str = Field(alias="from")
    effect: int | str = Field(alias="to")
    link: int | str | None = None
    probability: float = Field(1.0, ge=0, le=1, allow_inf_nan=False)
    mechanism: str | None = None
    lag: int | None = Field(None, ge=0, le=1000)


class GraphFile(GivenModel):
    """Anybody's graph of a board; without nodes, `from`, `to` and `of` are numbers of objects. Who does not tell links
    apart has None."""

    board: int = 0
    model: str = Field("graph", max_length=200)
    threshold: float = Field(0.5, ge=0, lt=1)
    nodes: tuple[Node, ...] = Field((), strict=False)
    links: tuple[GraphLink, ...] | None = Field(None, strict=False)
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
            BusybotError: there is none, an edge or a link names what is no object of the board, two nodes or two links
                have one id, two nodes are one object, or a link's steps are not those of the recording or are another
                link's, too.
        """
        index = episode.board.index
        if index not in self.graphs:
            raise BusybotError(f"{self.path}: it has no graph of board {index}", "give each graph its board's number")
        return _Reading(self.path, episode, self.graphs[index]).graph()

    def check(self, boards: int) -> None:
        """Refuse graphs of boards that a dataset with so many does not have.

        Raises:
            BusybotError: naming one of them.
        """
        if strange := sorted(index for index in self.graphs if not 0 <= index < boards):
            what = f"{self.path}: it has a graph of board {strange[0]}, and the dataset has boards 0 to {boards - 1}"
            raise BusybotError(what, "take the dataset that the graphs are about")


class _Reading:
    """A graph from a file about a board of N objects on which T actions were recorded."""

    def __init__(self, path: Path, episode: Episode, told: GraphFile):
        self.episode, self.told, self.count = episode, told, len(episode.board.objects)
        self.place = f"{path}: board {episode.board.index}"
        self.objects: dict[int | str, int | None] = {number: number for number in range(self.count)}
        if told.nodes:
            self.objects = {node.id: _object(node, episode) for node in told.nodes}
            self._only_once("nodes", [node.id for node in told.nodes])
            names: dict[int, int | str] = {}
            for name, number in self.objects.items():
                if number is not None and names.setdefault(number, name) != name:
                    what = f"{self.place}: nodes {names[number]!r} and {name!r} are both object {number}"
                    raise BusybotError(what, "give each the box of its own object")

    def graph(self) -> InferredGraph:
        told = self.told
        clusters = self._clusters()
        links = {link.id: (number, link.of) for number, link in enumerate(told.links or ())}
        probabilities, single = np.zeros((1, self.count, self.count)), np.zeros((1, len(links), self.count))
        for edge in told.edges:
            cause, effect = self._number_of(edge.cause), self._number_of(edge.effect)
            probabilities[0, cause, effect] = max(probabilities[0, cause, effect], edge.probability)
            if edge.link is not None:
                number, owner = links.get(edge.link, (-1, None))
                if owner != edge.cause:
                    what = f"{self.place}: an edge from node {edge.cause!r} names link {edge.link!r}"
                    raise BusybotError(f"{what}, which is none of it", f"list it in `links` with `of`; {HINT}")
                single[0, number, effect] = max(single[0, number, effect], edge.probability)
        kinds, lags = self._named()
        return InferredGraph(
            told.model,
            probabilities,
            told.threshold,
            links=None if told.links is None else InferredLinks(clusters, single),
            kinds=tuple(kinds) if any(kinds) else None,
            lags=lags if (lags >= 0).any() else None,
        )

    def _named(self) -> tuple[list[str], np.ndarray]:
        """Kinds of mechanisms and lags, int (N,), of each object."""
        kinds, lags = [""] * self.count, np.full(self.count, -1)
        for edge in sorted(self.told.edges, key=lambda edge: -edge.probability):
            effect = self._number_of(edge.effect)
            kinds[effect] = kinds[effect] or edge.mechanism or ""
            if edge.lag is not None:  # the earliest of an object's inputs counts
                if lags[effect] < 0:
                    lags[effect] = edge.lag
                elif edge.probability > self.told.threshold:
                    lags[effect] = min(lags[effect], edge.lag)
        return kinds, lags

    def _only_once(self, what: str, ids: list[int | str]) -> None:
        if len(set(ids)) < len(ids):
            [(twice, _)] = Counter(ids).most_common(1)
            raise BusybotError(f"{self.place}: two {what} with id {twice!r}", "give each its own")

    def _number_of(self, name: int | str) -> int:
        number = self.objects.get(name)
        if number is None:
            hint = f"its box must overlap one, or its id be from 0 to {self.count - 1}; {HINT}"
            raise BusybotError(f"{self.place}: node {name!r} is no object of the board", hint)
        return number

    def _clusters(self) -> np.ndarray:
        """int (T,), the number of the link that each action took hold of, -1 for none."""
        links, steps = self.told.links or (), len(self.episode.steps)
        self._only_once("links", [link.id for link in links])
        clusters = np.full(steps, -1)
        for number, link in enumerate(links):
            self._number_of(link.of)
            for step in link.steps:
                if not 0 <= step < steps:
                    what = f"{self.place}: link {link.id!r}: the recording has no step {step}"
                    raise BusybotError(what, f"its {steps} steps are counted from 0")
                if clusters[step] not in (-1, number):
                    what = f"{self.place}: links {links[clusters[step]].id!r} and {link.id!r} both have step {step}"
                    raise BusybotError(what, "an action takes hold of one link at most")
                clusters[step] = number
        return clusters


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
        values, digest = read_json(file), sha256_of(file)
        for one in values if isinstance(values, list) else [values]:
            try:
                graph = GraphFile.model_validate(one)
            except ValidationError as error:
                raise BusybotError(f"{file}: {first_fault(error)}", HINT) from None
            if graph.board in graphs:
                raise BusybotError(f"{file}: a second graph of board {graph.board}", "give each its board's number")
            first = next(iter(graphs.values()), graph)
            for what, mine, other in (
                ("model", graph.model, first.model),
                ("threshold", graph.threshold, first.threshold),
            ):
                if mine != other:
                    told = f"{file}: board {graph.board} has the {what} {mine!r}, and board {first.board} has {other!r}"
                    raise BusybotError(told, "graphs that are judged together have one; judge others by themselves")
            graphs[graph.board] = graph
            hashes.setdefault(graph.model, {})[file.name] = digest
    silent = [board for board, graph in graphs.items() if graph.links is None]
    if 0 < len(silent) < len(graphs):  # else a model chose on which boards it is judged
        raise BusybotError(f"{path}: `links` are told of other boards, but not of board {silent[0]}", HINT)
    return GivenGraphs(path, graphs, hashes)


def graph_values(episode: Episode, inferred: InferredGraph, steps: int) -> dict[str, Any]:
    """What was inferred of a board after so many steps, JSON values."""
    boxes = episode.images[episode.frame_of[0]].boxes
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
    links: list[dict[str, Any]] = []
    rows: list[tuple[int, str | None, np.ndarray]] = [(i, None, row) for i, row in enumerate(inferred.after(steps))]
    if inferred.links is not None:
        links = _links_of(episode, inferred.links)
        single = inferred.links.after(steps)
        ids = {link["cluster"]: link["id"] for link in links}
        for node, sets in zip(nodes, inferred.parent_sets or (), strict=False):
            if sets:
                node["parent_sets"] = [told for one in sets if (told := _named_set(one, ids))]
        rows += [(link["of"], link["id"], single[link.pop("cluster")]) for link in links]
    edges = [
        {
            "from": cause,
            "to": effect,
            "link": link,
            "probability": round(float(row[effect]), 6),
            "claimed": bool(row[effect] > inferred.threshold),
            "mechanism": (inferred.kinds[effect] or None) if inferred.kinds else None,
            "lag": int(inferred.lags[effect]) if inferred.lags is not None and inferred.lags[effect] >= 0 else None,
        }
        for cause, link, row in rows
        for effect in np.flatnonzero((row >= LEAST) | (row > inferred.threshold)).tolist()
    ]
    edges.sort(key=lambda edge: (edge["link"] is not None, -edge["probability"], edge["to"], edge["from"]))  # type: ignore[operator]
    board = {"board": episode.board.index, "model": inferred.name, "actions": steps, "threshold": inferred.threshold}
    return {**board, "nodes": nodes, "links": None if inferred.links is None else links, "edges": edges}


def _named_set(parents: ParentSet, ids: Mapping[int, str]) -> dict[str, Any] | None:
    """A set of parents with its links by name; None if one has none, because nobody can say whose it is."""
    if not all(cluster in ids for cluster in parents.links):
        return None
    names = [ids[cluster] for cluster in parents.links]
    return {"links": names, "objects": list(parents.objects), "probability": round(parents.probability, 6)}


def _links_of(episode: Episode, told: InferredLinks) -> list[dict[str, Any]]:
    """A model's links with the actions that held them and, as `cluster`, their numbers; by name they are their objects'
    first, second, ... links. Those of which nobody can say whose they are, are left out."""
    acted, values, counts = acted_objects(observe_episode(episode)), [], Counter[int]()
    for cluster in range(told.probabilities.shape[1]):
        steps = np.flatnonzero(told.clusters == cluster)
        owners = Counter(acted[steps][acted[steps] >= 0].tolist())
        if owners:
            [(owner, _)] = owners.most_common(1)
            counts[owner] += 1
            values.append({"id": f"{owner}.{counts[owner]}", "of": owner, "steps": steps.tolist(), "cluster": cluster})
    return values


def graph_lines(values: dict[str, Any]) -> list[str]:
    """The claimed edges for people, the likeliest first; a line tells when there is none. Then what the model says of
    objects in words, if it has any."""
    names = {node["id"]: node["name"] for node in values["nodes"]}
    lines = []
    for edge in values["edges"]:
        if edge["claimed"] and edge["link"] is None:
            words = [f"{names[edge['from']]} -> {names[edge['to']]}", f"{edge['probability']:.3f}"]
            words += [edge["mechanism"]] if edge["mechanism"] else []
            words += [f"after {edge['lag']} more action{'s' * (edge['lag'] > 1)}"] if edge["lag"] else []
            lines.append(", ".join(words))
    told = [f"{node['name']} {node['words']}" for node in values["nodes"] if "words" in node]
    told = [re.sub(r"\bobject (\d+)", lambda at: names[int(at[1])], one) for one in told]
    # a graph from a file names mechanisms as it likes
    return [*(map(one_line, lines) if lines else [f"nothing is claimed{_without_boxes(values['nodes'])}"]), *told]


def _without_boxes(nodes: list[dict[str, Any]]) -> str:
    """Why nothing could be claimed, if that is because nobody drew what it would be about."""
    boxed = {node["role"] for node in nodes if node["box"]}
    missing = [role for role in ("trigger", "responder") if role not in boxed]
    return f": no {' and no '.join(missing)} has a box; `busybot annotate` draws them" if missing else ""


def write_graph(folder: Path, values: dict[str, Any]) -> None:
    """Write a board's graph as JSON, and for people as text."""
    name = f"{values['board']:06d}"
    write_json(folder / f"{name}.json", values, folder)
    head = f"board {values['board']}, inferred by {one_line(values['model'])} after {values['actions']} actions"
    write_atomically(folder / f"{name}.txt", "\n".join([head, *graph_lines(values), ""]).encode(), folder)
