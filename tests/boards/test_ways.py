"""Plans that are found by going through what actions lead to, and who drives whom."""

from collections.abc import Sequence

from busybot.boards.dynamics import Dynamics
from busybot.boards.spec import BoardSpec, LinkRef, Lock, Relation, Task
from busybot.boards.task import drivers, reachable, shortest_plan, way_to_goal
from tests.reason.worlds import LINKS, play, relation

FIRST, SECOND = relation("one-to-one", (0,), 1, (0, 1)), relation("one-to-one", (3,), 2, (0, 1))


def board_of(
    relations: Sequence[Relation], wanted: tuple[int, ...], shortest: int, locks: Sequence[Lock] = ()
) -> BoardSpec:
    board = play(relations, (None,), "lock").board
    links = tuple(LinkRef(object=index, link=name) for index, name in LINKS.names)
    task = Task(kind="reach", links=links, goal=(1, 1), responders=wanted, shortest=shortest)
    return BoardSpec.model_validate({**dict(board), "task": task, "locks": tuple(locks)})


def way(board: BoardSpec, steps: int = 8) -> tuple[tuple[int, ...], ...] | None:
    dynamics = Dynamics(board, LINKS, lucky=False)
    return way_to_goal(board, dynamics, (0, 0), dynamics.start((0, 0)), steps)


def test_what_holds_a_link_is_moved_first() -> None:
    """The second switch yields only while the lamp of the first burns: to have the door alone, three actions."""
    held = Lock(link=LinkRef(object=3, link="link_0"), responder=1, states=(1,))
    board = board_of([FIRST, SECOND], (-1, 0, 1, -1, 0), 3, [held])
    assert way(board) == ((1, 0), (1, 1), (0, 1)) and shortest_plan(board) == 3
    assert way(board, steps=2) is None
    assert way(board_of([FIRST, SECOND], (-1, 0, 1, -1, 0), 1)) == ((0, 1),)


def test_what_comes_late_is_waited_for() -> None:
    late = relation("delay", (0,), 1, (0, 1), actions=2)
    assert way(board_of([late], (-1, 1, 0, -1, 0), 3)) == ((1, 0), (1, 0), (1, 0))
    assert way(board_of([late], (-1, 0, 0, -1, 0), 1)) == ()


def test_ways_are_as_long_as_their_ends_are_far() -> None:
    board = board_of([FIRST, SECOND], (-1, 1, 1, -1, 0), 2)
    found = {triggers: depth for depth, triggers, _ in reachable(Dynamics(board, LINKS), (0, 0), 4)}
    assert found == {(0, 0): 0, (0, 1): 1, (1, 0): 1, (1, 1): 2}


def test_links_drive_through_other_responders() -> None:
    chain = [FIRST, relation("gate", (1, 3), 2, (0, 0, 0, 1), function="and"), relation("one-to-one", (2,), 4, (0, 1))]
    board = board_of(chain, (-1, 1, 1, -1, 1), 3)
    assert drivers(board, 1) == {(0, "link_0")} and drivers(board, 4) == {(0, "link_0"), (3, "link_0")}
