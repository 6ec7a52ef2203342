"""`busybot train`: learn a skill from recorded files."""

from pathlib import Path
from typing import Annotated

import typer

from busybot.cli.common import CONTEXT, JsonOption, SeedOption, WorkersOption, episode_progress, print_json, say
from busybot.errors import BusybotError

app = typer.Typer(add_completion=False, no_args_is_help=True, context_settings=CONTEXT, help="Learn a skill.")


@app.callback()
def _root() -> None:
    pass


@app.command()
def interact(
    out: Annotated[Path, typer.Option(help="Folder of the training; the same command continues in it.")],
    model: Annotated[str | None, typer.Option(help="Variant of the networks: fast.")] = None,
    assets: Annotated[str | None, typer.Option(help="Objects to act on: procedural, or a folder.")] = None,
    data: Annotated[
        list[Path] | None, typer.Option(help="Recorded rounds to train on instead of collecting; repeatable.")
    ] = None,
    offline: Annotated[bool, typer.Option("--offline", help="Collect nothing: train on OUT/rounds.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Veto directions far from the annotated ones.")] = False,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters of TrainConfig.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as interaction.delta=1000.")] = None,
    json: JsonOption = False,
) -> None:
    """Learn where and how to act, in rounds: collect with what is known, then train on all that is recorded."""
    from busybot.config import build
    from busybot.interact.chooser import ExploreChooser
    from busybot.interact.train import Source, Told, Training
    from busybot.interact.train_config import TrainConfig
    from busybot.objects.library import find
    from busybot.workers import default_workers

    if offline and not data and not (out / "rounds").is_dir():
        raise BusybotError(f"{out}: it has no folder `rounds` to train on", "collect first: leave --offline out")
    parameters = build(TrainConfig, config, set_ or [], {"variant": model, "interaction.strict": strict or None})
    library = None if offline or data else find(assets)
    source = Source(library, lambda known: ExploreChooser(known, parameters.explore), tuple(data or ()))
    training = Training(out, parameters, source, seed, workers or default_workers(), Told(say, episode_progress))
    try:
        trained = training.run()
    except KeyboardInterrupt:
        say(f"what is done is kept in {out}; the same command continues")
        raise
    if json:
        print_json({"out": out, "model": out / "model", "training": trained.info.training})
    else:
        say(f"the model is in {out / 'model'}")
        say(f"next: busybot eval interact DATASET --model {out}")
