"""`busybot replay EPISODE`: put recorded steps back into the simulator and compare."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from busybot.cli.common import check_file, counted, pixel_shares, print_json, say, tell
from busybot.cli.options import AssetsOption, DeviceOption, JsonOption

if TYPE_CHECKING:
    from busybot.sim.replay import Compared


def replay(
    episode: Annotated[Path, typer.Argument(metavar="EPISODE", help="An episode's .mcap file.", show_default=False)],
    step: Annotated[int | None, typer.Option(min=0, help="Step to put back, 0 is the start; all by default.")] = None,
    screenshot: Annotated[Path | None, typer.Option(help="Write the simulator's picture of that step, F.png.")] = None,
    assets: AssetsOption = None,
    device: DeviceOption = "auto",
    json: JsonOption = False,
) -> None:
    """Put recorded steps back into the simulator and compare states, joints and picture with the recording.

    Pictures must be equal where the renderer is the one that recorded, else close: at most 0.1 % of the pixels differ
    by more than 2/255. Exits with 1 if a step does not hold.
    """
    from busybot.datasets.bundled_assets import library_of_file
    from busybot.episodes.mcap.reader import read_episode
    from busybot.sim.replay import replay_file

    check_file("--screenshot", screenshot, "step.png", ".png")
    read_episode(episode, images="lazy")  # a fault of the file is told before objects are looked for
    compared = replay_file(episode, library_of_file(episode, assets), step, screenshot)
    holds = all(one.holds for one in compared)
    if json:
        print_json({"episode": episode, "ok": holds, "steps": compared, "screenshot": screenshot})
    else:
        for one in compared:
            tell(_sentence(one))
        if screenshot:
            tell(screenshot)
        say(f"{episode}: {counted(len(compared), 'step')} put back, {'all hold' if holds else 'not all hold'}")
    if not holds:
        raise typer.Exit(1)


def _sentence(one: "Compared") -> str:
    states = "states equal" if one.states else "states differ"
    picture = "picture equal" if one.image.equal else f"picture differs: {pixel_shares(one.image)}"
    verdict = "holds" if one.holds else "does not hold"
    return f"step {one.step}: {states}, joints within {one.joints:.1e}, {picture}; rule {one.rule}: {verdict}"
