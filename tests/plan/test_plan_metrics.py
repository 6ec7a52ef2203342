"""What judged rollouts come to."""

import numpy as np
import pytest

from busybot.plan.metrics import CAUSES, Cause, JudgedResponder, JudgedRollout, JudgedTask, summarise, timing


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
