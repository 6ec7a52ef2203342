"""Who plays in which world."""

from argparse import Namespace
from pathlib import Path

from benchmarks.tables.world_plans import commands


def players(world: str) -> list[str]:
    """The agents of each evaluation."""
    options = Namespace(
        work=Path("w"), history="scripted", policy=None, assets="procedural", boards=1, model="mechanism",
        learned=["bc=b", "ppo=p"],
    )  # fmt: skip
    return [words[words.index("--agents") + 1] for words in commands(world, options) if "--agents" in words]


def test_the_papers_agents_play_everywhere_learned_ones_where_they_can_practise() -> None:
    ours, others = players("time")
    assert ours == "mechanism" and {"relation", "predictive", "busybot", "search"} < set(others.split(","))
    assert players("gates") == players("lock-5-to-8") == [ours, others, "bc=b,ppo=p"]
