"""`busybot train interact`: learn where and how to act."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from busybot.cli.common import JsonOption, SeedOption, WorkersOption, episode_progress, kept_in, print_json, say
from busybot.common.errors import BusybotError

if TYPE_CHECKING:
    from busybot.interact.training.fast import Training
    from busybot.interact.training.paper import PaperTraining


def interact(
    out: Annotated[Path, typer.Option(help="Folder of the training; the same command continues in it.")],
    model: Annotated[
        str | None, typer.Option(help="Variant of networks and schedule: fast (default) or paper.")
    ] = None,
    assets: Annotated[str | None, typer.Option(help="Objects to act on: procedural, or a folder.")] = None,
    data: Annotated[
        list[Path] | None, typer.Option(help="Recorded rounds to train on instead of collecting; repeatable.")
    ] = None,
    offline: Annotated[bool, typer.Option("--offline", help="Collect nothing: train on OUT/rounds.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Refuse moves far off the annotated directions.")] = False,
    seed: SeedOption = 0,
    workers: WorkersOption = None,
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters (TrainConfig, PaperConfig).")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="Any parameter, as interaction.delta=1000.")] = None,
    json: JsonOption = False,
) -> None:
    """Learn where and how to act, in rounds: collect with what is known, then train on all that is recorded."""
    if offline and not data and not (out / "rounds").is_dir():
        raise BusybotError(f"{out}: it has no folder `rounds` to train on", "collect first: leave --offline out")
    if assets and (offline or data):
        raise BusybotError(f"--assets {assets}: nothing is collected", "leave it out, or --offline and --data")
    options = {"variant": model, "interaction.strict": strict or None}
    objects = None if offline or data else assets or "procedural"
    training = _interaction(out, (config, set_ or [], options), objects, tuple(data or ()), seed, workers)
    with kept_in(out):
        trained = training.run()
    if json:
        print_json({"out": out, "model": out / "model", "training": trained.info.training})
    else:
        say(f"the model is in {out / 'model'}")
        say(f"next: busybot eval interact DATASET --model {out}")


def _interaction(
    out: Path,
    parameters: tuple[Path | None, list[str], dict[str, Any]],
    assets: str | None,
    data: tuple[Path, ...],
    seed: int,
    workers: int | None,
) -> "Training | PaperTraining":
    """The training of the variant that is asked for; without assets nothing is collected."""
    from busybot.common.config import build
    from busybot.common.process_pool import default_workers
    from busybot.interact.training.config import STRICT, PaperConfig, RecordConfig, TrainConfig
    from busybot.interact.training.fast import Training
    from busybot.interact.training.paper import PaperTraining
    from busybot.interact.training.round_recorder import Recorder, RoundProgress
    from busybot.objects.resolve import find

    variant = parameters[2]["variant"]
    if variant not in (None, "fast", "paper"):
        raise BusybotError(f"there is no variant {variant!r} of the interaction networks", "choose fast or paper")
    told, processes = RoundProgress(say, episode_progress), workers or default_workers()

    def recorder(config: RecordConfig) -> Recorder:
        return Recorder(find(assets) if assets else None, config, seed, processes, told)

    if variant == "paper":
        paper = build(PaperConfig, *parameters)
        return PaperTraining(out, paper, recorder(paper), data)
    fast = build(TrainConfig, *parameters)
    if fast.interaction.strict:  # whether the option said so, a setting or the file
        fast = build(TrainConfig, *parameters, STRICT)
    return Training(out, fast, recorder(fast), data)
