"""Goals of boards, and drawing them (paper section 5.3, protocol "Planning").

Relations decide which responders a task is about: those that some link controls, the *affectable* ones. Success is the
share of them in their goal state; what the triggers look like does not count.

The ground truth of a task is privileged: agents see a goal image, nothing of this module.
"""

from collections.abc import Sequence
from typing import Literal

from busybot.boards.relations import responder_state
from busybot.boards.spec import BoardSpec, LinkRef, PlacedObject, Task
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.objects.model import ObjectModel

MAX_STEPS = 8
"""Steps in which a task is to be solved."""
GOAL_TRIES = 1000
MIDDLE = 1
"""State in which a multi-direction link starts."""


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


def with_task(board: BoardSpec, models: Sequence[ObjectModel], kind: Literal["one-to-one", "one-to-many"]) -> BoardSpec:
    """The board with a task drawn for it; multi-direction links start in the middle, the others as on the board.

    The rule: the goal state of every link is drawn evenly among its states, all links again until at least one
    affectable responder differs from the start and the goal takes at most `MAX_STEPS` steps. The paper does not tell
    its rule. With this one an agent that does nothing finds 38 % of the responders of a one-to-one task and about 45 %
    of a one-to-many task in their goal state, which are the protocol's numbers.

    Args:
        models: of the board's objects, in order.

    Raises:
        BusybotError: no goal was found, because the board has too many links.
    """
    links = [(index, link) for index, model in enumerate(models) for link in model.trigger_links]
    names = tuple(LinkRef(object=index, link=link.name) for index, link in links)
    objects = tuple(_centred(placed, model) for placed, model in zip(board.objects, models, strict=True))
    rng = generator(board.seed, board.split, board.index, "task")
    for _ in range(GOAL_TRIES):
        goal = tuple(int(rng.integers(link.states)) for _, link in links)
        task = Task(kind=kind, links=names, goal=goal)
        found = BoardSpec.model_validate({**dict(board), "objects": objects, "task": task})
        start = start_states(found)
        solved = all(reached(found, responder_states(found, start)).values())
        if not solved and least_steps(start, goal) <= MAX_STEPS:
            return found
    what = f"board {board.index} has {len(links)} trigger links: no goal within {MAX_STEPS} steps was found"
    raise BusybotError(what, "ask for fewer switches")


def _centred(placed: PlacedObject, model: ObjectModel) -> PlacedObject:
    links = zip(model.trigger_links, placed.states, strict=True)
    states = tuple(MIDDLE if link.kind == "multi-direction" else state for link, state in links)
    return placed.model_copy(update={"states": states})
