"""Putting a recorded step back into the simulator, exactly, and acting a recording again.

Between interactions every joint rests in the detent of its state and every responder shows what its trigger commands,
so the recorded discrete states decide all joints: actions need not be replayed. To the last bit a link's pose depends
on whether PhysX computed it in a step or because joints were set (they round differently, by some 1e-6 units, which
shows in the depth image and, rarely, in a colour). When an image was recorded, everything had been through a step but
the object that had just been acted on and its responder. `put_back` does the same: it sets all states, makes one step,
and lets the acted link settle once more. With the same renderer the image is then equal in every bit
(`tests/sim/test_replay.py` tries all steps). Under the real camera everything had been through a step, and the photo is
taken again of the clean picture, which is thereby there, too.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from busybot.boards.dynamics import Dynamics, DynamicState, Links
from busybot.boards.spec import BoardSpec
from busybot.boards.task import start_states
from busybot.boards.worlds import links_of
from busybot.common.atomic_io import write_atomically
from busybot.common.errors import BusybotError, naming
from busybot.common.frozen_model import first_fault
from busybot.common.process_pool import run_tasks
from busybot.episodes.codec import LazyImages, encode_rgb
from busybot.episodes.episode import Episode, Image, Step
from busybot.episodes.episode_diff import JOINT_TOLERANCE, ImageDifference, Rule, compare_images, rule_for
from busybot.episodes.mcap.reader import read_episode
from busybot.objects.library import Library
from busybot.sim.interaction import Grasp, InteractionConfig, interact, look
from busybot.sim.recorder import begin_episode, recorded_versions, renderer_fingerprint
from busybot.sim.scene.board_scene import BoardScene, BoardState, Simulator
from busybot.sim.scene.render import RenderConfig

REPLAY_SECONDS = 24 * 3600.0
OTHER_OBJECTS = "name the library with which it was recorded: --assets DIR"
OTHER_RECORDINGS = "only recordings of this simulator can be put back"
Config = TypeVar("Config", bound=BaseModel)


@dataclass(frozen=True)
class Compared:
    """How the simulator differs from the recording at a step.

    Attributes:
        step: 0 is the start, k the board after k steps.
        states: whether all discrete states, of triggers and responders, are equal.
        joints: the largest difference of a joint's position, radians or board units.
        image: how the picture differs from the recorded one, both through the file's codecs.
        rule: which pictures are equal enough: `equal` or `close`; see `episodes.episode_diff`.
    """

    step: int
    states: bool
    joints: float
    image: ImageDifference
    rule: Rule

    @property
    def holds(self) -> bool:
        return self.states and self.joints <= JOINT_TOLERANCE and self.image.holds(self.rule)


class EpisodeReplay:
    """A recorded episode's board in the simulator.

    Args:
        simulator: from `simulator_of`, with the episode's objects; episodes with the same settings can share it.
        episode: read with `images="lazy"`.

    Raises:
        BusybotError: it knows no states, or states that the objects' links do not have.
    """

    def __init__(self, simulator: Simulator, episode: Episode):
        _require_truth(episode)
        self.episode = episode
        self.scene = simulator.board(episode.board)
        triggers = sum(link.trigger for link in episode.links)
        if episode.steps and len(self.scene.triggers) != triggers:
            what = f"the recording has {triggers} trigger links, the objects {len(self.scene.triggers)}"
            raise BusybotError(what, OTHER_OBJECTS)
        self._triggers = _trigger_states(episode, self.scene.dynamics.links)
        now = replace(episode, renderer=renderer_fingerprint(self.scene), versions=recorded_versions())
        self._rule = rule_for(episode, now)

    def put_back(self, step: int) -> BoardScene:
        """The scene as it was after `step` steps (0: at the start), in every bit; see the module.

        Raises:
            BusybotError: there is no such step.
        """
        steps = self.episode.steps
        if not 0 <= step <= len(steps):
            raise BusybotError(f"there is no step {step}", f"choose one from 0 (the start) to {len(steps)}")
        states = self._triggers[step]
        if self.scene.dynamics.remembers:
            self.scene.rest(BoardState(states, self._remembered[step]))
            return self.scene
        self.scene.rest(BoardState(states))
        looked_at_rest = not self.scene.view.camera.clean
        last = None if looked_at_rest else next((s for s in reversed(steps[:step]) if s.success), None)
        number = None if last is None else held_trigger(self.scene, last)
        if number is not None:
            self.scene.set_trigger(number, states[number])
        return self.scene

    @cached_property
    def _remembered(self) -> list[DynamicState]:
        """What the mechanisms remember at the start and after each step, which the trigger links' states decide."""
        return self.scene.dynamics.run(self._triggers)

    def observe(self, step: int) -> Image:
        """The camera's picture after `step` steps as the file would have stored it.

        The clean one is `put_back(step).observe()`.
        """
        image = look(self.put_back(step), _seed_of(self.episode), step)
        images = self.episode.images
        return images.as_stored(image) if isinstance(images, LazyImages) else image

    def compare(self, step: int) -> Compared:
        """Put a step back and compare with what was recorded."""
        image = self.observe(step)
        steps = self.episode.steps
        states, joints = True, 0.0
        if steps:
            when, recorded = ("after", steps[step - 1]) if step else ("before", steps[0])
            here = (self.scene.trigger_states(), self.scene.responder_states())
            states = here == tuple(getattr(recorded, f"{name}_states_{when}") for name in ("trigger", "responder"))
            states &= not step or self.scene.memory == recorded.memory_after
            there = np.array(getattr(recorded, f"joint_positions_{when}"))
            if len(there) != len(self.scene.triggers):
                raise BusybotError(f"step {step}: the recording tells no positions of its joints", OTHER_RECORDINGS)
            joints = float(np.abs(there - self.scene.joint_positions()).max(initial=0.0))
        return Compared(step, states, joints, compare_images(self.episode.image(step), image), self._rule)


