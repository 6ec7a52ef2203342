"""A board's mechanisms for pictures: as a typed graph, in words, and what each change goes back to. No drawing here.

In the graph a mechanism is a node of its own between what it reads and what it decides, so that two inputs of one gate
are told from two gates; its label is its kind with its parameters, and its lag where that is not 0. A lag of `0+` comes
later when luck fails. A hidden clock and a lock are such nodes, too; a lock's effect is a link.

A recording does not tell how many states a link has, which mechanisms depend on. Here they are the fewest under which
the board's mechanisms do what was recorded.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import prod
from typing import Literal

import numpy as np

from busybot.boards.dynamics import Dynamics, Links
from busybot.boards.mechanisms import Mechanism, kind_named
from busybot.boards.mechanisms.gate import Gate
from busybot.boards.mechanisms.rest import Rest
from busybot.boards.spec import BODY, PAPER, LinkRef, Relation
from busybot.boards.true_causes import Change, Period, changes, lag, periods, relations_at
from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode
from busybot.view.annotations import anchors, board_bounds, drawing_scale, object_names

Kind = Literal["mechanism", "chance", "clock", "lock"]
Name = tuple[int, str]
"""Object and name of a trigger link."""
Sizes = dict[Name, int]
"""Number of states of links."""
LINK_STATES = (2, 3)
"""A link has so many states."""
MOST_WAYS = 1024
"""So many combinations of sizes are tried; of what has more, the law is not known."""
LONGEST = 28
"""Letters of a label that come from a file."""
ROW = 30.0
"""Height of a node's row, drawing units: links of one object stand below each other."""


def harmless(text: str, most: int = LONGEST) -> str:
    """Text from a file in one line that is not too long, without signs that cannot be printed."""
    line = " ".join("".join(sign if sign.isprintable() else " " for sign in text).split())
    return line if len(line) <= most else f"{line[: most - 1]}…"


@dataclass(frozen=True)
class Node:
    """An object, or one of several trigger links of an object.

    Attributes:
        link: name of the link, empty for an object that is not told apart.
    """

    object: int
    link: str
    name: str


@dataclass(frozen=True)
class Factor:
    """What stands between causes and effects; both are indices of nodes.

    Attributes:
        key: the same for the same mechanism at all steps.
        label: its kind, parameters and lag.
    """

    key: str
    kind: Kind
    label: str
    causes: tuple[int, ...]
    effects: tuple[int, ...]


