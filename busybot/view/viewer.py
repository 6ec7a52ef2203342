"""From a file or dataset to the viewer: the one call of `busybot view`.

The viewer for people: in a window, or in a browser on this machine.
"""

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import quote

from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import collect_command
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.interact.policy.policy_factory import load_once, policy_config
from busybot.interact.policy.policy_trace import PolicyTrace, retrace
from busybot.objects.library import Library
from busybot.plan.agent_policy import is_rollout
from busybot.reason.evaluation.prediction import Explanation, explain
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.registry import infer, reasoner_of
from busybot.sim.replay import pictures_again
from busybot.view.annotations import visible
from busybot.view.rerun.recording import RecordingLayers, save_rrd
from busybot.view.viewer_process import (
    FAULTS,
    LOOPBACK,
    free_port,
    go_to_step,
    last_words,
    save_screenshot,
    viewer_process,
)

WEB_PORT = 9090
START_SECONDS = 30.0


def has_display() -> bool:
    """Whether a window can open here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def require_display() -> None:
    """Refuse early where no window can open."""
    if not has_display():
        raise BusybotError(
            "there is no display for the viewer's window",
            "use --web (in a browser), --save F.rrd (to open elsewhere) or --screenshot F.png",
        )


def show_window(rrd: Path, step: int | None = None) -> None:
    """Open the native viewer and return when it is closed.

    Raises:
        BusybotError: there is no display, or the viewer fails.
    """
    require_display()
    with tempfile.TemporaryDirectory(prefix="busybot-view-") as name:
        port = free_port()
        with viewer_process(["--port", str(port), str(rrd.resolve())], Path(name), private=False) as process:
            if step is not None:
                with contextlib.suppress(*FAULTS):  # the window is open all the same
                    go_to_step(process, port, step)
            if process.wait() != 0:
                what = f"the viewer ended with exit code {process.returncode}\n{last_words(Path(name))}"
                raise BusybotError(what.rstrip(), "busybot doctor, or use --web")


def serve_web(rrd: Path, announce: Callable[[str], None]) -> None:
    """Serve the viewer to browsers on this machine until Ctrl-C; `announce` is given the address once it answers.

    Raises:
        BusybotError: the server does not start or ends by itself.
    """
    with tempfile.TemporaryDirectory(prefix="busybot-view-") as name:
        data_port, web_port = free_port(), _preferred_port()
        origin = f"http://{LOOPBACK}:{web_port}"
        arguments = ["--serve-web", "--port", str(data_port), "--web-viewer-port", str(web_port)]
        arguments += ["--cors-allow-origin", origin, str(rrd.resolve())]
        with viewer_process(arguments, Path(name)) as process:
            try:
                _wait_for_port(process, web_port, Path(name))
                announce(f"{origin}?url={quote(f'rerun+http://{LOOPBACK}:{data_port}/proxy', safe='')}")
                process.wait()
            except KeyboardInterrupt:
                return
            _refuse(f"it ended with exit code {process.returncode}", Path(name))


def _preferred_port() -> int:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, WEB_PORT))
            return WEB_PORT
        except OSError:
            return free_port()


def _wait_for_port(process: "subprocess.Popen[bytes]", port: int, folder: Path) -> None:
    deadline = time.monotonic() + START_SECONDS
    while time.monotonic() < deadline and process.poll() is None:
        try:
            socket.create_connection((LOOPBACK, port), 1).close()
            return
        except OSError:
            time.sleep(0.1)
    _refuse("it does not answer" if process.poll() is None else f"it ended with exit code {process.returncode}", folder)


def _refuse(what: str, folder: Path) -> None:
    said = last_words(folder)
    raise BusybotError(f"the web viewer: {what}\n{said}".rstrip(), "use --save F.rrd and open the file with rerun")


@dataclass(frozen=True)
class ViewRequest:
    """What to do with an episode; with nothing of `save`, `screenshot`, `figure` and `web`, a window opens.

    Attributes:
        model: an interaction model whose affordances are shown.
        step: of the screenshot and the window, the last one by default; 0 is the start.
        objects: put every step back into the simulator with these and show its picture, too.
        figure: a picture of what the reasoner, or counting, infers step by step; of a rollout, without a reasoner, of
            its actions on the way to the goal.
        reasoner: show what this model of relations believes and expects, beside what counting infers.
    """

    save: Path | None = None
    screenshot: Path | None = None
    figure: Path | None = None
    step: int | None = None
    web: bool = False
    model: str | None = None
    objects: Library | None = None
    reasoner: str | None = None


@dataclass(frozen=True)
class ViewResult:
    """What was done: the episode's file, its number of steps, what was inferred, what was written or is served."""

    episode: Path
    steps: int
    inferred: list[str]
    save: Path | None
    screenshot: Path | None
    figure: Path | None = None
    url: str | None = None


def _refuse_other_kinds(wanted: ViewRequest) -> None:
    """A file's name says what it is."""
    kinds = (("--save", wanted.save, ".rrd"), ("--screenshot", wanted.screenshot, ".png"))
    for option, path, suffix in (*kinds, ("--figure", wanted.figure, ".png")):
        if path is not None and path.suffix.lower() != suffix:
            raise BusybotError(f"{option} {path}: it writes {suffix} files", f"name a file that ends in {suffix}")


