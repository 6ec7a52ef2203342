"""One board, one policy, so many actions: an Episode.

What did not change is not looked at again: an action that moved nothing restores the board exactly, so its image is the
one before, unless a mechanism changed something by itself or late.
The real camera (`scene.real_camera`) looks after every action.
"""

import hashlib
import platform
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from busybot import __version__
from busybot.boards.directions import DIRECTIONS
from busybot.boards.dynamics import HINT_OBJECTS
from busybot.boards.spec import BoardSpec
from busybot.common.errors import BusybotError
from busybot.common.installed import installed_version
from busybot.common.rng import generator
from busybot.episodes.camera import Rays
from busybot.episodes.episode import ENDED, Camera, Episode, Image, Observation
from busybot.sim.interaction import Grasp, InteractionConfig, interact, look
from busybot.sim.policy import (
    Action,
    AnyPolicyFactory,
    DetectingFactory,
    Detections,
    OracleFactory,
    Policy,
    oracle_observation,
)
from busybot.sim.scene.board_scene import BoardScene, BoardState, Simulator
from busybot.sim.scene.real_camera import GOAL_FRAME, REACH, true_depth
from busybot.sim.vulkan_check import driver_of

RECORDED_PACKAGES = ("sapien", "numpy", "opencv-python")


def grasp_at(scene: BoardScene, image: Image, rays: Rays, pixel: tuple[int, int]) -> Grasp:
    """What suction at pixel (u, v) takes hold of; nothing where the image's depth is too wrong."""
    assert image.depth is not None and image.segmentation is not None
    place = (pixel[1], pixel[0])
    near = abs(float(image.depth[place]) - float(true_depth(image)[place])) <= REACH
    held = scene.trigger_at(int(image.segmentation[place])) if near else None
    return Grasp(held, rays.point(image.depth, pixel), pixel)


def record_episode(
    simulator: Simulator, board: BoardSpec, factory: AnyPolicyFactory, steps: int, config: InteractionConfig, seed: int
) -> Episode:
    """Collect one episode of `steps` proposed actions, or fewer if the policy ends it.

    Args:
        factory: of the policy. Only an `OracleFactory` gets the scene; the episode says so.
        seed: of the collection; with the board's split and index it determines every draw of the policy.

    Raises:
        BusybotError: the policy chose what is no action.
    """
    scene = simulator.board(board)
    rays = Rays(scene.camera)
    images, oracle = [look(scene, seed, 0)], isinstance(factory, OracleFactory)
    policy = _policy(factory, scene, rays, config, images[0])
    settings = {"seed": seed, "interaction": config.model_dump(mode="json")}
    episode = begin_episode(scene, images, policy.name, oracle, settings)
    rng = generator(seed, board.split, board.index, f"policy/{factory.name}")
    seen = _observation(images[0], episode)
    for _ in range(steps):
        action = policy.select_action(seen, rng)
        if action is None:
            episode.settings[ENDED] = {"of": steps}
            break
        _check_action(action, policy, episode.camera)
        grasp = grasp_at(scene, images[-1], rays, action.pixel)
        step, after = interact(scene, grasp, action.directions, config, images[-1])
        episode.steps.append(step)
        if after is not None:
            images.append(after)
            shown = _observation(after, episode)
            if oracle or shown.differs(seen):  # that it is a new object must not tell what no pixel does
                seen = shown
        policy.observe(action, step.executed, step.reward, seen)
        episode.frame_of.append(len(images) - 1)
    return episode


def _policy(
    factory: AnyPolicyFactory, scene: BoardScene, rays: Rays, config: InteractionConfig, first: Image
) -> Policy:
    if isinstance(factory, OracleFactory):
        return factory.make_oracle(scene, rays, config)
    if isinstance(factory, DetectingFactory):
        roles = tuple(placed.role for placed in scene.spec.objects)
        return factory.make_detecting(rays, Detections(roles, first.boxes, _visible_centres(first, scene)))
    return factory.make_policy(rays)


