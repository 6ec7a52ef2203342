"""`busybot eval`: measure a skill on a dataset."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from busybot.cli.common import CONTEXT, JsonOption, SeedOption, WorkersOption, episode_progress, print_json, say

app = typer.Typer(
    add_completion=False, no_args_is_help=True, context_settings=CONTEXT, help="Measure a skill on a dataset."
)


@app.callback()
def _root() -> None:
    pass


@app.command()
def reason(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset with episodes.")],
    model: Annotated[str, typer.Option(help="Who infers the relations: count.")] = "count",
    images: Annotated[int, typer.Option(min=2, help="Infer from so many images, one more than actions.")] = 23,
    out: Annotated[Path | None, typer.Option(help="Write the result as JSON to this file.")] = None,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters of the model.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as change.tolerance=5.")] = None,
    json: JsonOption = False,
) -> None:
    """Which trigger controls which responder: inferred from pictures, boxes and actions, compared with the truth.

    Shares in JSON lie between 0 and 1, in the table they are percent. Pred-A is null: counting predicts no states.
    """
    from busybot.config import build
    from busybot.episodes.dataset import Dataset
    from busybot.files import write_json
    from busybot.reason.count import CountConfig
    from busybot.reason.evaluate import evaluate_dataset

    parameters = build(CountConfig, config, set_ or [], {})
    target = Dataset.open(dataset)
    with episode_progress("inferring") as progress:
        result = evaluate_dataset(target, model, images, parameters, seed, workers, progress)
    result["command"] = _command("reason", dataset, set_, config, model=model, images=images, seed=seed)
    if out is not None:
        write_json(out, result)
        say(f"wrote {out}")
    if json:
        print_json(result)
    else:
        _print_tables(result)


@app.command()
def interact(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset; only its boards are used.")],
    model: Annotated[str | None, typer.Option(help="Shipped model or folder; or random, scripted (an oracle).")] = None,
    mode: Annotated[
        str | None, typer.Option(help="Of a model: evaluate (of a paper model: ucb), greedy, ucb or collect.")
    ] = None,
    boards: Annotated[int | None, typer.Option(min=1, help="Only so many, the first ones.")] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Veto directions far from the annotated ones.")] = False,
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
    from busybot.cli.eval_interact import check_figures, draw_figures, evaluate_model, print_table
    from busybot.config import build
    from busybot.episodes.dataset import Dataset
    from busybot.interact.evaluate import EvaluateConfig

    check_figures(figures, model, out, record)
    parameters = build(EvaluateConfig, config, set_ or [], {"boards": boards, "interaction.strict": strict or None})
    with episode_progress("acting") as progress:
        target = Dataset.open(dataset)
        result = evaluate_model(target, model, mode, parameters, assets, seed, workers, progress, out, record)
    if figures and out is not None and record is not None:
        draw_figures(out / "figures", record, model, parameters, figures)
    given = {"model": model, "mode": mode, "seed": seed, "strict": strict, "boards": boards}
    result["command"] = _command("interact", dataset, set_, config, **given)
    if json:
        print_json(result)
    else:
        print_table(result)


def _command(skill: str, dataset: Path, settings: list[str] | None, config: Path | None, **options: Any) -> str:
    """The command that gives the same result; options that are None or False were not given."""
    words = ["busybot", "eval", skill, str(dataset)]
    for name, value in options.items():
        if value is not None and value is not False:
            words += [f"--{name}"] if value is True else [f"--{name}", str(value)]
    words += [word for setting in settings or [] for word in ("--set", setting)]
    return shlex.join([*words, *(["--config", str(config)] if config else [])])


def _print_tables(result: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    origin = result["dataset"]
    oracle = " (an oracle)" if result["oracle"] else ""
    table = Table(
        title=f"{origin['name']} ({origin['split']}): relations of {result['boards']} boards, first "
        f"{result['images']} images, actions by {result['policy'] or 'nobody'}{oracle}",
        title_justify="left",
    )
    table.add_column("percent", no_wrap=True)
    for name in ("Edge-P", "Edge-R", "Edge-Acc", "ECE", "Brier"):
        table.add_column(name, justify="right", no_wrap=True)
    keys = ("edge_p", "edge_r", "edge_acc", "ece", "brier")
    edges = ("precision", "recall", "accuracy")
    table.add_row(result["model"], *(_percent(result[key]) for key in keys), style="bold")
    for name, end in (("  95 % interval from", 0), ("  to", 1)):
        ends = (result["intervals"][key] for key in edges)
        table.add_row(name, *(_percent(interval and interval[end]) for interval in ends))
    table.add_row("  mean over boards", *(_percent(result["macro"][key]) for key in edges))
    table.add_row("  effect was visible", "", _percent(result["edge_r_bound"]), end_section=True)
    for kind, scores in result["by_kind"].items():
        name = f"  {kind} ({scores['relations']})"
        table.add_row(name, _percent(scores["edge_p"]), _percent(scores["edge_r"]))
    table.add_section()
    for name, scores in result["baselines"].items():
        table.add_row(name, *(_percent(scores[key]) for key in keys))
    Console().print(table)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"
