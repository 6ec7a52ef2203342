"""Recordings of each world are judged by both evaluations, with procedural objects and physics."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.task import shortest_plan
from busybot.boards.worlds import WORLDS
from busybot.common.errors import BusybotError
from busybot.datasets.create import create_dataset
from busybot.plan.evaluate import PlanEvaluation, evaluate_agents
from busybot.reason.evaluation.causes_summary import KEYS
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset, evaluate_models
from busybot.sim.collect import CollectConfig, collect
from tests.episodes.symbolic import library_at

AGENTS = ["search", "noop", "random", "oracle"]


@pytest.mark.long
@pytest.mark.parametrize("world", WORLDS)
def test_every_world_is_judged(
    world: str,
    few_objects: Callable[[int], Path],
    tmp_path: Path,
    work_here: Callable[[], AbstractContextManager[None]],
) -> None:
    library = library_at(few_objects(0))
    dataset = create_dataset(tmp_path / "data", BoardConfig(world=world, boards=1, tasks="reach", seed=3), library)
    with work_here():
        collect(dataset, library, CollectConfig(policy="scripted", steps=26), workers=1)
    asked = [ReasonEvaluation(model) for model in ("count", "lookup", "persistence", "event", "mechanism")]
    together = evaluate_models(dataset, asked, workers=1)
    if world == "mixed":  # which has something of all others
        alone = [evaluate_dataset(dataset, one, workers=1) for one in asked]
        assert together == alone, "what is shared changes nothing"
    for model, told in zip((one.model for one in asked), together, strict=True):
        assert told["world"] == world and {name for line in KEYS for name in line.split(", ")} <= told.keys()
        assert told["bound_boards"] == 1 and 0 <= told["parent_r"] <= 1
        assert (told["mechanism_accuracy"] is None) == (model == "count"), model
    with work_here():
        played = evaluate_agents(PlanEvaluation(dataset, library, AGENTS, "lookup", "procedural"), workers=1)
        planned = evaluate_agents(PlanEvaluation(dataset, library, ["mechanism"], "mechanism", "procedural"), workers=1)
    assert played["least_steps"] == shortest_plan(dataset.boards()[0])
    assert played["success"].keys() == set(AGENTS) and played["agents"]["noop"]["steps"] == 0
    assert 0 <= planned["success"]["mechanism"] <= 1 and planned["agents"]["mechanism"]["steps"] > 0


def test_an_agent_that_does_not_fit_the_reasoner_is_refused_before_anything_is_done(
    few_objects: Callable[[int], Path], tmp_path: Path
) -> None:
    library = library_at(few_objects(0))
    dataset = create_dataset(tmp_path / "data", BoardConfig(boards=1, tasks="one-to-one"), library)
    with pytest.raises(BusybotError, match="lookup does not tell") as refused:
        evaluate_agents(PlanEvaluation(dataset, library, ["noop", "mechanism"], "lookup", "procedural"), workers=1)
    assert "--reasoner" in refused.value.hint
