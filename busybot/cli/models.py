"""`busybot models`: list trained models, tell about one, check that its files are whole."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from busybot.cli.common import CONTEXT, console, counted, print_json, tell, warn
from busybot.cli.options import JsonOption, offering
from busybot.cli.options import models as shipped_names

if TYPE_CHECKING:
    from busybot.models import ModelDescription, ModelVerdict

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    context_settings=CONTEXT,
    help="List trained models, tell about one, check its files.",
)

ModelArgument = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        help="A shipped model's name, or a folder.",
        show_default=False,
        autocompletion=offering(shipped_names),
    ),
]


@app.command("list")
def list_(
    folder: Annotated[
        Path | None, typer.Argument(metavar="[DIR]", help="List the models in this folder instead of the shipped ones.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Show the models that come with busybot, or those in a folder."""
    from rich.table import Table

    from busybot.models import describe_model, models_below, shipped_models

    found = [describe_model(path) for path in (shipped_models() if folder is None else models_below(folder))]
    if json:
        print_json({"models": found})
        return
    table = Table()
    for column in ("model", "skill", "kind", "values", "MB"):
        table.add_column(column, justify="right" if column in ("values", "MB") else "left", overflow="fold")
    for model in found:
        table.add_row(model.name, model.skill, model.kind, f"{model.parameters:,}", f"{model.bytes / 1e6:.1f}")
    console().print(table)


@app.command()
def info(model: ModelArgument, json: JsonOption = False) -> None:
    """Tell what a model is, which data it was trained on, and how well it did in training."""
    from busybot.models import describe_model, find

    told = describe_model(find(model))
    if json:
        print_json(told)
    else:
        tell("\n".join(_lines(told)))


@app.command()
def verify(
    models: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MODEL]...",
            help="Names or folders; all shipped models by default.",
            autocompletion=offering(shipped_names),
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Compare a model's files with the hashes in its model.json, and load its weights. Exits with 1 if any is wrong."""
    from busybot.models import find, shipped_models
    from busybot.models import verify as verify_model

    folders = [find(name) for name in models] if models else shipped_models()
    verdicts = [verify_model(folder) for folder in folders]
    for verdict in verdicts:
        for problem in verdict.problems:
            warn(f"{problem}\n  hint: copy the model again, or train it again")
    if json:
        entries = [{"ok": verdict.ok, **vars(verdict)} for verdict in verdicts]
        print_json({"ok": all(verdict.ok for verdict in verdicts), "models": entries})
    else:
        for verdict in verdicts:
            tell(_found(verdict))
    if not all(verdict.ok for verdict in verdicts):
        raise typer.Exit(1)


def _found(verdict: "ModelVerdict") -> str:
    hashes = "hashes compared" if verdict.hashes else "no hashes recorded"
    loads = "weights loaded" if verdict.loads else "weights do not load"
    found = "nothing is wrong" if verdict.ok else counted(len(verdict.problems), "problem")
    return f"{verdict.name}: {verdict.skill}, {verdict.kind}, {hashes}, {loads}: {found}"


def _lines(told: "ModelDescription") -> list[str]:
    return [
        f"{told.name}: {told.skill}, {told.kind}, {told.parameters:,} trained values, {told.bytes / 1e6:.1f} MB",
        f"licence: {told.licence or 'not recorded'}",
        f"seed of the training: {'not recorded' if told.seed is None else told.seed}",
        *(f"trained on: {_dataset(entry)}" for entry in told.data),
        *([] if told.data else ["trained on: not recorded"]),
        *_figures(told.figures),
        *(f"{name}: SHA-256 {digest}" for name, digest in told.hashes.items()),
        *([] if told.hashes else ["no hashes recorded"]),
        *([f"made with: {', '.join(f'{k} {v}' for k, v in told.versions.items())}"] if told.versions else []),
        *([f"card: {told.card}"] if told.card else []),
    ]


def _dataset(entry: dict[str, object]) -> str:
    boards, objects = entry.get("boards", entry.get("episodes")), entry.get("assets")
    told = [f"{boards} boards{f' of {objects} objects' if objects else ''}"]
    told += [f"seed {entry['seed']}"] if entry.get("seed") is not None else []
    return ", ".join([*told, f"content hash {entry.get('content_hash')}"])


def _figures(figures: dict[str, object], indent: str = "") -> list[str]:
    lines = []
    for name, value in figures.items():
        if value == {}:
            continue
        if isinstance(value, dict):
            lines += [f"{indent}{name}:", *_figures(value, indent + "  ")]
        else:
            lines.append(f"{indent}{name}: {f'{value:.3f}' if isinstance(value, float) else value}")
    return lines
