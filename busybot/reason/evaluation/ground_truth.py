"""True relations and states of a recorded board, for evaluators only.

Nothing in `busybot.reason` that infers or predicts may import this module.
"""

from dataclasses import dataclass

import numpy as np

from busybot.episodes.episode import Episode

NOTHING_HELD = "nothing held"
"""Kind of a step whose action took hold of no trigger link."""


@dataclass(frozen=True)
class GraphTruth:
    """The relations of a board between trigger and responder objects, links collapsed. N objects.

    Attributes:
        candidates: bool (N, N), a trigger in the row and a responder in the column.
        edges: bool (N, N), the true relations.
        kinds: of the relations of each true edge: usually one.
        shown: int (N, N), number of steps after which the edge's effect had been visible once, 0 for never; None where
            the recording does not know states. An effect is visible when an action on the trigger changed the state of
            the responder and both objects show in the first frame.
    """

    candidates: np.ndarray
    edges: np.ndarray
    kinds: dict[tuple[int, int], tuple[str, ...]]
    shown: np.ndarray | None


def truth_of(episode: Episode) -> GraphTruth:
    """Read the truth from the board and the privileged part of the steps."""
    roles = np.array([placed.role for placed in episode.board.objects])
    candidates = (roles == "trigger")[:, None] & (roles == "responder")[None]
    kinds: dict[tuple[int, int], tuple[str, ...]] = {}
    for relation in episode.board.relations:
        for trigger in relation.triggers:
            pair = (trigger.object, relation.responder)
            kinds[pair] = tuple(sorted({*kinds.get(pair, ()), relation.kind}))
    edges = np.array(episode.board.relation_matrix(), bool).reshape(candidates.shape)
    return GraphTruth(candidates, edges & candidates, kinds, _shown(episode, edges))


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
        links: int (T,), which trigger link was held, as an index into the episode's links; -1 for none.
        success: bool (T,), whether the action changed a trigger's state.
        kinds: T times the kind of the held link's relation; `NOTHING_HELD` for none.
    """

    states: np.ndarray
    links: np.ndarray
    success: np.ndarray
    kinds: tuple[str, ...]


def states_of(episode: Episode) -> StateTruth | None:
    """Read the states from the privileged part of the steps; None where a recording does not know them."""
    objects, steps = len(episode.board.objects), episode.steps
    told = [s.responder_states_before for s in steps[:1]] + [s.responder_states_after for s in steps]
    if not told or any(len(states) != objects for states in told):
        return None
    place = {(link.object, link.name): index for index, link in enumerate(episode.links)}
    kind_of = {(t.object, t.link): relation.kind for relation in episode.board.relations for t in relation.triggers}
    held = [(step.acted_object, step.acted_link) for step in steps]
    return StateTruth(
        states=np.array(told, int),
        links=np.array([place.get(link, -1) if link in kind_of else -1 for link in held], int),
        success=np.array([step.success for step in steps], bool),
        kinds=tuple(kind_of.get(link, NOTHING_HELD) for link in held),
    )
