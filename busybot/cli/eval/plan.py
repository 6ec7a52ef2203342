"""What `busybot eval plan` does and prints."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from busybot.datasets.dataset import Dataset
    from busybot.plan.rollout import PlanConfig


def evaluate_agents(
    dataset: "Dataset",
    agents: str,
    model: str,
    policy_model: str | None,
    config: "PlanConfig",
    assets: str | None,
    seed: int,
    workers: int | None,
    progress: Callable[[int, int], None],
    out: Path | None,
    record: Path | None,
) -> dict[str, Any]:
    """Find objects, agents and models by their names and evaluate."""
    from busybot.common.process_pool import default_workers
    from busybot.datasets.bundled_assets import library_of
    from busybot.interact.policy.policy_factory import DEFAULT_MODEL
    from busybot.plan.evaluate import evaluate_agents

    names = list(dict.fromkeys(name.strip() for name in agents.split(",")))
    library, processes = library_of(dataset, assets), workers or default_workers()
    named = policy_model or DEFAULT_MODEL
    return evaluate_agents(dataset, library, names, model, named, config, seed, processes, progress, out, record)


def print_tables(result: dict[str, Any]) -> None:
    """Success with its 95 % interval and what stands beside it, then why responders were missed."""
    from rich.console import Console
    from rich.table import Table

    origin, console = result["dataset"], Console()
    kinds = ", ".join(f"{count} {kind}" for kind, count in result["kinds"].items())
    title = f"{origin['name']} ({origin['split']}): {kinds} tasks, at most {result['steps']} steps"
    table = Table(title=title, title_justify="left")
    table.add_column("percent", no_wrap=True)
    for name in COLUMNS:
        table.add_column(name, justify="right", no_wrap=True)
    for agent, row in result["agents"].items():
        interval = "-".join(f"{100 * end:.0f}" for end in row["interval"] or ())
        shares = (row["micro"], row["by_features"], row["solved"])
        cpu = result["timing"][agent]["cpu_ms"]
        steps = "-" if row["steps"] is None else f"{row['steps']:.1f}"
        name = f"{agent}*" if agent in result["oracles"] else agent
        cells = (
            _percent(row["success"]),
            interval,
            *map(_percent, shares),
            steps,
            "-" if cpu is None else f"{cpu:.0f}",
        )
        table.add_row(name, *cells)
    if result["oracles"]:
        table.caption = "* knows what only the simulator knows"
    console.print(table)
    for agent, row in result["agents"].items():
        causes = ", ".join(f"{cause} ({count})" for cause, count in row["failures_by_cause"].items() if count)
        if causes:
            console.print(f"{agent} missed because of", causes)


COLUMNS = ("success", "95 %", "pooled", "looks", "solved", "steps", "CPU ms")


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"
