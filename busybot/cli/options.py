"""Options that mean the same in every subcommand that has them."""

from typing import Annotated

import typer

from busybot.cli.common import JSON_WANTED
from busybot.common.device import CHOICE, choose


def _remember_json(context: typer.Context, wanted: bool) -> bool:
    context.meta[JSON_WANTED] = wanted
    return wanted


def _take_device(name: str) -> str:
    choose(name)
    return name


JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON object on standard output.", callback=_remember_json, is_eager=True),
]
DeviceOption = Annotated[
    str,
    typer.Option(
        "--device",
        envvar=CHOICE,
        callback=_take_device,
        help="Where pictures are drawn and networks computed: auto (on GPUs if there are any), cpu, cuda or cuda:N.",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of everything that is drawn.")]
WorkersOption = Annotated[
    int | None,
    typer.Option("--workers", min=1, help="Number of processes that share the work; by default one per core."),
]
AssetsOption = Annotated[str | None, typer.Option(help="Objects, if they are not found by their hashes.")]
StrictOption = Annotated[bool, typer.Option("--strict", help="Refuse moves far off the annotated directions.")]