def _check_action(action: Action, policy: Policy, camera: Camera) -> None:
    """Refuse a pixel outside of the picture, where negative ones would be taken from its other side."""
    (column, row), known = action.pixel, range(len(DIRECTIONS))
    inside = 0 <= column < camera.width and 0 <= row < camera.height
    if not inside or not action.directions or any(direction not in known for direction in action.directions):
        hint = f"a pixel is (column, row) of {camera.width} x {camera.height}, a direction from 0 to {known[-1]}"
        raise BusybotError(f"the policy {policy.name!r} chose {action}", hint)


def begin_episode(
    scene: BoardScene, images: list[Image], policy: str, oracle: bool, settings: dict[str, Any]
) -> Episode:
    """An episode without steps yet.

    Args:
        images: the first one; those that follow are appended to it.
    """
    return Episode(
        board=scene.spec,
        camera=scene.camera,
        links=scene.links,
        positions=_visible_centres(images[0], scene),
        images=images,
        goals=picture_goal(scene, int(settings.get("seed", 0))),
        frame_of=[0],
        steps=[],
        policy=policy,
        oracle=oracle,
        settings=settings,
        renderer=renderer_fingerprint(scene),
        versions=recorded_versions(),
    )


def _observation(image: Image, episode: Episode) -> Observation:
    """What the episode's policy gets of an image."""
    return oracle_observation(image, episode.camera) if episode.oracle else image.observation(episode.camera)


def picture_goal(scene: BoardScene, seed: int = 0) -> list[Image]:
    """What the camera shows in the goal of the board's task, nothing without a task; the board is afterwards at rest
    where it was.

    All links are put into their goal states and have been through a step since, as in a recording
    (`sim.replay`): the picture is that of a board on which the goal was reached by acting.

    Raises:
        BusybotError: the task's links are not those of the objects.
    """
    task = scene.spec.task
    if task is None:
        return []
    if [(link.object, link.link) for link in task.links] != list(scene.trigger_numbers):
        what = f"board {scene.spec.index}: its task names other links than its objects have"
        raise BusybotError(what, HINT_OBJECTS)
    now = scene.save()
    shown = None if task.responders is None else scene.dynamics.showing(task.goal, task.responders)
    scene.rest(BoardState(task.goal, shown))
    image = look(scene, seed, GOAL_FRAME)
    scene.rest(now)
    return [image]


def _visible_centres(image: Image, scene: BoardScene) -> np.ndarray:
    """Mean position of each object's visible points, float32 (N, 3), board frame; NaN if nothing shows."""
    assert image.depth is not None and image.segmentation is not None
    rays, objects = Rays(scene.camera), len(scene.models)
    owner = np.array([0, *(link.object + 1 for link in scene.links)])[image.segmentation]
    visible = np.flatnonzero((owner > 0) & (image.depth > 0))
    points = rays.directions.reshape(-1, 3)[visible] * image.depth.ravel()[visible, None] + rays.origin
    index = owner.ravel()[visible] - 1
    counts = np.bincount(index, minlength=objects).astype(float)
    sums = np.stack([np.bincount(index, points[:, axis], minlength=objects) for axis in range(3)], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return (sums / counts[:, None]).astype(np.float32)


def renderer_fingerprint(scene: BoardScene) -> dict[str, Any]:
    """What pictures depend on beside the board: equal fingerprints on one machine make equal pictures."""
    config, device = scene.view, scene.scene.render_system.device
    return {
        "device": device.name,
        "driver": driver_of(device.name),
        "sapien": installed_version("sapien"),
        "shader": config.shader,
        "shader_sha256": _shader_hash() if config.shader == "busybot" else "",
        "config": config.model_dump(mode="json"),
    }


@cache
def _shader_hash() -> str:
    folder = Path(__file__).parent / "scene" / "shaders"
    parts = [(folder / name).read_bytes() for name in ("gbuffer.vert", "gbuffer.frag")]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


@cache
def recorded_versions() -> dict[str, str]:
    """Versions of what decided the recording."""
    packages = {name: installed_version(name) for name in RECORDED_PACKAGES}
    return {"busybot": __version__, "python": platform.python_version(), **packages}
