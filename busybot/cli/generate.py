"""`busybot generate OUT`: a dataset of boards, without a simulator."""

from pathlib import Path
from shlex import quote
from typing import Annotated, Any, Literal

import typer

from busybot.cli.common import counted, episode_progress, own_name, print_json, say
from busybot.cli.options import JsonOption, offering, worlds


def generate(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder to make.", show_default=False)],
    split: Annotated[
        Literal["train", "novel-config", "novel-object", "novel-mechanism"] | None,
        typer.Option(help="train (the default), novel-config, novel-object or novel-mechanism."),
    ] = None,
    world: Annotated[
        str | None,
        typer.Option(
            help="What decides the responders: paper (the default), gates, time, chance, ...; or a kitchen or a room.",
            autocompletion=offering(worlds),
        ),
    ] = None,
    boards: Annotated[int | None, typer.Option(min=1, help="Number of boards; 100 by default.")] = None,
    relations: Annotated[
        Literal["any", "one-to-one", "one-to-many"] | None,
        typer.Option(help="any (the default), one-to-one or one-to-many."),
    ] = None,
    tasks: Annotated[
        Literal["one-to-one", "one-to-many", "reach"] | None,
        typer.Option(
            help="Give every board a goal to plan for: one-to-one, one-to-many or (other worlds) reach; 50 boards."
        ),
    ] = None,
    links: Annotated[str | None, typer.Option(help="Trigger links on a board, as 3-6; more than 6 on request.")] = None,
    assets: Annotated[str, typer.Option(help="`procedural`, or a folder of annotated objects.")] = "procedural",
    uniform: Annotated[bool, typer.Option("--uniform", help="Draw all objects of a category equally often.")] = False,
    include: Annotated[
        list[str] | None, typer.Option(metavar="KEY", help="An object that stands on every board; repeatable.")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY", help="Of its category draw this object alone, as Lamp/lantern-01; repeatable."),
    ] = None,
    group_size: Annotated[
        int | None, typer.Option(min=1, help="Consecutive boards that look alike and differ in relations; 20.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of everything that is drawn; 0 by default.")] = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters (BoardConfig).")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as lamps=[2,3].")] = None,
    json: JsonOption = False,
) -> None:
    """Draw boards: objects, places, colours and hidden relations.

    What the same command made before is left alone. With more --boards the dataset grows: the rest is drawn, and its
    episodes stay.
    """
    from busybot.boards.config import BoardConfig
    from busybot.boards.generate import REASONS, Redraws
    from busybot.boards.spec import PAPER
    from busybot.common.config import build
    from busybot.datasets.create import create_dataset
    from busybot.objects.resolve import find

    options: dict[str, Any] = {
        "split": split,
        "boards": boards,
        "relations": relations,
        "tasks": tasks,
        "group_size": group_size,
    }
    options |= {"world": world, "links": _range(links), "seed": seed, "uniform": uniform or None}
    options |= {"include": include or None, "only": only or None}
    parameters = build(BoardConfig, config, set_ or [], options)
    redraws = Redraws()
    library = find(assets)
    with episode_progress("drawing") as progress:
        dataset = create_dataset(out, parameters, library, redraws, progress)
    if json:
        thrown = {reason: redraws[reason] for reason in REASONS}
        facts = {name: getattr(dataset.info, name) for name in ("boards", "split", "seed")}
        print_json({"dataset": out, **facts, "board_hash": dataset.hashes().board, "redraws": thrown})
    else:
        where = "" if parameters.world == PAPER else f", world {parameters.world}"
        goals = f" with {parameters.tasks} tasks" if parameters.tasks else ""
        made = f"{counted(dataset.info.boards, 'board')}{goals} ({dataset.info.split}{where}) in {out}"
        say(f"{made}; {redraws.total()} draws did not fit and were redrawn")
        say(f"next: {own_name()} collect {quote(str(out))}")


def _range(given: str | None) -> tuple[int, int] | None:
    """Least and most, of `3-6` or `4`.

    Raises:
        UsageError: it is neither.
    """
    if given is None:
        return None
    from busybot.common.errors import UsageError

    least, _, most = given.partition("-")
    if not (least.isdecimal() and (most or least).isdecimal()):
        raise UsageError(f"--links {given!r} is no range", "give the least and the most number, as 3-6")
    return int(least), int(most or least)
