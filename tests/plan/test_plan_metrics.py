"""What judged rollouts come to."""

import numpy as np
import pytest

from busybot.plan.metrics import CAUSES, KEYS, Cause, JudgedResponder, JudgedRollout, JudgedTask, summarise, timing


def responder(reached: bool, asked: bool = True, cause: Cause = "", looks: bool | None = None) -> JudgedResponder:
    return JudgedResponder(
        object=3,
        key="Lamp/a",
        kind="one-to-one",
        asked=asked,
        reached=reached,
        looks_reached=reached if looks is None else looks,
        cause=cause,
    )


def rollout(agent: str, *responders: JudgedResponder, steps: int = 2, stopped: str = "done") -> JudgedRollout:
    return JudgedRollout(
        agent=agent,
        steps=steps,
        succeeded=1,
        stopped=stopped,
        responders=responders,
        cpu_ms=(10.0, 20.0),
        model_ms=(0.0, 16.0),
        start_ms=5.0,
    )


HIT, MISS = responder(True), responder(False, cause="no candidate")
KEPT, NOT_NOTICED = responder(True, asked=False), responder(False, asked=False, cause="not noticed", looks=True)
TASKS = [
    JudgedTask(board=0, kind="one-to-one", least_steps=1, rollouts=(rollout("a", HIT, MISS), rollout("b", HIT, HIT))),
    JudgedTask(
        board=1,
        kind="one-to-many",
        least_steps=2,
        rollouts=(rollout("a", HIT, HIT, HIT, NOT_NOTICED, stopped=""), rollout("b", HIT, HIT, HIT, KEPT)),
    ),
]


def rng() -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(0))


def test_success_is_the_mean_over_tasks_and_beside_it_pooled() -> None:
    result = summarise(TASKS, ["a", "b"], rng())
    assert result["success"] == {"a": 0.625, "b": 1.0}
    row = result["agents"]["a"]
    assert row["micro"] == pytest.approx(4 / 6) and row["solved"] == 0 and row["by_features"] == 0.75
    assert row["asked"] == 0.8 and row["kept"] == 0 and row["steps"] == 2 and row["steps_more"] == 0.5
    assert row["step_success"] == 0.5 and row["interval"] == (0.5, 0.75)
    assert result["by_kind"] == {"one-to-many": {"a": 0.75, "b": 1.0}, "one-to-one": {"a": 0.5, "b": 1.0}}


def test_tasks_that_all_went_alike_are_no_certainty() -> None:
    """Of two tasks with half of the goal reached each, a bootstrap would see nothing but halves."""
    tasks = [
        JudgedTask(board=number, kind="one-to-one", least_steps=1, rollouts=(rollout("a", HIT, MISS),))
        for number in range(2)
    ]
    row = summarise(tasks, ["a"], rng())["agents"]["a"]
    others = 1 - 0.025**0.5  # at most this share of other tasks goes otherwise
    assert row["success"] == 0.5 and row["interval"] == pytest.approx((0.5 - others / 2, 0.5 + others / 2))


def test_failures_are_told_by_cause() -> None:
    row = summarise(TASKS, ["a"], rng())["agents"]["a"]
    assert row["failures_by_cause"] == dict.fromkeys(CAUSES, 0) | {"no candidate": 1, "not noticed": 1}
    assert row["stopped"] == {"done": 1, "steps used up": 1}


def test_decisions_are_timed_with_and_without_the_interaction_model() -> None:
    row = timing(TASKS, ["a"])["a"]
    times = {"cpu_ms": 15.0, "cpu_ms_p95": 20.0, "cpu_ms_without_model": 7.0, "start_ms": 5.0}
    assert row == {"decisions": 4, "asked_model": 0.5, **times}


def test_no_task_is_null_and_no_crash() -> None:
    result = summarise([], ["a"], rng())
    assert result["success"] == {"a": None} and result["agents"]["a"]["interval"] is None
    assert timing([], ["a"])["a"]["cpu_ms"] is None


