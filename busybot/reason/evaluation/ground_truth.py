"""True relations and states of a recorded board, and what observed transitions determine, for evaluators only.

Nothing in `busybot.reason` that infers or predicts may import this module.

The bound on Pred-A (`determined`): a transition of a responder is determined when an action on the same trigger link
was *seen* to cause it, or to cause its reverse: the picture to expect is then one that was seen before. Two variants:

- *not knowing* which actions fail: an action on a link is expected to do what the link was seen to do from the
  responder's current state. A failing action is predicted wrongly where that is anything at all. Where several effects
  were seen from this state, the true one counts as determined (contact and direction may tell).
- *knowing* it: a failing action is predicted rightly, the others as above.

An action that held nothing is taken for one on the link that the nearest observed action at the same trigger held, as
far as boxes tell. A reasoner that learns which actions fail can exceed the first variant.
"""

from dataclasses import dataclass

import numpy as np

from busybot.boards.dynamics import Dynamics, Links
from busybot.boards.mechanisms import Mechanism
from busybot.boards.spec import BODY, BoardSpec, LinkRef
from busybot.boards.true_causes import relations_at
from busybot.episodes.episode import Episode

NOTHING_HELD = "nothing held"
"""Kind of a step whose action took hold of no trigger link."""


@dataclass(frozen=True)
class GraphTruth:
    """The relations of a board between trigger and responder objects, links collapsed. N objects.

    Attributes:
        board: whose they are, with those that come later.
        candidates: bool (N, N), a trigger in the row and a responder in the column; none where relations are unknown.
        shown: int (N, N), number of steps after which the effect of an edge that holds at first had been visible once,
            0 for never; None where the recording does not know states. An effect is visible when an action on the
            trigger changed the state of the responder and both objects show in the first frame.
    """

    board: BoardSpec
    candidates: np.ndarray
    shown: np.ndarray | None

    def edges(self, steps: int = 0) -> np.ndarray:
        """bool (N, N), the true relations after so many steps; a rewiring changes them."""
        found = np.zeros_like(self.candidates)
        for pair in self.kinds(steps):
            found[pair] = True
        return found

    def kinds(self, steps: int = 0) -> dict[tuple[int, int], tuple[str, ...]]:
        """Of the relations of each true edge then: usually one."""
        found: dict[tuple[int, int], tuple[str, ...]] = {}
        for relation in relations_at(self.board, steps):
            for trigger in relation.triggers:
                pair = (trigger.object, relation.responder)
                if self.candidates[pair]:
                    found[pair] = tuple(sorted({*found.get(pair, ()), relation.kind}))
        return found


def truth_of(episode: Episode) -> GraphTruth:
    """Read the truth from the board and the privileged part of the steps."""
    roles = np.array([placed.role for placed in episode.board.objects])
    candidates = (roles == "trigger")[:, None] & (roles == "responder")[None] & episode.board.relations_known
    edges = np.array(episode.board.relation_matrix(), bool).reshape(candidates.shape)
    return GraphTruth(episode.board, candidates, _shown(episode, edges))


@dataclass(frozen=True)
class CauseTruth:
    """What decides each object of a board after so many actions. N objects, I inputs.

    Attributes:
        inputs: what may be read, trigger links in the board's order, then responders (`BODY`).
        link_parents: bool (I, N), an input in the row and what it decides in the column.
        object_parents: bool (N, N), the same with an object's inputs taken together.
        mechanisms: of each object, None for triggers and for responders that nothing moves.
        read: of each mechanism the numbers of its inputs, in its order.
        lags: int (I, N), after how many actions an input shows at the earliest; -1 where it is no parent.
    """

    inputs: tuple[LinkRef, ...]
    link_parents: np.ndarray
    object_parents: np.ndarray
    mechanisms: tuple[Mechanism | None, ...]
    read: tuple[tuple[int, ...], ...]
    lags: np.ndarray


def causes_of(board: BoardSpec, links: Links, action: int = 0) -> CauseTruth:
    """What decides what a board shows after the action of that number, from 0; a rewiring changes it.

    Raises:
        BusybotError: a relation is of an unknown kind, or does not fit the links.
    """
    count = len(board.objects)
    responders = [index for index, placed in enumerate(board.objects) if placed.role == "responder"]
    names = [*links.names, *((index, BODY) for index in responders)]
    link_parents, lags = np.zeros((len(names), count), bool), np.full((len(names), count), -1)
    object_parents = np.zeros((count, count), bool)
    mechanisms: list[Mechanism | None] = [None] * count
    read: list[tuple[int, ...]] = [()] * count
    for one in Dynamics(board, links).bound_at(action):
        # a responder's state is read as it was before the action
        late = [one.mechanism.lag + responder for _, responder in one.inputs]
        numbers = tuple(names.index((place, BODY)) if responder else place for place, responder in one.inputs)
        mechanisms[one.responder], read[one.responder] = one.mechanism, numbers
        for number, lag in zip(numbers, late, strict=True):
            link_parents[number, one.responder], lags[number, one.responder] = True, lag
            object_parents[names[number][0], one.responder] = True
    inputs = tuple(LinkRef(object=index, link=name) for index, name in names)
    return CauseTruth(inputs, link_parents, object_parents, tuple(mechanisms), tuple(read), lags)


