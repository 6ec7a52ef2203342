"""What a board's task asks for, and drawing one (paper section 5.3, protocol "Planning").

Relations decide which responders a task is about: those that some link controls, the *affectable* ones. Success is the
share of them in their goal state; what the triggers look like does not count.

The ground truth of a task is privileged: agents see a goal image, nothing of this module.
"""

from collections.abc import Sequence

from busybot.boards.relations import responder_state
from busybot.boards.spec import BoardSpec, Task

MAX_STEPS = 8
"""Steps in which a task is to be solved."""


def task_of(board: BoardSpec) -> Task:
    """The board's task; ValueError if it has none."""
    if board.task is None:
        raise ValueError(f"board {board.index} has no task")
    return board.task


def start_states(board: BoardSpec) -> tuple[int, ...]:
    """Initial state of every trigger link, in the board's order."""
    return tuple(state for placed in board.objects for state in placed.states)


def affectable(board: BoardSpec) -> tuple[int, ...]:
    """Indices of the responders that a trigger link controls, in ascending order."""
    return tuple(sorted({relation.responder for relation in board.relations}))


def responder_states(board: BoardSpec, triggers: Sequence[int]) -> tuple[int, ...]:
    """What every object shows while the trigger links rest in these states.

    Returns:
        a state per object; -1 for triggers, 0 for responders that nothing controls. As `Step.responder_states_after`.
    """
    number = {(link.object, link.link): n for n, link in enumerate(task_of(board).links)}
    shown = [-1 if placed.role == "trigger" else 0 for placed in board.objects]
    for relation in board.relations:
        trigger = relation.triggers[0]
        shown[relation.responder] = responder_state(relation, triggers[number[trigger.object, trigger.link]])
    return tuple(shown)


def goal_responders(board: BoardSpec) -> tuple[int, ...]:
    """Goal state of every object's responder, as `responder_states` gives them."""
    return responder_states(board, task_of(board).goal)


def reached(board: BoardSpec, responders: Sequence[int]) -> dict[int, bool]:
    """Whether each affectable responder is in its goal state.

    Args:
        responders: a state per object, e.g. `Step.responder_states_after`.
    """
    wanted = goal_responders(board)
    return {index: responders[index] == wanted[index] for index in affectable(board)}


def least_steps(start: Sequence[int], goal: Sequence[int]) -> int:
    """Steps that lead from one set of trigger states to another at the least.

    An action moves one link into a neighbouring state: a two-state link needs one step, a multi-direction link one
    from the middle to an end and two from end to end.
    """
    return sum(abs(there - here) for here, there in zip(start, goal, strict=True))
