"""`busybot view EPISODE|DATASET`: an episode in Rerun, as a window, web page, file or picture."""

import signal
from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import typer

from busybot.cli.common import check_file, print_json, say, tell
from busybot.cli.options import DeviceOption, JsonOption, interaction_models, offering, reasoners


def view(
    source: Annotated[Path, typer.Argument(metavar="EPISODE|DATASET", help="An episode's .mcap file, or a dataset.")],
    episode: Annotated[int | None, typer.Option(min=0, help="Number in the dataset; the first by default.")] = None,
    save: Annotated[Path | None, typer.Option(help="Write a recording for Rerun, F.rrd.")] = None,
    screenshot: Annotated[
        Path | None, typer.Option(help="Write a picture of the viewer, F.png; needs no screen.")
    ] = None,
    figure: Annotated[
        Path | None,
        typer.Option(
            help="Draw the graph inferred after 1 to 22 steps, a rollout's way to its goal, or (worlds other than the "
            "paper's) mechanisms with causes and effects, into F.png."
        ),
    ] = None,
    step: Annotated[int | None, typer.Option(min=0, help="Step to show, 0 is the start; the last by default.")] = None,
    web: Annotated[bool, typer.Option("--web", help="Serve to browsers on this machine, until Ctrl-C.")] = False,
    model: Annotated[
        str | None,
        typer.Option(
            help="Show what this interaction model believes: name or folder.",
            autocompletion=offering(interaction_models),
        ),
    ] = None,
    reasoner: Annotated[
        str | None,
        typer.Option(
            help="Show what this model of relations believes and expects: lookup, or a folder.",
            autocompletion=offering(reasoners),
        ),
    ] = None,
    replay: Annotated[
        bool, typer.Option("--replay", help="Put every step back into the simulator and show its picture, too.")
    ] = False,
    assets: Annotated[str | None, typer.Option(help="Objects for --replay, if they are not found by hash.")] = None,
    device: DeviceOption = "auto",
    json: JsonOption = False,
) -> None:
    """Look at an episode: camera, scene graph, board with relations, signals. Without options a window opens."""
    from busybot.datasets.bundled_assets import library_of_file
    from busybot.view.viewer import ViewRequest, episode_file, show

    if step is not None and not screenshot and (save or web or figure):
        raise typer.BadParameter("it needs --screenshot or the viewer's window", param_hint="--step")
    if assets is not None and not replay:
        raise typer.BadParameter("it needs --replay", param_hint="--assets")
    for option, given in (("--model", model is not None), ("--replay", replay)):
        if given and figure and not (save or screenshot or web):
            raise typer.BadParameter("a figure does not show it; it needs another output, too", param_hint=option)
    for option, path, kind in (
        ("--save", save, ".rrd"),
        ("--screenshot", screenshot, ".png"),
        ("--figure", figure, ".png"),
    ):
        check_file(option, path, f"episode{kind}", kind)
    objects = library_of_file(episode_file(source, episode), assets) if replay else None
    wanted = ViewRequest(save, screenshot, figure, step, web, model, objects, reasoner)
    before = signal.signal(signal.SIGTERM, _interrupt)
    try:
        show(source, episode, wanted, print_json if json else _tell)
    finally:
        signal.signal(signal.SIGTERM, before)


def _interrupt(number: int, frame: object) -> None:
    """Being asked to end is like Ctrl-C: temporary folders and viewers are cleared away."""
    raise KeyboardInterrupt


def _tell(shown: Any) -> None:
    for path in filter(None, (shown.save, shown.screenshot, shown.figure)):
        tell(path)
    if shown.save:
        say(f"open it with: rerun {quote(str(shown.save))}")
    if shown.url:
        tell(shown.url)
        say("open this address in a browser on this machine; Ctrl-C ends it")