def test_what_every_world_has_beside() -> None:
    """Agent b solves both tasks, with two steps where one and two are needed; agent a solves none."""
    tasks = [TASKS[0].model_copy(update={"unmoved": 0}), TASKS[1].model_copy(update={"locks": 3, "unmoved": 1})]
    result = summarise(tasks, ["a", "b"], rng())
    assert result["by_locks"] == {"0": {"tasks": 1, "a": 0.5, "b": 1.0}, "3": {"tasks": 1, "a": 0.75, "b": 1.0}}
    assert result["by_unmoved"] == {"0": result["by_locks"]["0"], "1": result["by_locks"]["3"]}
    assert list(summarise([tasks[0], TASKS[1]], ["a"], rng())["by_unmoved"]) == ["0"], "it was not counted of one"
    a, b = result["agents"]["a"], result["agents"]["b"]
    assert a["steps_over_shortest"] is None and b["steps_over_shortest"] == (2 / 1 + 2 / 2) / 2
    assert b["solved_interval"] == (pytest.approx(0.025**0.5), 1.0)
    assert a["micro_intervals"]["objects"] == (0.5, 0.75) and b["micro_intervals"]["mechanisms"] == (
        pytest.approx(0.025),
        1.0,
    )
    assert b["object_interval"] == (pytest.approx(0.025), 1.0), "of one object exact bounds"
    # two tasks: neither test can tell
    told = {"difference": 0.375, "difference_interval": (0.25, 0.5), "differing": 2, "p_success": 0.5, "p_solved": 0.5}
    assert result["compared"] == {"b": told}
    named = [name.rpartition(".")[2] for name in KEYS]
    assert set(named) <= {*result, *a, *result["compared"], "NAME"}


def test_agents_that_do_the_same_on_two_tasks_may_still_differ_on_others() -> None:
    same = [task.model_copy(update={"rollouts": (task.of("a"), task.of("a").model_copy(update={"agent": "b"}))})
            for task in TASKS[:2]]  # fmt: skip
    told = summarise(same, ["a", "b"], rng())["compared"]["b"]
    assert told["differing"] == 0 == told["difference"]
    assert told["difference_interval"] == (pytest.approx(-(1 - 0.025**0.5)), pytest.approx(1 - 0.025**0.5))


def test_one_task_says_little_of_a_difference() -> None:
    told = summarise(TASKS[:1], ["a", "b"], rng())["compared"]["b"]
    low, high = told["difference_interval"]
    assert told["difference"] > 0 and low == pytest.approx(0.025 * told["difference"] - 0.975)
    assert high == pytest.approx(0.025 * told["difference"] + 0.975)


def test_more_steps_are_counted_where_the_task_was_solved() -> None:
    easy = JudgedTask(board=0, kind="reach", least_steps=4, rollouts=(rollout("a", HIT, steps=5),))
    failed = JudgedTask(board=1, kind="reach", least_steps=1, rollouts=(rollout("a", MISS, steps=8),))
    assert summarise([easy, failed], ["a"], rng())["agents"]["a"]["steps_over_shortest"] == 1.25


def test_in_the_interval_over_objects_every_task_counts_alike() -> None:
    """One object: missed on thirty tasks where it stands alone, reached on ten where there are ten of it."""
    alone = [JudgedTask(board=n, kind="reach", least_steps=1, rollouts=(rollout("a", MISS),)) for n in range(30)]
    many = [
        JudgedTask(board=n, kind="reach", least_steps=1, rollouts=(rollout("a", *[HIT] * 10),)) for n in range(30, 40)
    ]
    row = summarise([*alone, *many], ["a"], rng())["agents"]["a"]
    assert row["success"] == 0.25 and row["micro"] == pytest.approx(100 / 130)
    assert row["object_interval"][0] < 0.25 < row["object_interval"][1] < 0.5 < row["micro_intervals"]["objects"][0]


def test_where_nothing_can_be_affected_nothing_is_missed() -> None:
    idle = rollout("noop")
    assert idle.solved and idle.success == 1.0


def test_a_task_that_is_solved_at_the_start_has_no_share_in_how_much_longer_ways_are() -> None:
    """Nobody draws such a task, but a board that was written by hand may have one."""
    at_once = JudgedTask(board=2, kind="reach", least_steps=0, rollouts=(rollout("a", KEPT, steps=0),))
    longer = JudgedTask(board=3, kind="reach", least_steps=1, rollouts=(rollout("a", HIT),))
    assert summarise([at_once, longer], ["a"], rng())["agents"]["a"]["steps_over_shortest"] == 2
    assert summarise([at_once], ["a"], rng())["agents"]["a"]["steps_over_shortest"] is None
