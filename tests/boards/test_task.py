"""Tasks are what the protocol asks for: reachable, not solved already, and the same for the same seed."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from busybot.boards.config import BoardConfig
from busybot.boards.dynamics import Dynamics, DynamicState
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec, LinkRef, Task
from busybot.boards.task import (
    MAX_STEPS,
    affectable,
    goal_responders,
    least_steps,
    reachable,
    reached,
    responder_states,
    shortest_plan,
    start_states,
    task_of,
    with_reachable_goal,
)
from busybot.boards.worlds import NOVEL, WORLDS
from busybot.boards.worlds import links_of as trigger_links
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.objects.library import Library
from busybot.objects.model import TriggerLink
from busybot.objects.resolve import find
from tests.boards.worlds_by_hand import board as by_hand
from tests.boards.worlds_by_hand import body, link, links, lock, relation, rewiring

SPLITS = ("train", "novel-config", "novel-object")
KINDS = ("one-to-one", "one-to-many")


@pytest.fixture(scope="module", params=["procedural", "real"])
def library(request: pytest.FixtureRequest) -> Library:
    if request.param == "procedural":
        return find("procedural")
    return Library.load(request.getfixturevalue("partnet"))


def links_of(board: BoardSpec, library: Library) -> list[TriggerLink]:
    return [link for placed in board.objects for link in library.get(placed.key).trigger_links]


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("kind", KINDS)
def test_fifty_tasks_of_each_kind_and_split(library: Library, split: str, kind: str) -> None:
    boards = list(generate_boards(BoardConfig(split=split, tasks=kind), library))
    assert len(boards) == 50 == len({board.objects for board in boards})
    for board in boards:
        task, links, start = task_of(board), links_of(board, library), start_states(board)
        assert task.kind == kind and [ref.link for ref in task.links] == [link.name for link in links]
        assert all(state < link.states for state, link in zip(task.goal, links, strict=True))
        assert 1 <= least_steps(start, task.goal) <= MAX_STEPS
        assert not all(reached(board, responder_states(board, start)).values())
        assert all(reached(board, goal_responders(board)).values())
        multi = [link.kind == "multi-direction" for link in links]
        assert all(state == 1 for state, centred in zip(start, multi, strict=True) if centred)
        several = any(len(library.get(placed.key).trigger_links) > 1 for placed in board.objects)
        assert (any(multi), several) == ((True, True) if kind == "one-to-many" else (False, False))


@pytest.mark.parametrize(("kind", "share"), [("one-to-one", 0.38), ("one-to-many", 0.45)])
def test_doing_nothing_reaches_what_the_protocol_says(kind: str, share: float) -> None:
    """Macro over tasks, protocol "Planning"."""
    boards = generate_boards(BoardConfig(tasks=kind, boards=500), find("procedural"))
    shares = [np.mean(list(reached(b, responder_states(b, start_states(b))).values())) for b in boards]
    assert np.mean(shares) == pytest.approx(share, abs=0.03)


def test_a_task_depends_on_its_own_board_alone() -> None:
    library = find("procedural")
    few, many = (list(generate_boards(BoardConfig(tasks="one-to-many", boards=n), library)) for n in (3, 6))
    assert few == many[:3]
    other = next(iter(generate_boards(BoardConfig(tasks="one-to-many", boards=1, seed=1), library)))
    assert other.task != few[0].task
    grouped = list(generate_boards(BoardConfig(tasks="one-to-many", boards=4, group_size=4), library))
    assert len({board.objects for board in grouped}) == 1
    assert len({board.digest() for board in grouped}) == 4 and len({task_of(board).goal for board in grouped}) > 1


def test_only_objects_starts_and_the_task_differ_from_the_board_without() -> None:
    library = find("procedural")
    config = BoardConfig(tasks="one-to-one", boards=5)
    plain = BoardConfig(relations="one-to-one", group_size=1, boards=5)
    for board, other in zip(generate_boards(config, library), generate_boards(plain, library), strict=True):
        assert board.model_copy(update={"task": None}) == other


def test_a_board_without_a_task_is_written_as_before() -> None:
    tiny = Dataset.open(Path(__file__).resolve().parents[2] / "datasets" / "tiny")
    lines = (tiny.path / "boards" / "boards-00000.jsonl").read_text().splitlines()
    for board, line in zip(tiny.boards(), lines, strict=True):
        assert board.task is None and board.model_dump_json() == line and "task" not in board.model_dump()


def board_with_task() -> BoardSpec:
    return next(iter(generate_boards(BoardConfig(tasks="one-to-many", boards=1), find("procedural"))))


def test_a_task_survives_json_and_counts_in_the_digest() -> None:
    board = board_with_task()
    assert BoardSpec.model_validate_json(board.model_dump_json()) == board
    assert board.model_copy(update={"task": None}).digest() != board.digest()


def test_responders_follow_their_relations() -> None:
    board = board_with_task()
    start = start_states(board)
    shown = responder_states(board, start)
    assert [state == -1 for state in shown] == [placed.role == "trigger" for placed in board.objects]
    for number, ref in enumerate(task_of(board).links):
        relation = next(r for r in board.relations if r.triggers[0] == ref)
        for state, expected in enumerate(relation.states):
            after = responder_states(board, (*start[:number], state, *start[number + 1 :]))
            assert after[relation.responder] == expected
            assert [a for i, a in enumerate(after) if i != relation.responder] == [
                s for i, s in enumerate(shown) if i != relation.responder
            ]
    assert set(affectable(board)) == {r.responder for r in board.relations}


def test_an_end_is_one_step_from_the_middle_and_two_from_the_other_end() -> None:
    assert least_steps((1, 0, 1), (2, 1, 1)) == 2
    assert least_steps((0,), (2,)) == 2 and least_steps((1, 1), (1, 1)) == 0


@pytest.mark.parametrize("what", ["goal", "links", "twice", "relation", "responders"])
def test_tasks_that_do_not_fit_their_board_are_refused(what: str) -> None:
    board = board_with_task()
    task = task_of(board)
    owner = task.links[0].object
    several = next(i for i, link in enumerate(task.links[1:], 1) if link.object == task.links[i - 1].object)
    twice = [*task.links]
    twice[several] = twice[several - 1]
    wrong = {
        "goal": {"goal": task.goal[1:]},
        "links": {"links": task.links[1:], "goal": task.goal[1:]},
        "twice": {"links": twice},
        "relation": {"links": (LinkRef(object=owner, link="another"), *task.links[1:])},
        "responders": {"responders": (-1,) * (len(board.objects) - 1)},
    }[what]
    broken = Task.model_validate({**dict(task), **wrong})
    with pytest.raises(ValidationError, match="task"):
        BoardSpec.model_validate({**dict(board), "task": broken})


def test_relations_follow_from_the_tasks_and_cannot_contradict_them() -> None:
    config = BoardConfig(tasks="one-to-many")
    assert (config.relations, config.boards, config.group_size) == ("one-to-many", 50, 1)
    told = BoardConfig(tasks="one-to-one", relations="one-to-one", boards=3, group_size=2)
    assert (told.boards, told.group_size) == (3, 2)
    for relations in ("any", "one-to-many"):
        with pytest.raises(ValidationError, match="leave relations out"):
            BoardConfig(tasks="one-to-one", relations=relations)
    with pytest.raises(ValidationError, match="tasks"):
        BoardConfig(tasks="many-to-one")


def reaching(library: Library, world: str, split: str, boards: int = 8) -> list[tuple[BoardSpec, Dynamics]]:
    """Boards with goals, and their laws without luck."""
    config = BoardConfig(world=world, split=split, tasks="reach", boards=boards)
    found = list(generate_boards(config, library))
    laws = [Dynamics(b, trigger_links([library.get(p.key) for p in b.objects]), lucky=False) for b in found]
    return list(zip(found, laws, strict=True))


def brute_force(board: BoardSpec, law: Dynamics, most: int) -> int | None:
    """Length of the shortest plan of at most so many actions: all of them are tried, nothing is remembered."""

    def done(state: DynamicState) -> bool:
        return all(reached(board, state.shown).values())

    start = start_states(board)
    now = [(start, law.start(start))]
    for count in range(most + 1):
        if any(done(state) for _, state in now):
            return count
        now = [(moved, law.step(moved, state)) for triggers, state in now for moved in law.moves(triggers, state)]
    return None


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("split", ["train", NOVEL])
def test_goals_of_every_world_are_reached_by_their_shortest_plan(library: Library, world: str, split: str) -> None:
    tried = 0
    for board, law in reaching(library, world, split):
        task, start = task_of(board), start_states(board)
        assert task.kind == "reach" and task.responders is not None and shortest_plan(board) == task.shortest
        assert task.shortest is not None and 1 <= task.shortest <= MAX_STEPS
        assert not all(reached(board, law.start(start).shown).values())
        assert all(reached(board, task.responders).values()) and goal_responders(board) == task.responders
        at_goal = [
            depth
            for depth, triggers, state in reachable(law, start, task.shortest, most=10**6)
            if all(reached(board, state.shown).values())
        ]
        assert at_goal and min(at_goal) == task.shortest
        if task.shortest <= 3:
            assert brute_force(board, law, 3) == task.shortest
            tried += 1
    assert tried


def test_the_goal_of_a_board_with_locks_lies_behind_them() -> None:
    """The last of them, where a plan of the length that is allowed can open it; else as many as can be."""
    last = []
    for board, law in reaching(find("procedural"), "lock", "train", boards=20):
        task, start = task_of(board), start_states(board)
        stuck = law.number(board.locks[-1].link)
        without = reachable(law, start, MAX_STEPS, most=10**6, stuck=stuck)
        needs_it = not any(all(reached(board, state.shown).values()) for _, _, state in without)
        assert not needs_it or (task.shortest or 0) > len(board.locks)
        last.append(needs_it)
    assert np.mean(last) > 0.7


def test_a_goal_is_reached_before_anything_is_rewired_and_takes_more_than_one_action_if_it_can() -> None:
    follows, opposite = (relation("one-to-one", 2, [link(0)], table) for table in ((0, 1), (1, 0)))
    other = relation("one-to-one", 3, [link(1)], (0, 1))
    goals = {}
    for name, more in (("plain", {}), ("soon", {"rewirings": [rewiring(1, opposite)]})):
        board = by_hand([follows, other], **more)
        found = with_reachable_goal(board, links(), 8)
        assert found is not None and found.task is not None
        goals[name] = found.task.shortest
    assert goals == {"plain": 2, "soon": 1}


def test_what_cannot_be_changed_is_no_goal() -> None:
    held = [lock(number, 2, 1) for number in (0, 1)]
    follows = relation("one-to-one", 2, [link(0)], (0, 1))
    assert with_reachable_goal(by_hand([follows], locks=held), links(), 8) is None
    flicker = relation("flicker", 3, [], (0, 1), probability=0.2)
    assert with_reachable_goal(by_hand([flicker]), links(), 8) is None
    found = with_reachable_goal(by_hand([follows, flicker]), links(), 8)
    assert found is not None and affectable(found) == (2,) and goal_responders(found)[2:4] == (1, 0)


def test_what_reads_an_affectable_responder_is_affectable() -> None:
    relations = [
        relation("one-to-one", 4, [body(3)], (0, 1)),
        relation("one-to-one", 3, [body(2)], (0, 1)),
        relation("unreliable", 2, [link(0)], (0, 1), probability=0.8),
        relation("flicker", 5, [], (0, 1), probability=0.1),
    ]
    assert affectable(by_hand(relations)) == (2, 3, 4)


def test_the_search_visits_every_state_once_and_the_nearest_first() -> None:
    law = Dynamics(by_hand([relation("toggle", 2, [link(0)], (0, 1))], (2, 3)), links((2, 3)))
    found = list(reachable(law, (0, 0), 30))
    depths = [depth for depth, _, _ in found]
    assert depths == sorted(depths) and depths[0] == 0
    states = {(triggers, state.shown, state.memories) for _, triggers, state in found}
    assert len(states) == len(found) == 2 * 3 * 2
    assert {t for _, t, _ in reachable(law, (0, 0), 30, stuck=1)} == set(product((0, 1), (0,)))
    assert [depth for depth, _, _ in reachable(law, (0, 0), 30, most=4)] == [0, 1, 1]


def test_boards_of_other_worlds_do_not_follow_their_links_alone() -> None:
    [(board, _)] = reaching(find("procedural"), "time", "train", boards=1)
    with pytest.raises(BusybotError, match="world 'time'") as error:
        responder_states(board, start_states(board))
    assert "Dynamics" in str(error.value.hint)


@pytest.mark.parametrize("options", [{"tasks": "reach"}, {"world": "gates", "tasks": "one-to-one"}])
def test_tasks_that_a_world_does_not_have_are_refused(options: dict[str, str]) -> None:
    with pytest.raises(ValidationError, match="--world gates|--tasks reach"):
        BoardConfig.model_validate(options)