def replay_file(
    path: Path, library: Library, step: int | None = None, screenshot: Path | None = None
) -> list[Compared]:
    """Compare a step of an episode's file, or all of them, in a process of its own.

    A process that has rendered can fail in the graphics driver when it ends; a worker ends without that.

    Args:
        screenshot: write the clean picture of the step, or of the last one, as PNG.
    """
    arguments = (path, library, step, screenshot)
    with naming(path):
        [(_, compared)] = run_tasks([0], _make_replay, arguments, workers=1, task_seconds=REPLAY_SECONDS)
    return compared


def _make_replay(path: Path, library: Library, step: int | None, screenshot: Path | None) -> Callable[[int], Any]:
    def work(_: int) -> list[Compared]:
        replay = _replay_of(path, library)
        steps = range(len(replay.episode.steps) + 1) if step is None else range(step, step + 1)
        compared = [replay.compare(number) for number in steps]
        if screenshot:
            picture = replay.put_back(steps[-1]).observe().rgb
            write_atomically(screenshot, encode_rgb(picture, "png"))
        return compared

    return work


def _replay_of(path: Path, library: Library) -> EpisodeReplay:
    episode = read_episode(path, images="lazy")
    return EpisodeReplay(simulator_of(episode, library), episode)


def pictures_again(path: Path, library: Library) -> Iterator[tuple[int, np.ndarray]]:
    """Every step of an episode's file as the simulator shows it and the file would store it, uint8 (H, W, 3).

    They are rendered in a process of its own, see `replay_file`.
    """
    steps = len(read_episode(path, images="lazy").steps)
    with naming(path):
        yield from run_tasks(range(steps + 1), _make_picture, (path, library), workers=1)


def _make_picture(path: Path, library: Library) -> Callable[[int], np.ndarray]:
    replay = _replay_of(path, library)
    return lambda step: replay.observe(step).rgb


