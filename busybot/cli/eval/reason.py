"""`busybot eval reason`: which trigger controls which responder, compared with the truth."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from busybot.cli.common import (
    JsonOption,
    SeedOption,
    WorkersOption,
    check_file,
    command_again,
    counted,
    episode_progress,
    print_json,
    say,
)

if TYPE_CHECKING:
    from rich.table import Table

PREDICTIONS = ("pred_a", "pred_a_successful", "pred_a_responder", "pred_a_changed", "pred_a_unchanged")


def reason(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset with episodes.")],
    model: Annotated[
        str, typer.Option(help="Who infers relations: count, pc, lookup, persistence, or a trained model.")
    ] = "event",
    images: Annotated[int, typer.Option(min=2, help="Infer from so many images, one more than actions.")] = 23,
    decoders: Annotated[
        Path | None, typer.Option(help="Judge predictions by decoders trained on this training dataset, too.")
    ] = None,
    assets: Annotated[str | None, typer.Option(help="Objects for --decoders, if they are not found by hash.")] = None,
    out: Annotated[Path | None, typer.Option(help="Write the result as JSON to this file.")] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Draw the scores against the number of images into this file, F.png.")
    ] = None,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters of the model.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as change.tolerance=5.")] = None,
    json: JsonOption = False,
) -> None:
    """Which trigger controls which responder, and what the next action does: compared with the truth.

    Models see pictures, boxes and actions. Shares in JSON lie between 0 and 1, in the table they are percent. Pred-A is
    null for count and pc: they predict no states.
    """
    from busybot.common.config import build
    from busybot.datasets.dataset import Dataset
    from busybot.evaluation.results import write_result
    from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset
    from busybot.reason.models.registry import config_class

    check_file("--out", out, "reason.json")
    check_file("--figure", figure, "reason.png")
    parameters = build(config_class(model), config, set_ or [], {})
    training = Dataset.open(decoders) if decoders else None
    with episode_progress("inferring") as progress:
        result = evaluate_dataset(
            Dataset.open(dataset),
            ReasonEvaluation(model, images, parameters),
            training,
            assets,
            seed,
            workers,
            progress,
        )
    options = {"model": model, "images": images, "seed": seed, "decoders": decoders}
    result["command"] = command_again("reason", dataset, set_, config, **options)
    if out is not None:
        write_result(out, result)
        say(f"wrote {out}")
    if figure is not None:
        from busybot.view.figures.curves import images_figure

        say(f"wrote {images_figure(figure, result)}")
    if json:
        print_json(result)
    else:
        print_tables(result)


def print_tables(result: dict[str, Any]) -> None:
    """The relations, then what was predicted, each with what stands beside it."""
    from rich.console import Console

    console = Console()
    console.print(_edges(result))
    if result["predicted_boards"]:
        console.print(_predictions(result))
    elif result["images_used"] and result["images_used"] <= result["images"]:
        steps = counted(result["images_used"] - 1, "step")
        console.print(
            f"no Pred-A: the recordings have at most {steps}, so no step is left to predict; "
            "use a smaller --images, or record more with collect --steps",
            soft_wrap=True,
        )


def _images(result: dict[str, Any]) -> str:
    asked, used = result["images"], result["images_used"]
    return f"{used} of {asked} images" if used and used < asked else counted(asked, "image")


def _table(title: str, columns: tuple[str, ...]) -> "Table":
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    table.add_column("percent", no_wrap=True)
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def _edges(result: dict[str, Any]) -> "Table":
    origin = result["dataset"]
    oracle = " (an oracle)" if result["oracle"] else ""
    table = _table(
        f"{origin['name']} ({origin['split']}): relations of {counted(result['boards'], 'board')}, first "
        f"{_images(result)}, actions by {result['policy'] or 'nobody'}{oracle}",
        ("Edge-P", "Edge-R", "Edge-Acc", "ECE", "Brier"),
    )
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
    return table


def _predictions(result: dict[str, Any]) -> "Table":
    table = _table(
        f"Pred-A: {counted(result['predicted_steps'], 'later step')} on "
        f"{counted(result['predicted_boards'], 'board')}, "
        f"{_percent(result['failing'])} % of them without success",
        ("all", "success", "each", "changed", "same"),
    )
    rows = {
        result["model"]: result,
        "  by decoders": result["decoded"],
        "nothing changes": result["persistence"],
        "bound, failures unknown": result["bounds"]["not_knowing"],
        "bound, failures known": result["bounds"]["knowing"],
        **{f"  {kind} ({scores['steps']})": scores for kind, scores in result["pred_by_kind"].items()},
    }
    for name, scores in rows.items():
        if scores is not None:
            table.add_row(name, *(_percent(scores[key]) for key in PREDICTIONS))
    for judge, shares in result["decoder_accuracy"].items():
        if shares is not None:
            accuracies = ", ".join(f"{name} {_percent(share)}" for name, share in shares.items())
            table.caption = f"{table.caption or 'true features read rightly'}; {judge}: {accuracies}"
    return table


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f}"