class MechanismView:
    """All that pictures tell of the mechanisms of an episode's board.

    Attributes:
        nodes: of the graph; objects that take part in nothing are among them.
        dynamics: None if states or kinds are not known.
    """

    def __init__(self, episode: Episode):
        self.episode, self.board = episode, episode.board
        names = object_names(self.board)
        own = [[link.name for link in episode.links if link.trigger and link.object == i] for i in range(len(names))]
        self.nodes: list[Node] = []
        for index, links in enumerate(own):
            if len(links) < 2:
                self.nodes.append(Node(index, "", names[index]))
            else:
                self.nodes += [Node(index, name, f"{names[index]} {harmless(name)}") for name in links]
        self.dynamics = known_dynamics(episode)

    def node(self, reference: LinkRef) -> int:
        """Index of the node of a link, or of an object."""
        own = [n for n, node in enumerate(self.nodes) if node.object == reference.object]
        return next((n for n in own if self.nodes[n].link == reference.link), own[0])

    def name(self, reference: LinkRef) -> str:
        return self.nodes[self.node(reference)].name

    def _input(self, reference: LinkRef) -> str:
        """A mechanism reads links as they are after the action, responders as they were before it."""
        return self.name(reference) + (" an action ago" if reference.link == BODY else "")

    @cached_property
    def places(self) -> np.ndarray:
        """Where the nodes are, drawing units (N, 2): the objects' places, links of one object below each other."""
        found = (anchors(self.episode) * drawing_scale(self.episode))[[node.object for node in self.nodes]]
        for index in {node.object for node in self.nodes}:
            own = [n for n, node in enumerate(self.nodes) if node.object == index]
            found[own, 1] += ROW * (np.arange(len(own)) - (len(own) - 1) / 2)
        return found

    def bounds(self, margin: float) -> tuple[np.ndarray, np.ndarray]:
        """Corners of the board without a margin, drawing units."""
        low, high = board_bounds(self.episode, -margin)
        return low * drawing_scale(self.episode), high * drawing_scale(self.episode)

    @cached_property
    def links(self) -> list[LinkRef]:
        """The trigger links, in the order of their states in steps."""
        return [LinkRef(object=link.object, link=link.name) for link in self.episode.links if link.trigger]

    @cached_property
    def link_names(self) -> list[str]:
        return list(map(self.name, self.links))

    def object_name(self, index: int) -> str:
        return object_names(self.board)[index]

    @cached_property
    def held(self) -> list[tuple[int, int]]:
        """Steps with actions that took hold of a link while a lock held it, and the link's number."""
        if self.dynamics is None:
            return []
        numbers = {(link.object, link.link): number for number, link in enumerate(self.links)}
        found = ((k, numbers.get((s.acted_object, s.acted_link)), s) for k, s in enumerate(self.episode.steps, start=1))
        law = self.dynamics
        return [(k, n) for k, n, s in found if n is not None and law.locked(n, s.responder_states_before)]

    @property
    def moments(self) -> list[int]:
        """Steps with which the graph begins or becomes another one, up to the recording's last."""
        last = len(self.episode.steps)
        return sorted({period.since for period in periods(self.board) if period.since <= last} | {0})

    def factors(self, step: int) -> list[Factor]:
        """The graph's typed edges at a step."""
        holding = [period for period in periods(self.board) if period.holds(step)]
        shown = [one for one in holding if one.relation.kind != Rest.kind]
        found = [self._factor(period) for period in shown if period.relation.triggers or not _stream(period.relation)]
        for stream in sorted({_stream(period.relation) for period in holding} - {""}):
            moved = tuple(self._effect(p.relation) for p in holding if _stream(p.relation) == stream)
            found.append(Factor(f"clock {stream}", "clock", "hidden clock", (), moved))
        for number, lock in enumerate(self.board.locks):
            keys = " or ".join(map(str, lock.states))
            causes, effects = (self.node(LinkRef(object=lock.responder, link=BODY)),), (self.node(lock.link),)
            found.append(Factor(f"lock {number}", "lock", f"unlocks in {keys}", causes, effects))
        return found

    def _factor(self, period: Period) -> Factor:
        relation, mechanism = period.relation, self._mechanism(period)
        known = _kind(relation) if mechanism is None else mechanism
        kind: Kind = "chance" if known is not None and known.draws else "mechanism"
        causes = tuple(map(self.node, relation.triggers))
        key = f"{relation.responder} from {period.since}"
        return Factor(key, kind, label(relation, mechanism), causes, (self._effect(relation),))

    def _effect(self, relation: Relation) -> int:
        return self.node(LinkRef(object=relation.responder, link=BODY))

    def _mechanism(self, period: Period) -> Mechanism | None:
        if self.dynamics is None:
            return None
        return self.dynamics.mechanism(period.relation.responder, max(period.since - 1, 0))

    @cached_property
    def sentences(self) -> list[tuple[str, str]]:
        """Who, and what is true of it: responders, then locks, then links that control nothing."""
        names, found = object_names(self.board), []
        for period in periods(self.board):
            mechanism, inputs = self._mechanism(period), list(map(self._input, period.relation.triggers))
            words = harmless(period.relation.kind) + (f" of {', '.join(inputs)}" if inputs else "")
            words = words if mechanism is None else harmless(mechanism.sentence(inputs), 240)
            words = f"from step {period.since} on {words}" if period.since else words
            words += f", until step {period.until - 1}" if period.until is not None else ""
            found.append((names[period.relation.responder], words))
        for lock in self.board.locks:
            states = " or ".join(map(str, lock.states))
            found.append((self.name(lock.link), f"moves only while {names[lock.responder]} shows {states}"))
        return found + [(self.name(link), "controls nothing") for link in self.board.idle]

    @cached_property
    def changes(self) -> list[Change]:
        """What every recorded change of a responder goes back to; nothing where that is not known."""
        return [] if self.dynamics is None else changes(self.dynamics, _triggers(self.episode))

    @property
    def unexplained(self) -> str:
        """What pictures have to leave out of a recording, in words; empty if the board's law is known."""
        if self.dynamics is not None or not self.episode.steps or not self.board.relations:
            return ""
        held = ", and when locks hold links," if self.board.locks else ""
        return f"what changes go back to{held} is not known here"

    def moved(self, step: int) -> list[int]:
        """Nodes of the links that the action which led to a step moved."""
        if not 0 < step <= len(self.episode.steps):
            return []
        done = self.episode.steps[step - 1]
        states = zip(self.links, done.trigger_states_before, done.trigger_states_after, strict=False)
        return [self.node(link) for link, before, after in states if before != after]

    def because(self, change: Change) -> str:
        """Why a responder changed: "switch 2 at step 5", "a hidden clock", "by itself", "rewired"."""
        if change.rewired:
            return "rewired"
        if change.cause is None or self.dynamics is None:
            then = [one for one in relations_at(self.board, change.step) if one.responder == change.responder]
            return "a hidden clock" if any(map(_stream, then)) else "by itself"
        index, link = self.dynamics.links.names[change.link or 0]
        return f"{self.name(LinkRef(object=index, link=link))} at step {change.cause}"


