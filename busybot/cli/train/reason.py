"""`busybot train reason`: learn which trigger controls which responder."""

from pathlib import Path
from typing import Annotated

import typer

from busybot.cli.common import JsonOption, SeedOption, WorkersOption, episode_progress, kept_in, print_json, say
from busybot.common.errors import BusybotError


def reason(
    out: Annotated[Path, typer.Option(help="Folder of the training; the same command continues in it.")],
    data: Annotated[list[Path], typer.Option(help="Dataset with episodes to train on; repeatable.")],
    model: Annotated[str, typer.Option(help="Which kind of networks: event or paper.")] = "event",
    encoder: Annotated[
        str | None, typer.Option(help="Features to read: embedded (default), resnet50 or random.")
    ] = None,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    config: Annotated[
        Path | None, typer.Option(help="YAML file with parameters (EventConfig, PaperReasonConfig).")
    ] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as net.width=64.")] = None,
    json: JsonOption = False,
) -> None:
    """Learn relations and effects from recorded episodes, without ever being told either."""
    from busybot.common.config import build
    from busybot.reason.train import CONFIGS, train_reason

    if model not in CONFIGS:
        raise BusybotError(f"there is no model {model!r} of relations to train", f"choose {' or '.join(CONFIGS)}")
    parameters = build(CONFIGS[model], config, set_ or [], {"encoder": encoder})
    with kept_in(out):
        trained = train_reason(out, parameters, tuple(data), seed, episode_progress, workers)
    if json:
        print_json({"out": out, "model": out / "model", "training": trained.training})
    else:
        say(f"the model is in {out / 'model'}")
        say(f"next: busybot eval reason DATASET --model {out}")
