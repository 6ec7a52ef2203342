"""`busybot demo`: everything once, on procedural objects."""

from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from busybot.cli.common import own_name, print_json, processes, say, tell
from busybot.cli.options import DeviceOption, JsonOption, SeedOption, WorkersOption, interaction_models, offering


def demo(
    out: Annotated[Path | None, typer.Option(help="Folder to make; `demo`, or the next free `demo-2`.")] = None,
    assets: Annotated[str, typer.Option(help="`procedural`, or a folder of annotated objects.")] = "procedural",
    model: Annotated[
        str,
        typer.Option(
            help="Who acts: a shipped model's name or a folder. `procedural` knows procedural objects.",
            autocompletion=offering(interaction_models),
        ),
    ] = "procedural",
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    device: DeviceOption = "auto",
    json: JsonOption = False,
) -> None:
    """Boards, recorded interactions, inferred relations, a goal, and a report with pictures, in a minute or two."""
    from busybot.demo import run_demo

    done = run_demo(out or _free("demo"), seed, processes(workers), say, assets, model)
    if json:
        told = {name: getattr(done, name) for name in ("out", "report", "recording", "pictures")}
        told |= {name: done.result[name] for name in ("boards", "edge_p", "edge_r")}
        print_json({**told, "task_success": done.task_success})
        return
    say(f"\nthe story, to read:  {done.report}")
    say(f"the viewer:          {own_name()} view {quote(str(done.out / 'boards'))}")
    tell(done.out)


def _free(name: str) -> Path:
    """The first of `name`, `name-2`, `name-3`, ... that does not exist."""
    candidate, number = Path(name), 2
    while candidate.exists():
        candidate, number = Path(f"{name}-{number}"), number + 1
    return candidate
