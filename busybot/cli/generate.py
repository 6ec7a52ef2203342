"""`busybot generate OUT`: a dataset of boards, without a simulator."""

from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from busybot.cli.common import counted, episode_progress, own_name, print_json, say
from busybot.cli.options import JsonOption


def generate(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder to make.", show_default=False)],
    split: Annotated[str | None, typer.Option(help="train (the default), novel-config or novel-object.")] = None,
    boards: Annotated[int | None, typer.Option(min=1, help="Number of boards; 100 by default.")] = None,
    relations: Annotated[str | None, typer.Option(help="any (the default), one-to-one or one-to-many.")] = None,
    tasks: Annotated[
        str | None, typer.Option(help="Give every board a goal to plan for: one-to-one or one-to-many; 50 boards.")
    ] = None,
    assets: Annotated[str, typer.Option(help="`procedural`, or a folder of annotated objects.")] = "procedural",
    uniform: Annotated[bool, typer.Option("--uniform", help="Draw all objects of a category equally often.")] = False,
    group_size: Annotated[
        int | None, typer.Option(min=1, help="Consecutive boards that look alike and differ in relations; 20.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of everything that is drawn; 0 by default.")] = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters (BoardConfig).")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as lamps=[2,3].")] = None,
    json: JsonOption = False,
) -> None:
    """Draw boards: objects, places, colours and hidden relations. What the same command made before is left alone."""
    from busybot.boards.config import BoardConfig
    from busybot.boards.generate import REASONS, Redraws
    from busybot.common.config import build
    from busybot.datasets.create import create_dataset
    from busybot.objects.resolve import find

    options = {"split": split, "boards": boards, "relations": relations, "tasks": tasks, "group_size": group_size}
    parameters = build(BoardConfig, config, set_ or [], options | {"seed": seed, "uniform": uniform or None})
    redraws = Redraws()
    library = find(assets)
    with episode_progress("drawing") as progress:
        dataset = create_dataset(out, parameters, library, redraws, progress)
    if json:
        thrown = {reason: redraws[reason] for reason in REASONS}
        facts = {name: getattr(dataset.info, name) for name in ("boards", "split", "seed")}
        print_json({"dataset": out, **facts, "board_hash": dataset.hashes().board, "redraws": thrown})
    else:
        goals = f" with {parameters.tasks} tasks" if parameters.tasks else ""
        made = f"{counted(dataset.info.boards, 'board')}{goals} ({dataset.info.split}) in {out}"
        say(f"{made}; {redraws.total()} draws did not fit and were redrawn")
        say(f"next: {own_name()} collect {quote(str(out))}")
