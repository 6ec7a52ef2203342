"""`busybot generate OUT`: a dataset of boards, without a simulator."""

import re
from pathlib import Path
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

    What the same command made before is left alone, with as many boards. With more --boards the dataset grows: the
    rest is drawn, and its episodes stay.
    """
    from busybot.boards.config import BoardConfig
    from busybot.boards.generate import REASONS, Redraws
    from busybot.boards.spec import PAPER
    from busybot.common.config import build
    from busybot.datasets.create import create_dataset
    from busybot.datasets.dataset import INFO_FILE, Dataset
    from busybot.datasets.info import collect_command
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
    usual = {"boards": Dataset.open(out).info.boards} if (out / INFO_FILE).is_file() else None
    parameters = build(BoardConfig, config, set_ or [], options, usual)
    redraws = Redraws()
    library = find(assets)
    with episode_progress("drawing") as progress:
        dataset = create_dataset(out, parameters, library, redraws, progress)
    if json:
        thrown = {reason: redraws[reason] for reason in REASONS}
        facts = {name: getattr(dataset.info, name) for name in ("boards", "split", "seed")}
        print_json(
            {
                "dataset": out,
                **facts,
                "assets": dataset.info.assets.name,
                "board_hash": dataset.hashes().board,
                "redraws": thrown,
            }
        )
    else:
        where = "" if parameters.world == PAPER else f", world {parameters.world}"
        goals = f" with {parameters.tasks} tasks" if parameters.tasks else ""
        made = f"{counted(dataset.info.boards, 'board')}{goals} ({dataset.info.split}{where}) in {out}"
        name = dataset.info.assets.name
        made += ", of procedural objects" if name == "procedural" else f", of objects from {name}"
        say(f"{made}; {redraws.total()} draws did not fit and were redrawn")
        say(f"next: {collect_command(out, dataset.info, own_name())}")


def _range(given: str | None) -> tuple[int, int] | None:
    """Least and most, of `3-6` or `4`.

    Raises:
        UsageError: it is neither, the wrong way round, or beyond what a board may have.
    """
    if given is None:
        return None
    from busybot.boards.config import MOST
    from busybot.common.errors import UsageError

    found = re.fullmatch(r"([0-9]{1,2})(?:-([0-9]{1,2}))?", given)
    least, most = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
    if not least <= most <= MOST:
        hint = f"give the least and the most number of trigger links on a board, at most {MOST}, as 3-6"
        raise UsageError(f"--links {given[:40]!r} is no range", hint)
    return least, most