def simulator_of(episode: Episode, library: Library) -> Simulator:
    """A simulator that looks at boards as the episode's recorder did, and lets effects show if they did."""
    return Simulator(library, render_config(episode), shows_effects(episode, library))


def render_config(episode: Episode) -> RenderConfig:
    """How the episode's recorder looked at the board.

    Raises:
        BusybotError: the recording does not say, because it is no simulation of this project.
    """
    return _parameters(RenderConfig, episode.renderer.get("config"), "renderer")


def shows_effects(episode: Episode, library: Library) -> bool:
    """Whether responders follow their triggers in the recording; a collection can leave effects out.

    Raises:
        BusybotError: a step has states that the board's links do not have.
    """
    links = links_of([library.get(placed.key) for placed in episode.board.objects])
    if not episode.steps or len(episode.steps[0].trigger_states_after) != len(links.names):
        return True
    states = Dynamics(episode.board, links).run(_trigger_states(episode, links))
    return all(step.responder_states_after == s.shown for step, s in zip(episode.steps, states[1:], strict=True))


def _trigger_states(episode: Episode, links: Links) -> list[tuple[int, ...]]:
    """States of the trigger links at the start and after each step.

    Raises:
        BusybotError: a step has states that the links do not have.
    """
    found = [start_states(episode.board), *(step.trigger_states_after for step in episode.steps)]
    for number, states in enumerate(found):
        known = len(states) == len(links.sizes)
        if not known or any(not 0 <= state < size for state, size in zip(states, links.sizes, strict=True)):
            what = f"step {number}: states {list(states)} of trigger links that have {list(links.sizes)} states"
            raise BusybotError(what, OTHER_OBJECTS)
    return found


def held_trigger(scene: BoardScene, step: Step) -> int | None:
    """Number of the trigger joint that the gripper held in a recorded step, None for a miss.

    Raises:
        BusybotError: the board has no such link.
    """
    if step.acted_object < 0:
        return None
    if (step.acted_object, step.acted_link) not in scene.trigger_numbers:
        what = f"the recording holds link {step.acted_link!r} of object {step.acted_object}"
        raise BusybotError(f"{what}, the board has no such trigger", OTHER_OBJECTS)
    return scene.trigger_numbers[step.acted_object, step.acted_link]


def act_again(simulator: Simulator, board: BoardSpec, recorded: Episode) -> Episode:
    """Execute an episode's actions on a board from its start and record what happens.

    The gripper takes hold of the recorded link at the recorded place, whatever the new picture shows there; pictures
    are compared by themselves.
    """
    _require_truth(recorded)
    interaction = recorded.settings.get("interaction")
    config = _parameters(InteractionConfig, interaction, "interaction")
    scene = simulator.board(board)
    images = [look(scene, _seed_of(recorded), 0)]
    again = begin_episode(scene, images, recorded.policy, recorded.oracle, recorded.settings)
    for step in recorded.steps:
        grasp = Grasp(held_trigger(scene, step), np.array(step.position), step.pixel)
        done, after = interact(scene, grasp, step.executed or (step.direction,), config, images[-1])
        again.steps.append(done)
        images += [] if after is None else [after]
        again.frame_of.append(len(images) - 1)
    return again


def _seed_of(episode: Episode) -> int:
    """Seed of the collection, from which the real camera's draws come."""
    seed = episode.settings.get("seed", 0)
    if not isinstance(seed, int):
        raise BusybotError(f"the recording's settings, seed: {seed!r} is no whole number", OTHER_RECORDINGS)
    return seed


def _require_truth(episode: Episode) -> None:
    if not any(link.trigger for link in episode.links):
        raise BusybotError("the recording has no states: it was not made in the simulator", "choose a simulated one")


def _parameters(model: type[Config], values: Any, what: str) -> Config:
    try:
        return model.model_validate(values)
    except ValidationError as error:
        fault = f"the recording's settings, {what}: {first_fault(error)}"
        raise BusybotError(fault, OTHER_RECORDINGS) from None
