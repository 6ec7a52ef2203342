"""Goals of boards, and drawing them (paper section 5.3).

Relations decide which responders a task is about: those that some link controls, the *affectable* ones. Success is the
share of them in their goal state; what the triggers look like does not count.

The ground truth of a task is privileged: agents see a goal image, nothing of this module.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

from busybot.boards.dynamics import Dynamics, DynamicState, Links, Triggers
from busybot.boards.relations import responder_state
from busybot.boards.spec import BODY, PAPER, BoardSpec, LinkRef, PlacedObject, Task
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.objects.model import ObjectModel

MAX_STEPS = 8
"""Steps in which a task is to be solved."""
GOAL_TRIES = 1000
REACH = "reach"
"""Kind of the tasks of all worlds but the paper's."""
SEARCHED = 2000
"""A board's plans are looked for among so many states."""
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
    """Indices of the responders that a trigger link controls, itself or through other responders, in ascending
    order."""
    found: set[int] = set()
    while True:
        more = {
            relation.responder
            for relation in board.relations
            if any(ref.link != BODY or ref.object in found for ref in relation.triggers)
        }
        if more == found:
            return tuple(sorted(found))
        found = more


def responder_states(board: BoardSpec, triggers: Sequence[int]) -> tuple[int, ...]:
    """What every object shows while the trigger links rest in these states.

    Returns:
        a state per object; -1 for triggers, 0 for responders that nothing controls. As `Step.responder_states_after`.

    Raises:
        BusybotError: the board is of another world than the paper's, where more than these states decides.
    """
    if board.world != PAPER:
        what = (
            f"board {board.index} is of the world {board.world!r}: what it shows does not follow from its links alone"
        )
        raise BusybotError(what, "ask boards.dynamics.Dynamics")
    number = {(link.object, link.link): n for n, link in enumerate(task_of(board).links)}
    shown = [-1 if placed.role == "trigger" else 0 for placed in board.objects]
    for relation in board.relations:
        trigger = relation.triggers[0]
        shown[relation.responder] = responder_state(relation, triggers[number[trigger.object, trigger.link]])
    return tuple(shown)


def goal_responders(board: BoardSpec) -> tuple[int, ...]:
    """Goal state of every object's responder, as `responder_states` gives them."""
    task = task_of(board)
    return responder_states(board, task.goal) if task.responders is None else task.responders


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


def shortest_plan(board: BoardSpec) -> int:
    """Steps that the board's task takes at the least from its start."""
    task = task_of(board)
    return least_steps(start_states(board), task.goal) if task.shortest is None else task.shortest


def with_reachable_goal(board: BoardSpec, links: Links, steps: int) -> BoardSpec | None:
    """The board with a goal that a plan of up to `steps` actions reaches, whose length is the shortest there is.

    The plans are those of a board without luck (`Dynamics`): whatever may fail succeeds. They end before a mechanism
    changes. A number of actions is drawn evenly among those that lead somewhere new, then one of the states of the
    affectable responders that take so many. Where links are held, it is a state that needs as many of them as can be.

    Returns:
        None if no action changes any of them.
    """
    judged, start = affectable(board), start_states(board)
    dynamics = Dynamics(board, links, lucky=False)
    steps = min([steps, *(one.step for one in board.rewirings)])
    found = _first_seen(judged, reachable(dynamics, start, steps))
    found.pop(_judged(judged, dynamics.start(start)))
    for lock in reversed(board.locks):
        without = _first_seen(judged, reachable(dynamics, start, steps, stuck=dynamics.number(lock.link)))
        behind = {looks: seen for looks, seen in found.items() if looks not in without}
        if behind:
            found = behind
            break
    goals: dict[int, list[tuple[Triggers, tuple[int, ...]]]] = {}
    for depth, triggers, shown in found.values():
        goals.setdefault(depth, []).append((triggers, shown))
    # more than one action where there is anything
    depths = sorted(goals.keys() - {1}) or sorted(goals)
    if not depths:
        return None
    rng = generator(board.seed, board.split, board.index, "task")
    shortest = depths[int(rng.integers(len(depths)))]
    goal, shown = goals[shortest][int(rng.integers(len(goals[shortest])))]
    names = tuple(LinkRef(object=index, link=name) for index, name in links.names)
    task = Task(kind=REACH, links=names, goal=goal, responders=shown, shortest=shortest)
    return BoardSpec.model_validate({**dict(board), "task": task})