def show(source: Path, number: int | None, wanted: ViewRequest, announce: Callable[[ViewResult], None]) -> None:
    """Show an episode, with what counting infers about it.

    Args:
        source: an episode's file or a dataset's folder.
        number: of the episode in the dataset; by default the first that is there.
        announce: called once, when everything is written and before the viewer is waited for.

    Raises:
        BusybotError: the input is at fault, or the viewer fails.
    """
    _refuse_other_kinds(wanted)
    path = episode_file(source, number)
    window = not (wanted.web or wanted.save or wanted.screenshot or wanted.figure)
    if window:
        require_display()
    episode = read_episode(path, images="lazy")
    steps = len(episode.steps)
    if wanted.step is not None and not 0 <= wanted.step <= steps:
        raise BusybotError(f"{path}: there is no step {wanted.step}", f"choose one from 0 (the start) to {steps}")
    foreseen = None if wanted.reasoner is None else explain(episode, reasoner_of(wanted.reasoner))
    inferred = ([foreseen.graph] if foreseen else []) + inferences(episode)

    def layers() -> RecordingLayers:
        return _layers(path, episode, wanted, foreseen)

    if wanted.save:
        save_rrd(wanted.save, episode, inferred, layers=layers())
    if wanted.screenshot:
        picture_episode(episode, inferred, wanted.screenshot, wanted.step, layers())
    if wanted.figure and is_rollout(episode) and foreseen is None:
        draw_sequence(wanted.figure, episode)
    elif wanted.figure:
        draw_beliefs(wanted.figure, path, episode, inferred)
    shown = ViewResult(path, steps, [graph.name for graph in inferred], wanted.save, wanted.screenshot, wanted.figure)
    if wanted.web or window:
        _show_live(episode, inferred, layers(), wanted, shown, announce)
    else:
        announce(shown)


def _show_live(
    episode: Episode,
    inferred: list[InferredGraph],
    layers: RecordingLayers,
    wanted: ViewRequest,
    shown: ViewResult,
    announce: Callable[[ViewResult], None],
) -> None:
    with tempfile.TemporaryDirectory(prefix="busybot-view-") as folder:
        rrd = Path(folder) / f"{shown.episode.stem}.rrd"
        save_rrd(rrd, episode, inferred, layers=layers)
        if wanted.web:
            serve_web(rrd, lambda url: announce(replace(shown, url=url)))
        else:
            announce(shown)
            show_window(rrd, wanted.step)


def episode_file(source: Path, number: int | None = None) -> Path:
    """The episode's file that `source` and `number` mean; `show` tells what they are."""
    if not source.exists():
        raise BusybotError(f"{source}: there is no such file or folder", "name an episode's .mcap file or a dataset")
    if not source.is_dir():
        if number is not None:
            raise BusybotError(f"{source}: a file holds one episode", "leave --episode out, or name the dataset")
        return source
    dataset = Dataset.open(source)
    finished = dataset.finished()
    if not finished:
        raise BusybotError(f"{source}: the dataset has no episodes yet", collect_command(source, dataset.info))
    if number is None:
        number = min(finished)
    elif number not in finished:
        hint = f"{collect_command(source, dataset.info)}, or another number"
        raise BusybotError(f"{source}: episode {number} is not there", hint)
    return dataset.episode_path(number)


def inferences(episode: Episode) -> list[InferredGraph]:
    """What counting makes of the episode; nothing where there are no steps or no boxes."""
    if not episode.steps or not len(visible(episode.image(0))):
        return []
    return [infer(episode, "count")]


def draw_beliefs(picture: Path, path: Path, episode: Episode, inferred: list[InferredGraph]) -> None:
    """Write a PNG of the first of the graphs, step by step."""
    from busybot.view.figures.sequences import belief_figure

    if not inferred or not episode.steps:
        raise BusybotError(f"{path}: nothing can be inferred without boxes or steps", "leave --figure out")
    belief_figure(picture, episode, inferred[0])


def draw_sequence(picture: Path, episode: Episode) -> None:
    """Write a PNG of a rollout, action by action."""
    from busybot.view.figures.sequences import sequence_figure

    sequence_figure(picture, episode)


def thoughts_of(episode: Episode, model: str | None) -> Iterator[PolicyTrace] | None:
    """What an interaction model, by its name or folder, makes of the episode; None without a model."""
    if model is None:
        return None
    loaded = load_once(model)
    return retrace(episode, loaded, policy_config(loaded.info, {}))


def _layers(path: Path, episode: Episode, wanted: ViewRequest, foreseen: Explanation | None) -> RecordingLayers:
    """What is asked for beyond the recording; iterators, so anew for every use."""
    replayed = None if wanted.objects is None else pictures_again(path, wanted.objects)
    return RecordingLayers(thoughts_of(episode, wanted.model), replayed, foreseen)


def picture_episode(
    episode: Episode,
    inferred: list[InferredGraph],
    picture: Path,
    step: int | None = None,
    layers: RecordingLayers | None = None,
) -> None:
    """Write a PNG of the viewer at a step (the last by default), without menus."""
    with tempfile.TemporaryDirectory(prefix="busybot-view-") as folder:
        rrd = Path(folder) / "episode.rrd"
        save_rrd(rrd, episode, inferred, menus=False, layers=layers)
        save_screenshot(rrd, picture, len(episode.steps) if step is None else step)
