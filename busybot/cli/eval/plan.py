"""`busybot eval plan`: how often agents reach their goals."""

from pathlib import Path
from typing import Annotated, Any

import typer

from busybot.cli.common import JsonOption, SeedOption, WorkersOption, command_again, episode_progress, print_json


def plan(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset with tasks and histories.")],
    agents: Annotated[
        str,
        typer.Option(
            help="Comma between them: noop, random, relation, predictive, busybot, search, oracle; trained ones with "
            "their folders: bc=DIR, ppo=DIR; told a part of the truth: search-true-relations, search-true-contacts, "
            "search-true-both.",
            show_default="all that need no folder and are told nothing, and oracle",
        ),
    ] = "search,busybot,predictive,relation,random,noop,oracle",
    model: Annotated[str, typer.Option(help="Who infers and predicts: lookup, or a trained reasoner.")] = "event",
    policy_model: Annotated[
        str | None,
        typer.Option(
            help="Interaction model that proposes candidates: a shipped one (by default procedural) or a folder."
        ),
    ] = None,
    boards: Annotated[int | None, typer.Option(min=1, help="Only the first so many tasks; by default all.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; continues a stopped evaluation.")] = None,
    record: Annotated[
        Path | None, typer.Option(help="Record the rollouts in this folder: in it a dataset for every agent.")
    ] = None,
    assets: Annotated[str | None, typer.Option(help="Objects, if they are not found by their hashes.")] = None,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters of PlanConfig.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as learned.explore=0.5.")] = None,
    json: JsonOption = False,
) -> None:
    """How often agents make a board look as its goal picture: at most eight steps on each task.

    Shares in JSON lie between 0 and 1, in the table they are percent. CPU ms are those of a decision, the interaction
    model's part included, simulation and rendering left out.
    """
    from busybot.common.config import build
    from busybot.common.process_pool import default_workers
    from busybot.datasets.bundled_assets import library_of
    from busybot.datasets.dataset import Dataset
    from busybot.evaluation.folder import RESULT
    from busybot.evaluation.results import write_result
    from busybot.interact.policy.policy_factory import DEFAULT_MODEL
    from busybot.plan.evaluate import PlanEvaluation, evaluate_agents
    from busybot.plan.rollout import PlanConfig

    parameters = build(PlanConfig, config, set_ or [], {"boards": boards})
    names = list(dict.fromkeys(name.strip() for name in agents.split(",")))
    with episode_progress("planning") as progress:
        data = Dataset.open(dataset)
        library, proposer = library_of(data, assets), policy_model or DEFAULT_MODEL
        evaluation = PlanEvaluation(data, library, names, model, proposer, parameters, seed, record)
        result = evaluate_agents(evaluation, workers or default_workers(), progress, out)
    given = {"agents": agents, "model": model, "policy-model": policy_model, "seed": seed, "boards": boards}
    result["command"] = command_again("plan", dataset, set_, config, **given)
    if out is not None:
        write_result(out / RESULT, result)
    if json:
        print_json(result)
    else:
        print_tables(result)


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
