"""`busybot eval interact`: how often a policy's actions succeed, and how many links they find."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from busybot.cli.common import (
    JsonOption,
    SeedOption,
    WorkersOption,
    command_again,
    counted,
    episode_progress,
    print_json,
)
from busybot.common.errors import BusybotError

if TYPE_CHECKING:
    from busybot.datasets.dataset import Dataset
    from busybot.interact.evaluate import InteractEvaluation

BUILT_IN = ("random", "scripted")


def interact(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset; only its boards are used.")],
    model: Annotated[
        str | None,
        typer.Option(help="Shipped model (by default procedural) or folder; or random, scripted (an oracle)."),
    ] = None,
    mode: Annotated[
        str | None,
        typer.Option(help="How a model chooses: evaluate, greedy, ucb or collect; evaluate, for paper models ucb."),
    ] = None,
    boards: Annotated[int | None, typer.Option(min=1, help="Only so many, the first ones; by default all.")] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Refuse moves far off the annotated directions.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; continues a stopped evaluation.")] = None,
    record: Annotated[Path | None, typer.Option(help="Record the episodes as a dataset in this folder.")] = None,
    figures: Annotated[int, typer.Option(min=0, help="Draw so many of the recorded boards into OUT/figures.")] = 0,
    assets: Annotated[str | None, typer.Option(help="Objects, if they are not found by their hashes.")] = None,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters of EvaluateConfig.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as learned.explore=0.5.")] = None,
    json: JsonOption = False,
) -> None:
    """How often actions succeed, and how many of the movable links they find: ten actions on each board.

    Shares in JSON lie between 0 and 1, in the table they are percent.
    """
    from busybot.common.config import build
    from busybot.datasets.dataset import Dataset
    from busybot.evaluation.folder import RESULT
    from busybot.evaluation.results import write_result
    from busybot.interact.evaluate import InteractEvaluation

    check_figures(figures, model, out, record)
    parameters = build(InteractEvaluation, config, set_ or [], {"boards": boards, "interaction.strict": strict or None})
    with episode_progress("acting") as progress:
        target = Dataset.open(dataset)
        result = evaluate_model(target, model, mode, parameters, assets, seed, workers, progress, out, record)
    if figures and out is not None and record is not None:
        draw_figures(out / "figures", record, model, parameters, figures)
    given = {"model": model, "mode": mode, "seed": seed, "strict": strict, "boards": boards}
    result["command"] = command_again("interact", dataset, set_, config, **given)
    if out is not None:
        write_result(out / RESULT, result)
    if json:
        print_json(result)
    else:
        print_table(result)


def evaluate_model(
    dataset: "Dataset",
    model: str | None,
    mode: str | None,
    config: "InteractEvaluation",
    assets: str | None,
    seed: int,
    workers: int | None,
    progress: Callable[[int, int], None],
    out: Path | None,
    record: Path | None,
) -> dict[str, Any]:
    """Find objects and policy by their names and evaluate."""
    from busybot.common.process_pool import default_workers
    from busybot.datasets.bundled_assets import library_of
    from busybot.interact.evaluate import PolicyEvaluation, evaluate_policy
    from busybot.interact.policy.learned import mode_named
    from busybot.interact.policy.policy_factory import DEFAULT_MODEL, LearnedPolicyFactory, usual_mode
    from busybot.sim.builtin_policies import builtin_factory
    from busybot.sim.policy import AnyPolicyFactory

    library = library_of(dataset, assets)
    factory: AnyPolicyFactory
    if model in BUILT_IN:
        if mode or config.learned:
            unused = f"--mode {mode}" if mode else f"--set learned.{next(iter(config.learned))}"
            raise BusybotError(f"{unused} is about a trained model's policy, {model} has none", "leave it out")
        factory, provenance = builtin_factory(model), {"model": {"name": model}}
    else:
        named = model or DEFAULT_MODEL
        factory = LearnedPolicyFactory(named, mode_named(mode) if mode else usual_mode(named), config.learned)
        provenance = factory.provenance()
    evaluation = PolicyEvaluation(dataset, library, factory, config, seed, record, provenance)
    return evaluate_policy(evaluation, workers or default_workers(), progress, out)


def check_figures(figures: int, model: str | None, out: Path | None, record: Path | None) -> None:
    """Refuse figures that could not be drawn, before anything else is done."""
    if not figures:
        return
    if out is None or record is None:
        raise BusybotError("--figures draws recorded boards into the results", "give --out and --record, too")
    if model in BUILT_IN:
        raise BusybotError(f"--figures shows a model's affordances, {model} has none", "leave --figures out")


def draw_figures(folder: Path, record: Path, model: str | None, config: "InteractEvaluation", count: int) -> None:
    """Affordances, known links and actions of the first recorded boards."""
    from busybot.datasets.dataset import Dataset
    from busybot.episodes.mcap.reader import read_episode
    from busybot.interact.policy.policy_factory import DEFAULT_MODEL, load_once, policy_config
    from busybot.interact.policy.policy_trace import retrace
    from busybot.view.figures.affordance import affordance_figure

    dataset, loaded = Dataset.open(record), load_once(model or DEFAULT_MODEL)
    policy = policy_config(loaded.info, config.learned)
    for index in sorted(dataset.finished())[:count]:
        episode = read_episode(dataset.episode_path(index), "lazy")
        affordance_figure(folder / f"board-{index:06d}.png", episode, list(retrace(episode, loaded, policy)))


def print_table(result: dict[str, Any]) -> None:
    """Shares with their 95 % intervals and their mean over boards, then what failed and what was missed."""
    from rich.console import Console
    from rich.table import Table

    origin, console = result["dataset"], Console()
    veto = ", strict" if result["strict"] else ""
    title = (
        f"{origin['name']} ({origin['split']}): {counted(result['actions'], 'action')} on each of "
        f"{counted(result['boards'], 'board')}{veto}"
    )
    table = Table(title=title, title_justify="left")
    table.add_column(f"percent, {result['policy']}", no_wrap=True)
    for name in ("all", "from", "to", "by board", "counted", "of"):
        table.add_column(name, justify="right", no_wrap=True)
    for key, name in NAMES.items():
        low, high = result["intervals"][key] or (None, None)
        shares = (result[key], low, high, result["macro"][key])
        count = result["counts"][key]
        table.add_row(name, *map(_percent, shares), str(count["part"]), str(count["whole"]))
    console.print(table)
    causes = {name: count for name, count in result["failures_by_cause"].items() if count}
    because = ", ".join(f"{name} ({count})" for name, count in causes.items())
    objects = list(result["failures_by_object"].items())[:6]
    failed = (f"{key} ({row['position'] + row['direction']} of {row['actions']})" for key, row in objects)
    links = list(result["missed_links"].items())[:6]
    missed = (f"{name} ({row['missed']} of {row['boards']})" for name, row in links)
    told = {"failed because of": because, "failed most on": ", ".join(failed), "missed most": ", ".join(missed)}
    for what, which in told.items():
        if which:
            console.print(what, which)


NAMES = {
    "precision": "precision",
    "recall": "recall",
    "recall_objects": "  of objects",
    "precision_exploring": "  new links only",
    "precision_reward": "  as pixels tell",
    "off_axis_share": "successes off axis",
}


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"