Seen = dict[tuple[int, ...], tuple[int, Triggers, tuple[int, ...]]]
"""By what affectable responders show: number of actions, trigger links' states, what all show."""


def _judged(judged: Sequence[int], state: DynamicState) -> tuple[int, ...]:
    return tuple(state.shown[index] for index in judged)


def _first_seen(judged: Sequence[int], states: Iterable[tuple[int, Triggers, DynamicState]]) -> Seen:
    """Where each look of the affectable responders is seen first."""
    seen: Seen = {}
    for depth, triggers, state in states:
        seen.setdefault(_judged(judged, state), (depth, triggers, state.shown))
    return seen


def reachable(
    dynamics: Dynamics, start: Triggers, steps: int, most: int = SEARCHED, stuck: int | None = None
) -> Iterator[tuple[int, Triggers, DynamicState]]:
    """States that actions lead to from a new board, breadth first: number of actions, trigger links' states, state.

    Args:
        steps, most, stuck: as of `ways`.
    """
    for way, state in ways(dynamics, start, dynamics.start(start), steps, most, stuck):
        yield len(way), way[-1] if way else start, state


def ways(
    dynamics: Dynamics,
    triggers: Triggers,
    state: DynamicState,
    steps: int,
    most: int = SEARCHED,
    stuck: int | None = None,
) -> Iterator[tuple[tuple[Triggers, ...], DynamicState]]:
    """The shortest way to each state that actions lead to, breadth first: the trigger links' states after each action.

    An action moves one link that nothing holds into a neighbouring state, or moves nothing.

    Args:
        triggers, state: where all ways begin.
        steps: no longer ways are looked for.
        most: the search ends before a number of actions that would lead to more states than this in all.
        stuck: number of a link that no action moves.
    """
    frontier: list[tuple[tuple[Triggers, ...], Triggers, DynamicState]] = [((), triggers, state)]
    seen = {(triggers, state.shown, state.memories)}
    yield (), state
    for _ in range(steps):
        following = []
        for way, here, now in frontier:
            for moved in dynamics.moves(here, now):
                if stuck is not None and moved[stuck] != triggers[stuck]:
                    continue
                after = dynamics.step(moved, now)
                key = (moved, after.shown, after.memories)
                if key not in seen:
                    seen.add(key)
                    following.append(((*way, moved), moved, after))
        if len(seen) > most:
            return
        for way, _, after in following:
            yield way, after
        frontier = following


def way_to_goal(
    board: BoardSpec, dynamics: Dynamics, triggers: Triggers, state: DynamicState, steps: int, most: int = SEARCHED
) -> tuple[Triggers, ...] | None:
    """The trigger links' states after each action of a shortest plan that brings all affectable responders into their
    goal states; None if no plan is found.

    Args:
        triggers, state: from where.
        steps, most: as of `ways`.
    """
    found = ways(dynamics, triggers, state, steps, most)
    return next((way for way, there in found if all(reached(board, there.shown).values())), None)


def drivers(board: BoardSpec, responder: int) -> set[tuple[int, str]]:
    """The trigger links, by object and name, that control a responder, itself or through other responders."""
    found: set[tuple[int, str]] = set()
    waiting, known = [responder], {responder}
    while waiting:
        index = waiting.pop()
        inputs = [ref for relation in board.relations if relation.responder == index for ref in relation.triggers]
        found |= {(ref.object, ref.link) for ref in inputs if ref.link != BODY}
        others = {ref.object for ref in inputs if ref.link == BODY} - known
        known |= others
        waiting += sorted(others)
    return found


def with_task(board: BoardSpec, models: Sequence[ObjectModel], kind: Literal["one-to-one", "one-to-many"]) -> BoardSpec:
    """The board with a task drawn for it; multi-direction links start in the middle, the others as on the board.

    The rule: the goal state of every link is drawn evenly among its states, all links again until at least one
    affectable responder differs from the start and the goal takes at most `MAX_STEPS` steps. The paper does not tell
    its rule. With this one an agent that does nothing finds some four of ten responders in their goal state (Table 3).

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
