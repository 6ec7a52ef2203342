"""The one call of `busybot view`: from a file or dataset to the viewer, to a picture, or to a recording."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from busybot.boards.spec import PAPER
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import collect_command
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.interact.policy.policy_factory import load_once, policy_config
from busybot.interact.policy.policy_trace import retrace
from busybot.objects.library import Library
from busybot.plan.agent_policy import is_rollout
from busybot.reason.evaluation.prediction import explain
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.registry import infer, reasoner_of
from busybot.sim.replay import pictures_again
from busybot.view.annotations import visible
from busybot.view.rerun.recording import RecordingLayers, save_rrd
from busybot.view.viewer_process import require_display, save_screenshot, serve_web, show_window


@dataclass(frozen=True)
class ViewRequest:
    """What to do with an episode; with nothing of `save`, `screenshot`, `figure` and `web`, a window opens.

    Attributes:
        model: an interaction model whose affordances are shown.
        step: of the screenshot and the window, the last one by default; 0 is the start.
        objects: put every step back into the simulator with these and show its picture, too.
        figure: a picture of what the reasoner, or counting, infers step by step; of a rollout, without a reasoner, of
            its actions on the way to the goal, and of a board of another world than the paper's its mechanisms.
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


def show(source: Path, number: int | None, wanted: ViewRequest, announce: Callable[[ViewResult], None]) -> None:
    """Show an episode, with what counting infers about it.

    Args:
        source: an episode's file or a dataset's folder.
        number: of the episode in the dataset; by default the first that is there.
        announce: called once, when everything is written and before the viewer is waited for.

    Raises:
        BusybotError: the input is at fault, or the viewer fails.
    """
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
        """What is asked for beyond the recording; iterators, so anew for every use."""
        replayed = None if wanted.objects is None else pictures_again(path, wanted.objects)
        model = None if wanted.model is None else load_once(wanted.model)
        thoughts = None if model is None else retrace(episode, model, policy_config(model.info, {}))
        return RecordingLayers(thoughts, replayed, foreseen)

    if wanted.save:
        save_rrd(wanted.save, episode, inferred, layers=layers())
    if wanted.screenshot:
        picture_episode(episode, inferred, wanted.screenshot, wanted.step, layers())
    if wanted.figure:
        _draw_figure(wanted.figure, path, episode, inferred, asked=foreseen is not None)
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
        there = f"its episodes are {min(finished)} to {max(finished)}"
        hint = f"{collect_command(source, dataset.info)}, or another number: {there}"
        raise BusybotError(f"{source}: episode {number} is not there", hint if number < dataset.info.boards else there)
    return dataset.episode_path(number)


def inferences(episode: Episode) -> list[InferredGraph]:
    """What counting makes of the episode; nothing where there are no steps or no boxes."""
    if not episode.steps or not len(visible(episode.image(0))):
        return []
    return [infer(episode, "count")]


def _draw_figure(picture: Path, path: Path, episode: Episode, inferred: list[InferredGraph], asked: bool) -> None:
    """Write a PNG of what a reasoner that was asked for infers step by step, else of what there is to tell.

    That is a rollout's way to its goal, the mechanisms of a board of another world than the paper's, or what counting
    infers.
    """
    way, mechanisms = not asked and is_rollout(episode), not asked and episode.board.world != PAPER
    from busybot.view.figures.mechanisms import mechanism_figure
    from busybot.view.figures.sequences import belief_figure, sequence_figure

    if way:
        sequence_figure(picture, episode)
    elif mechanisms:
        mechanism_figure(picture, episode)
    elif inferred and episode.steps:
        belief_figure(picture, episode, inferred[0])
    else:
        raise BusybotError(f"{path}: nothing can be inferred without boxes or steps", "leave --figure out")


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
