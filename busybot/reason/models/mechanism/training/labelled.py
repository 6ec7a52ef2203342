"""Labelled traces: recorded boards as pictures show them, and boards that are drawn and moved without a simulator.

Labels are the true parents of boards of the training split, from which step on others were, which objects and links
were held, and which way round links are (amortised inference); of drawn boards also how many states links have.
Nothing else that is privileged is read, and nothing at all when boards are judged.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch

from busybot.boards.config import BoardConfig
from busybot.boards.dynamics import Dynamics, DynamicState, Links, Triggers
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BODY, BoardSpec
from busybot.boards.true_causes import periods
from busybot.boards.worlds import links_of
from busybot.common.rng import generator
from busybot.episodes.episode import Episode
from busybot.objects.library import Library
from busybot.reason.models.mechanism.config import Blur
from busybot.reason.models.mechanism.contexts import Trace
from busybot.reason.models.mechanism.evidence import EITHER, SCALE
from busybot.reason.models.mechanism.networks import BoardFacts, explanation_graph, forbid, moments_of
from busybot.reason.models.mechanism.perception import Perceived
from busybot.reason.models.mechanism.rising import FORM, forms_of
from busybot.reason.models.mechanism.training.pictured import STILL, pictured, way_round
from busybot.reason.models.mechanism.unseen import Touched
from busybot.reason.pyg import HeteroData

Named = tuple[int, str]
"""Object and link; a responder is its `BODY`."""


@dataclass(frozen=True)
class LabelledTriggers:
    """The first T actions of a recording, with what they tell of O triggers.

    Attributes:
        deciding: bool (O, R), which of these triggers decide which responders after the last of them, by whatever link.
        rising: float (L,), log odds that the states of links that these actions moved are numbered as they rise, as
            their looks tell; None if they do not.
    """

    touched: Touched
    deciding: np.ndarray
    rising: np.ndarray | None = None


@dataclass(frozen=True)
class LabelledLinks:
    """What is true of L links.

    Attributes:
        rises: int (L,), 1 where states are numbered as they rise, -1 where the other way round, 0 where nobody knows.
        forms: float32 (L, FORM), what they look like, as of `rising.forms_of`; (0, FORM) of a board without pictures.
        objects: names of the objects that they are of; none of such a board.
    """

    rises: np.ndarray
    forms: np.ndarray = field(default_factory=lambda: np.zeros((0, FORM), np.float32))
    objects: tuple[str, ...] = ()


@dataclass(frozen=True)
class LabelledTrace:
    """A board's trace and what was true.

    Attributes:
        world: in which the board was drawn; "" where nobody says.
        parents: bool (T, I, R), the inputs that decided each responder after each action; None if nobody says.
        changed: bool (T, R), whether another mechanism than at first did; None if nobody says.
        triggers: what a recording told of its triggers after some numbers of actions; none for drawn boards.
        links: what is true of its links; None if nobody says.
        rising: float (L,), log odds that these are numbered as they rise, as their looks tell; None if they do not.
        unsteady: whether the camera was not still.
    """

    trace: Trace
    world: str
    parents: np.ndarray | None = None
    changed: np.ndarray | None = None
    triggers: tuple[LabelledTriggers, ...] = ()
    links: LabelledLinks | None = None
    rising: np.ndarray | None = None
    unsteady: bool = False

    @property
    def actions(self) -> int:
        """T."""
        return len(self.trace.links) - 1

    def graph(self, after: Sequence[int], world: int = 0) -> HeteroData:
        """See `explanation_graph`; with what is true of the board, or else with what explanations foretold."""
        if self.parents is None or self.changed is None:
            return self._foretold(after, world)
        steps = np.maximum(np.asarray(after) - 1, 0)
        told, moved = BoardFacts(world, self.rising, self.unsteady), self._moved(after)
        graph = explanation_graph(self.trace, after, told, parents=self.parents[steps] & moved[..., None])
        forbid(graph, torch.from_numpy(~moved.T))
        graph["responder"].changed = torch.from_numpy(self.changed[steps].T.copy())
        return graph

    def _foretold(self, after: Sequence[int], world: int) -> HeteroData:
        """With `later`, float32 (R * H, K): log probability that explanations gave to all that was shown after that."""
        graph = explanation_graph(self.trace, [*after, self.actions], BoardFacts(world))
        logs = SCALE * graph["explanation"].evidence[..., EITHER]
        graph["explanation"].later = logs[:, -1:] - logs
        graph = moments_of(graph, torch.arange(len(after)))
        forbid(graph, torch.from_numpy(~self._moved(after).T))
        return graph

    def _moved(self, after: Sequence[int]) -> np.ndarray:
        """bool (K, I), inputs that a recording knows that ends after so many actions each: responders, and links that
        have moved by then. Others must explain nothing yet: while they are there, what no known link explains is
        theirs; where a recording ends before they move, it must not seem to be a known one's for that."""
        links = np.cumsum(self.trace.links != self.trace.links[0], axis=0)[np.asarray(after)] > 0
        return np.pad(links, ((0, 0), (0, self.trace.responders.shape[1])), constant_values=True)


WORKS = 0.97
"""Share of actions on drawn boards that move their link, if nothing holds it."""