def mechanism_view(episode: Episode) -> MechanismView | None:
    """What pictures tell of the mechanisms; None in the paper's world, which a graph of objects tells all about."""
    return None if episode.board.world == PAPER else MechanismView(episode)


def label(relation: Relation, mechanism: Mechanism | None) -> str:
    """Kind, parameters and, where it is not 0, lag: "NAND", "delay 2, lag 2", "unreliable 0.8, lag 0+"."""
    told = [value for name, value in relation.parameters.items() if name != "stream"]
    words = harmless(" ".join(map(str, [relation.kind, *told])))
    if relation.kind == Gate.kind and "function" in relation.parameters:
        words = harmless(str(relation.parameters["function"])).upper()  # a logic gate has its function's name
    if mechanism is None or not relation.triggers:
        return words
    lags = sorted({lag(mechanism, reference) for reference in relation.triggers})
    later = "+" if mechanism.draws else ""
    return words if lags == [0] and not later else f"{words}, lag {' and '.join(map(str, lags))}{later}"


def _stream(relation: Relation) -> str:
    return harmless(str(relation.parameters.get("stream", "")))


def _triggers(episode: Episode) -> list[tuple[int, ...]]:
    """States of the trigger links on the new board and after each action."""
    steps = episode.steps
    return [steps[0].trigger_states_before, *(step.trigger_states_after for step in steps)] if steps else []


def _kind(relation: Relation) -> type[Mechanism] | None:
    """A relation's kind; None if nobody here knows it."""
    with suppress(BusybotError):
        return kind_named(relation.kind)
    return None


def known_dynamics(episode: Episode) -> Dynamics | None:
    """The board's law with the links' numbers of states that fit the recording; None if none do, or none was found.

    Tables and what was seen leave few links in doubt. Those that have no responder in common are tried apart.
    """
    names = [(link.object, link.name) for link in episode.links if link.trigger]
    recorded = _triggers(episode)
    if not names or not recorded or len(set(names)) < len(names):
        return None
    relations = [period.relation for period in periods(episode.board)]
    choices = _choices(episode, names, recorded, relations)
    groups = _groups(choices, relations)
    if not all(choices.values()) or sum(_count(choices, own) for own in groups) > MOST_WAYS:
        return None
    ways = [_ways(choices, own) for own in groups]
    if not all(ways):
        return None
    sizes = {name: own[0] for name, own in choices.items()}
    for tried in ways:
        sizes |= tried[0]
    for own, tried in zip(groups, ways, strict=True):
        moved = {relation.responder for relation in own}
        sizes |= next((way for way in tried if _law(episode, sizes | way, recorded, moved)), tried[0])
    return _law(episode, sizes, recorded, range(len(episode.board.objects)))


