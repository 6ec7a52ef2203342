"""Tasks are what the protocol asks for: reachable, not solved already, and the same for the same seed."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec, LinkRef, Task
from busybot.boards.task import (
    MAX_STEPS,
    affectable,
    goal_responders,
    least_steps,
    reached,
    responder_states,
    start_states,
    task_of,
)
from busybot.datasets.dataset import Dataset
from busybot.objects.library import Library
from busybot.objects.model import TriggerLink
from busybot.objects.resolve import find

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


@pytest.mark.parametrize("what", ["goal", "links", "twice", "relation"])
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