def labelled(episode: Episode, seen: Perceived, touched: Sequence[Touched] = ()) -> LabelledTrace:
    """A recorded board. A link that was seen is the true one that most of its actions held.

    Args:
        touched: what parts of the recording tell of its triggers, each as if nothing had followed.
    """
    held = [(step.acted_object, step.acted_link) for step in episode.steps]
    inputs: list[Named] = []
    for link in range(len(seen.links.owners)):
        own = [held[step] for step in np.flatnonzero(seen.links.clusters == link)]
        inputs.append(max(sorted(set(own)), key=own.count))
    inputs += [(int(index), BODY) for index in seen.responders]
    board, responders, steps = episode.board, seen.responders.tolist(), len(episode.steps)
    true = true_parents(board, inputs, responders, steps), true_changes(board, responders, steps)
    triggers = (
        LabelledTriggers(one, true_triggers(board, one.triggers.tolist(), responders, len(one.acted)))
        for one in touched
    )
    links = inputs[: len(seen.links.owners)]
    told = LabelledLinks(
        true_rises(episode, seen.trace, links), forms_of(seen.links), tuple(board.objects[one].key for one, _ in links)
    )
    return LabelledTrace(seen.trace, board.told_world, *true, tuple(triggers), told, unsteady=seen.links.steadied)


def true_rises(episode: Episode, trace: Trace, links: Sequence[Named]) -> np.ndarray:
    """int (L,), as of `LabelledLinks`."""
    true = np.array(
        [step.trigger_states_before for step in episode.steps[:1]]
        + [step.trigger_states_after for step in episode.steps]
    )
    held = [(step.acted_object, step.acted_link) for step in episode.steps]
    found = np.zeros(len(links), int)
    for number, link in enumerate(links):
        moved = (true[1:] != true[:-1])[[one == link for one in held]].sum(0)
        if moved.any():
            found[number] = way_round(true[:, moved.argmax()], trace.links[:, number])
    return found


def true_parents(board: BoardSpec, inputs: Sequence[Named], responders: Sequence[int], actions: int) -> np.ndarray:
    """bool (T, I, R), as of `LabelledTrace`."""
    place = {int(index): number for number, index in enumerate(responders)}
    found = np.zeros((actions, len(inputs), len(place)), bool)
    for period in periods(board):
        read = {(ref.object, ref.link) for ref in period.relation.triggers}
        rows = [row for row, one in enumerate(inputs) if one in read]
        for action in range(actions):
            if period.holds(action + 1) and period.relation.responder in place:
                found[action, rows, place[period.relation.responder]] = True
    return found


def true_triggers(board: BoardSpec, triggers: Sequence[int], responders: Sequence[int], actions: int) -> np.ndarray:
    """bool (O, R), which of these triggers decide which responders after so many actions, by whatever link."""
    read = {(ref.object, ref.link) for one in periods(board) for ref in one.relation.triggers}
    links = sorted(one for one in read if one[1] != BODY)
    of_links = true_parents(board, links, responders, max(1, actions))[-1]
    own = np.array([owner for owner, _ in links]) == np.asarray(triggers)[:, None]
    return np.asarray(own.astype(int) @ of_links > 0)


def true_changes(board: BoardSpec, responders: Sequence[int], actions: int) -> np.ndarray:
    """bool (T, R), as of `LabelledTrace`."""
    steps = [[one.step for one in board.rewirings if one.relation.responder == index] for index in responders]
    first = np.array([min(own, default=actions) for own in steps])
    return np.asarray(np.arange(actions)[:, None] >= first)


def draw_boards(
    world: str, boards: int, seed: int, library: Library, actions: int, blur: Blur | None = None
) -> Iterator[tuple[BoardSpec, LabelledTrace]]:
    """Boards of the training split, on which random links were moved, without a simulator or pictures.

    They are others than `busybot generate` draws with the same seed, which a training may hold out.

    Args:
        blur: tell states as pictures do; None for true states.
    """
    own = int(generator(seed, "train", 0, "mechanisms/drawn boards").integers(2**31))
    config = BoardConfig(world=world, boards=boards, seed=own, group_size=1)
    for number, board in enumerate(generate_boards(config, library)):
        links = links_of([library.get(placed.key) for placed in board.objects])
        responders = [index for index, placed in enumerate(board.objects) if placed.role == "responder"]
        inputs = [*links.names, *((index, BODY) for index in responders)]
        rows, states = _moved_at_random(board, links, actions, generator(seed, world, number, "mechanisms/actions"))
        trace = Trace(np.array(rows), np.array([state.shown for state in states])[:, responders], links.sizes)
        true = true_parents(board, inputs, responders, actions), true_changes(board, responders, actions)
        if blur is not None:
            rng = generator(seed, world, number, "mechanisms/pictures")
            unsteady = bool(rng.random() < blur.unsteady)
            trace, parents, rises = pictured(trace, true[0], blur, rng.random() if unsteady else STILL, rng)
            yield board, LabelledTrace(trace, world, parents, true[1], links=LabelledLinks(rises), unsteady=unsteady)
        else:
            yield board, LabelledTrace(trace, world, *true)


def _moved_at_random(
    board: BoardSpec, links: Links, actions: int, rng: np.random.Generator
) -> tuple[list[Triggers], list[DynamicState]]:
    """States of the links, and of the board, at first and after each of the actions, T + 1 of each; some fail."""
    law = Dynamics(board, links)
    rows = [tuple(state for placed in board.objects for state in placed.states)]
    states = [law.start(rows[0])]
    for _ in range(actions):
        now, link = list(rows[-1]), int(rng.integers(len(links.sizes)))
        there = [one for one in (now[link] - 1, now[link] + 1) if 0 <= one < links.sizes[link]]
        after = there[int(rng.integers(len(there)))]
        if rng.random() < WORKS and not law.locked(link, states[-1].shown):
            now[link] = after
        rows.append(tuple(now))
        states.append(law.step(rows[-1], states[-1]))
    return rows, states
