"""Policies that need no model, and the true contacts of trigger links with the directions that move them.

`random` knows only the picture (the paper's inferior policy, row "w/o exploration" of Table 2). `scripted` knows the
joints: an oracle, for bounds and tests, marked as such in every episode. True contacts are for oracles only.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.common.errors import BusybotError
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.sim.interaction import InteractionConfig, permitted, pull
from busybot.sim.policy import Action, AnyPolicyFactory, OracleObservation, Policy, StatelessPolicy, privileged
from busybot.sim.scene.board_scene import BoardScene
from busybot.sim.scene.joints import TriggerJoint

ELEVATION = 0.01
"""A pixel is elevated when it lies more than this above the board, board units."""
SMALLEST_TARGET = 3
"""Links that show fewer pixels are not scripted."""
TRIES = 6


class RandomPolicy(StatelessPolicy):
    """A random elevated pixel and a random direction."""

    name = "random"

    def __init__(self, rays: Rays):
        self._rays = rays

    def select_action(self, observation: Observation, rng: np.random.Generator) -> Action:
        depth = observation.depth
        elevated = np.flatnonzero(self._rays.heights(depth) > ELEVATION)
        chosen = int(rng.choice(elevated)) if len(elevated) else int(rng.integers(depth.size))
        row, column = divmod(chosen, depth.shape[1])
        return Action((column, row), (int(rng.integers(len(DIRECTIONS))),))


class ScriptedPolicy(StatelessPolicy):
    """A random visible trigger link, held well inside, moved towards another state.

    Candidate directions are ordered by how well they follow the joint, then tried in the simulator and undone; the
    first one that reaches the wanted state is proposed.
    """

    name = "scripted"

    def __init__(self, scene: BoardScene, rays: Rays, config: InteractionConfig):
        self._scene, self._rays, self._config = scene, rays, config

    def select_action(self, observation: Observation, rng: np.random.Generator) -> Action:
        visible = visible_links(self._scene, privileged(observation).segmentation)
        if not visible:
            return RandomPolicy(self._rays).select_action(observation, rng)
        number, mask = self.choose(visible, rng)
        joint = self._scene.triggers[number]
        others = [state for state in range(joint.link.states) if state != joint.state]
        wanted = others[int(rng.integers(len(others)))]
        fallback: Action | None = None
        for pixel in interior_pixels(mask, rng, TRIES):
            point = self._rays.point(observation.depth, pixel)
            direction, reached = direction_to(self._scene, number, point, wanted, self._config)
            if direction is not None and reached == wanted:
                return Action(pixel, (direction,))
            if direction is not None and fallback is None:
                fallback = Action(pixel, (direction,))
            last = pixel
        return fallback or Action(last, (int(rng.integers(len(DIRECTIONS))),))

    def choose(self, visible: list[tuple[int, np.ndarray]], rng: np.random.Generator) -> tuple[int, np.ndarray]:
        """Which of the visible links is acted on, with its mask."""
        return visible[int(rng.integers(len(visible)))]


def visible_links(scene: BoardScene, segmentation: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Trigger joints with enough pixels, and their masks, bool (H, W)."""
    found = []
    for code in np.flatnonzero(np.bincount(segmentation.ravel()) >= SMALLEST_TARGET):
        number = scene.trigger_at(int(code))
        if number is not None:
            found.append((number, segmentation == code))
    return found


def direction_to(
    scene: BoardScene, number: int, point: np.ndarray, wanted: int, config: InteractionConfig
) -> tuple[int | None, int]:
    """The best followed direction in which pulling at a point takes a trigger joint into the wanted state.

    Directions are tried in the simulator and undone.

    Returns:
        the direction and `wanted`; else one that leads into another state, and that; else None and the present state.
    """
    joint = scene.triggers[number]
    motion = motion_at(joint, point) * np.sign(joint.rest(wanted) - joint.rest(joint.state))
    any_other: tuple[int | None, int] = (None, joint.state)
    for direction in np.argsort(-(DIRECTIONS @ motion), kind="stable")[:9]:
        if config.strict and not permitted(scene, number, int(direction), config):
            continue
        _, reached = pull(scene, number, point, DIRECTIONS[direction], config, None)
        if reached == wanted:
            return int(direction), reached
        if reached != joint.state and any_other[0] is None:
            any_other = (int(direction), reached)
    return any_other