def trace_of(episode: Episode) -> tuple[np.ndarray, np.ndarray] | None:
    """States of the trigger links, int (T + 1, L), and of all objects, int (T + 1, N), on the new board and after every
    step; None where a recording does not know them. Links are in the board's order."""
    first = episode.steps[:1]
    links = [step.trigger_states_before for step in first] + [step.trigger_states_after for step in episode.steps]
    states = [step.responder_states_before for step in first] + [step.responder_states_after for step in episode.steps]
    count = sum(len(placed.states) for placed in episode.board.objects)
    if not states or any(len(one) != len(episode.board.objects) for one in states):
        return None
    if any(len(one) != count for one in links):
        return None
    return np.array(links, int), np.array(states, int)


def _shown(episode: Episode, edges: np.ndarray) -> np.ndarray | None:
    shown = np.zeros(edges.shape, int)
    visible = np.asarray((episode.images[episode.frame_of[0]].boxes >= 0).all(1))
    for number, step in enumerate(episode.steps):
        before, after = np.array(step.responder_states_before), np.array(step.responder_states_after)
        if len(before) != len(edges) or len(after) != len(edges):
            return None
        trigger = step.acted_object
        if trigger < 0 or not visible[trigger]:
            continue
        first = np.flatnonzero(edges[trigger] & visible & np.asarray(before != after) & (shown[trigger] == 0))
        shown[trigger, first] = number + 1
    return shown


@dataclass(frozen=True)
class StateTruth:
    """What happened on a board of N objects in T steps.

    Attributes:
        states: int (T + 1, N), the responders' states in each frame, -1 for triggers.
        links: int (T,), which link was held that something follows, as an index into the episode's links; -1 for none.
        held: int (T,), which object was held, if it is a trigger; -1 for none.
        success: bool (T,), whether the action changed a trigger's state.
        kinds: T times the kinds of the relations that read the held link then; `NOTHING_HELD` for none.
    """

    states: np.ndarray
    links: np.ndarray
    held: np.ndarray
    success: np.ndarray
    kinds: tuple[tuple[str, ...], ...]


def states_of(episode: Episode) -> StateTruth | None:
    """Read the states from the privileged part of the steps; None where a recording does not know all of them."""
    objects, steps = len(episode.board.objects), episode.steps
    told = [step.responder_states_before for step in steps[:1]] + [step.responder_states_after for step in steps]
    if not told or any(len(states) != objects for states in told):
        return None
    roles, states = [placed.role for placed in episode.board.objects], np.array(told, int)
    if (states[:, [role == "responder" for role in roles]] < 0).any():
        return None
    place = {(link.object, link.name): index for index, link in enumerate(episode.links)}
    controls = {(t.object, t.link) for relation in episode.board.relations for t in relation.triggers}
    held = [(step.acted_object, step.acted_link) for step in steps]
    return StateTruth(
        states=states,
        links=np.array([place.get(link, -1) if link in controls else -1 for link in held], int),
        held=np.array([index if index >= 0 and roles[index] == "trigger" else -1 for index, _ in held], int),
        success=np.array([step.success for step in steps], bool),
        kinds=tuple(_kinds_of(episode.board, link, action) or (NOTHING_HELD,) for action, link in enumerate(held, 1)),
    )


def _kinds_of(board: BoardSpec, link: tuple[int, str], action: int) -> tuple[str, ...]:
    """The kinds of the relations that read a link after an action, from 1."""
    read = (one for one in relations_at(board, action) if link in {(t.object, t.link) for t in one.triggers})
    return tuple(dict.fromkeys(one.kind for one in read))


def determined(
    truth: StateTruth, contacts: np.ndarray, acted: np.ndarray, observed: int, knowing: bool = False, start: int = 0
) -> np.ndarray:
    """Whether each object's state after each step, from `start` on, is determined by the steps before `observed`.

    Args:
        contacts: float (T, 3), the actions' positions, board units.
        acted: int (T,), trigger acted on as far as boxes tell, -1 for none.
        observed: number of steps that were seen, the first ones.
        knowing: whether it is known which actions fail.

    Returns:
        bool (T - start, N).
    """
    before, after = truth.states[:-1], truth.states[1:]
    right = np.ones(before.shape, bool)
    for step in range(start, len(truth.links)):
        held = truth.links[step]
        link = held if held >= 0 else _aimed_at(truth, contacts, acted, observed, step)
        seen = np.flatnonzero((truth.links[:observed] == link) & (link >= 0))
        old, new, was, end = before[seen], after[seen], before[step], after[step]
        repeated, undone = (old != new) & (old == was), (old != new) & (new == was)
        told = ((repeated & (new == end)) | (undone & (old == end))).any(0)
        right[step] = np.where(end != was, told, knowing | ~(repeated | undone).any(0))
    return right[start:]


def _aimed_at(truth: StateTruth, contacts: np.ndarray, acted: np.ndarray, observed: int, step: int) -> int:
    """The link that an action which held nothing was probably meant for, -1 if unknown."""
    near = np.flatnonzero((acted[:observed] == acted[step]) & (acted[step] >= 0))
    near = near[near != step]
    if not len(near):
        return -1
    return int(truth.links[near[np.linalg.norm(contacts[near] - contacts[step], axis=1).argmin()]])