def _law(
    episode: Episode, sizes: Sizes, recorded: Sequence[tuple[int, ...]], responders: Iterable[int]
) -> Dynamics | None:
    """The law with these sizes, if these responders show under it what they were recorded to show."""
    own = list(responders)
    with suppress(BusybotError, IndexError):  # sizes, kinds or states that do not fit together
        dynamics = Dynamics(episode.board, Links(tuple(sizes), tuple(sizes.values())))
        states = zip(dynamics.run(recorded)[1:], (step.responder_states_after for step in episode.steps), strict=True)
        if all(state.shown[one] == after[one] for state, after in states for one in own):
            return dynamics
    return None


def _choices(
    episode: Episode, names: Sequence[Name], recorded: Sequence[tuple[int, ...]], relations: Sequence[Relation]
) -> dict[Name, list[int]]:
    """Numbers of states that each link may have, the fewest first: more than were seen, and what tables ask for."""
    board = episode.board
    drawn = tuple(state for placed in board.objects for state in placed.states)
    rows = [*recorded, drawn, board.task.goal if board.task else ()]
    choices = {}
    for number, name in enumerate(names):
        least = max((LINK_STATES[0], *(row[number] + 1 for row in rows if number < len(row))))
        choices[name] = [size for size in LINK_STATES if size >= least] or [least]
    before: list[int] = []
    while before != (before := [len(own) for own in choices.values()]):
        for relation in relations:
            if _count(choices, [relation]) <= MOST_WAYS:
                ways = _ways(choices, [relation])
                choices |= {name: sorted({way[name] for way in ways}) for name in _inputs(choices, [relation])}
    return choices


def _inputs(choices: Mapping[Name, list[int]], relations: Iterable[Relation]) -> list[Name]:
    """The links that relations read, in the board's order."""
    read = {(one.object, one.link) for relation in relations for one in relation.triggers}
    return [name for name in choices if name in read]


def _count(choices: Mapping[Name, list[int]], relations: Sequence[Relation]) -> int:
    """How many combinations of sizes the inputs of relations may have, before tables are asked."""
    return prod(len(choices[name]) for name in _inputs(choices, relations))


def _ways(choices: Mapping[Name, list[int]], relations: Sequence[Relation]) -> list[Sizes]:
    """Sizes of the inputs of relations that fit all their tables, the fewest states first."""
    names = _inputs(choices, relations)
    ways = [dict(zip(names, sizes, strict=True)) for sizes in product(*(choices[name] for name in names))]
    fitting = [way for way in ways if all(_fits(relation, way) for relation in relations)]
    return sorted(fitting, key=lambda way: sum(way.values()))


def _groups(choices: Mapping[Name, list[int]], relations: Iterable[Relation]) -> list[list[Relation]]:
    """Relations that depend on links in doubt; those that have such a link or a responder in common are together."""
    groups: list[tuple[set[Name], list[Relation]]] = []
    for relation in relations:
        read = {(one.object, one.link) for one in relation.triggers}
        marks = {name for name in read if name[1] == BODY or len(choices.get(name, ())) > 1}
        marks.add((relation.responder, BODY))
        joined = [one for one in groups if one[0] & marks]
        own = [other for _, others in joined for other in others]
        groups = [one for one in groups if not one[0] & marks]
        groups.append((marks.union(*(one[0] for one in joined)), [*own, relation]))
    return [own for _, own in groups if _count(choices, own) > 1]


def _fits(relation: Relation, sizes: Sizes) -> bool:
    """Whether the table lists as many states as inputs of these sizes ask for."""
    kind = _kind(relation)
    inputs = [sizes.get((one.object, one.link)) for one in relation.triggers if one.link != BODY]
    if kind is None or None in inputs or len(inputs) < len(relation.triggers):
        return True
    return kind.rows([size for size in inputs if size is not None]) == len(relation.states)