def motion_at(joint: TriggerJoint, point: np.ndarray) -> np.ndarray:
    """Unit direction (board frame) in which the held point moves when the joint's position grows."""
    active = joint.articulation.active_joints[joint.axis]
    pose = active.global_pose.to_transformation_matrix()
    axis, origin = pose[:3, 0], pose[:3, 3]
    motion = axis if joint.link.joint_type == "prismatic" else np.cross(axis, np.asarray(point, float) - origin)
    length = np.linalg.norm(motion)
    return motion / length if length > 1e-9 else np.zeros(3)


def interior_pixels(mask: np.ndarray, rng: np.random.Generator, count: int) -> list[tuple[int, int]]:
    """Random pixels (u, v) of the mask away from its border."""
    rows, columns = np.nonzero(mask)
    top, left = rows.min(), columns.min()
    window = np.pad(mask[top : rows.max() + 1, left : columns.max() + 1], 1).astype(np.uint8)
    distance = cv2.distanceTransform(window, cv2.DIST_L2, 3)[1:-1, 1:-1]
    inner_rows, inner_columns = np.nonzero(distance >= 0.5 * distance.max())
    chosen = rng.integers(len(inner_rows), size=count)
    return [(int(inner_columns[k] + left), int(inner_rows[k] + top)) for k in chosen]


@dataclass(frozen=True)
class RandomFactory:
    name: str = RandomPolicy.name

    def make_policy(self, rays: Rays) -> Policy:
        return RandomPolicy(rays)


@dataclass(frozen=True)
class ScriptedFactory:
    name: str = ScriptedPolicy.name

    def make_oracle(self, scene: BoardScene, rays: Rays, config: InteractionConfig) -> Policy:
        return ScriptedPolicy(scene, rays, config)


def builtin_factory(name: str) -> AnyPolicyFactory:
    """The factory of a policy that needs no model, `random` or `scripted`; refuses other names."""
    factories: dict[str, AnyPolicyFactory] = {"random": RandomFactory(), "scripted": ScriptedFactory()}
    if name not in factories:
        raise BusybotError(f"unknown policy {name!r}", "choose random, learned, curious or scripted")
    return factories[name]


@dataclass(frozen=True)
class TrueContact:
    """A pixel at which a trigger link can be moved.

    Attributes:
        number: of the trigger joint in the scene.
        pixel: (u, v), well inside of the link.
        position: float32 (3,), board frame.
        directions: state to a direction that leads there from the present state.
    """

    number: int
    pixel: tuple[int, int]
    position: np.ndarray
    directions: dict[int, int]


def true_contacts(
    scene: BoardScene, seen: OracleObservation, rays: Rays, config: InteractionConfig, rng: np.random.Generator
) -> list[TrueContact]:
    """One contact for every visible link that can be moved, from which most neighbouring states can be reached.

    Args:
        seen: what the scene shows now.
    """
    found = []
    for number, mask in visible_links(scene, seen.segmentation):
        state, states = scene.triggers[number].state, scene.triggers[number].link.states
        wanted = [other for other in (state - 1, state + 1) if 0 <= other < states]
        best: TrueContact | None = None
        for pixel in interior_pixels(mask, rng, TRIES):
            point = rays.point(seen.depth, pixel)
            directions = {}
            for other in wanted:
                direction, reached = direction_to(scene, number, point, other, config)
                if direction is not None:
                    directions[reached] = direction
            if directions and (best is None or len(directions) > len(best.directions)):
                best = TrueContact(number, pixel, point, directions)
            if len(directions) == len(wanted):
                break
        if best is not None:
            found.append(best)
    return found
