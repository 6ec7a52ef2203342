"""One action on a board: suction at a point, a direction and its opposite, until something changes.

Paper section 4.1. The rules, in order:

1. The gripper takes hold of whatever is visible at the chosen pixel. Only trigger links give way: anything else is a
   miss, which changes nothing and is not simulated.
2. The proposed direction is executed, then its opposite; if several are proposed, pair after pair until one works.
   Each starts from rest and moves the gripper's target in growing distances of 0.03 up to 0.21 units.
3. After each increment the motion stops if something changed: by default when the joint has crossed into another state
   (`stop="physics"`, no rendering), or when the images differ by more than delta pixels (`stop="pixels"`, as the
   original does it; `tests/sim/test_interaction.py` measures how often the two agree).
4. In strict mode a direction far from the annotated ones is vetoed: it counts as executed, but nothing moves.
5. A joint that something holds (`boards.spec.Lock`) does not give way: the simulator narrows its limits.
6. The gripper lets go and the joint snaps into the detent of the state that it has reached; a joint that did not leave
   its state snaps back, and the opposite direction is tried anchored at the same point.
7. Then the board's mechanisms see what the action left (`BoardScene.tick`), also where it moved nothing: responders may
   change late, or by themselves. The camera looks again whenever anything that can be seen has changed, whatever did
   it.

The gripper is a drive between the world and the held point, with a force limit: no body, no contacts.
"""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import sapien
from pydantic import Field

from busybot.boards.directions import DIRECTIONS, OPPOSITE, annotated_directions
from busybot.common.frozen_model import FrozenModel
from busybot.episodes.episode import Image, Step
from busybot.sim.scene.board_scene import BoardScene
from busybot.sim.scene.joints import TriggerJoint, rest_at
from busybot.sim.scene.real_camera import Photo, changed_area, take_photo


class InteractionConfig(FrozenModel):
    """Constants of an action.

    Attributes:
        reward: `pixels`, or `joints` for the oracle rows of Table 1: whether a trigger changed its state.
        delta: more changed pixels than this are a reward.
        tolerance: a pixel differs when a channel differs by more than this share of its range; photos of the real
            camera have their own (`real_camera.CameraConfig`).
        stop: what ends a motion.
        strict: refuse directions more than `strict_angle_deg` off every annotated direction of the object.
        increment, increments: the gripper's target moves so far (board units) so many times.
        physics_steps: simulation steps of 0.01 s per increment.
        stiffness, damping, force_limit: of the suction drive (force mode).
    """

    reward: Literal["pixels", "joints"] = "pixels"
    delta: Annotated[int, Field(ge=0)] = 500
    tolerance: Annotated[float, Field(ge=0, le=1)] = 0.01
    stop: Literal["physics", "pixels"] = "physics"
    strict: bool = False
    strict_angle_deg: Annotated[float, Field(gt=0, le=180)] = 30.0
    increment: Annotated[float, Field(gt=0, le=1)] = 0.03
    increments: Annotated[int, Field(ge=1, le=100)] = 7
    physics_steps: Annotated[int, Field(ge=1, le=100)] = 5
    stiffness: Annotated[float, Field(gt=0, le=1e4)] = 200.0
    damping: Annotated[float, Field(ge=0, le=1e4)] = 4.0
    force_limit: Annotated[float, Field(gt=0, le=1e4)] = 3.0


@dataclass(frozen=True)
class Grasp:
    """What the gripper holds: a trigger joint (None for a miss) at a point, in the board frame."""

    trigger: int | None
    position: np.ndarray
    pixel: tuple[int, int]


def changed_pixels(before: np.ndarray, after: np.ndarray, tolerance: float) -> int:
    """Number of pixels of two uint8 (H, W, 3) images that differ in a channel by more than tolerance * 255."""
    largest = int(tolerance * 255)
    same = cv2.inRange(cv2.absdiff(before, after), (0, 0, 0), (largest, largest, largest))
    return int(same.size - cv2.countNonZero(same))


def look(scene: BoardScene, seed: int, frame: int) -> Image:
    """What the board's camera, clean or real, shows of the board in a frame.

    Args:
        seed: of the collection.
    """
    config = scene.view.camera
    if config.clean:
        return scene.observe()
    return take_photo(scene.observe(), config, (seed, scene.spec.split, scene.spec.index), frame)


def look_again(scene: BoardScene, before: Image | None, changed: bool) -> Image | None:
    """What is seen after an action: a clean camera looks if anything changed, a real one always.

    Args:
        before: what was seen; None if nobody looks.
    """
    if isinstance(before, Photo):
        # an action that failed leaves its joint a millionth of a unit off: at rest the board is as it is put back
        scene.rest(scene.save())
        return before.next(scene.observe())
    return scene.observe() if changed and before is not None else None


def interact(
    scene: BoardScene, grasp: Grasp, directions: int | Sequence[int], config: InteractionConfig, before: Image | None
) -> tuple[Step, Image | None]:
    """Execute one proposed action.

    Args:
        directions: index into DIRECTIONS, or several in the order in which their pairs are tried until one works (the
            paper's first 100 epochs try all; evaluation proposes one).
        before: what the camera showed; None in a simulation without renderer, where the reward is the true one.

    Returns:
        the step, and the image after it if anything changed, under the real camera always (None otherwise, or without
        renderer).
    """
    states, shown, joints = scene.trigger_states(), scene.responder_states(), scene.joint_positions()
    proposed = (directions,) if isinstance(directions, int | np.integer) else tuple(directions)
    executed, distance, vetoed = _execute(scene, grasp, proposed, config, before)
    scene.tick()
    success = scene.trigger_states() != states
    looks_other = success or scene.responder_states() != shown
    after = look_again(scene, before, looks_other)
    changed = _changed(before, after, config) if before is not None and after is not None else 0
    held = scene.triggers[grasp.trigger] if grasp.trigger is not None else None
    step = Step(
        pixel=grasp.pixel,
        position=(float(grasp.position[0]), float(grasp.position[1]), float(grasp.position[2])),
        direction=int(proposed[0]),
        executed=executed,
        distance=distance,
        changed_pixels=changed,
        reward=int(changed > config.delta) if before is not None and config.reward == "pixels" else int(success),
        acted_object=held.object if held else -1,
        acted_link=held.link.name if held else "",
        trigger_states_before=states,
        trigger_states_after=scene.trigger_states(),
        responder_states_before=shown,
        responder_states_after=scene.responder_states(),
        joint_positions_before=joints,
        joint_positions_after=scene.joint_positions(),
        success=success,
        vetoed=vetoed,
        memory_after=scene.memory,
    )
    return step, after


def _execute(
    scene: BoardScene, grasp: Grasp, proposed: tuple[int, ...], config: InteractionConfig, before: Image | None
) -> tuple[tuple[int, ...], float, bool]:
    """The directions tried, the distance reached in the last one, and whether strict mode vetoed all of them."""
    order = tuple(dict.fromkeys(int(d) for first in proposed for d in (first, OPPOSITE[first])))
    full = round(config.increment * config.increments, 6)
    if grasp.trigger is None:
        return order, full, False
    number = grasp.trigger
    allowed = [d for d in order if not config.strict or permitted(scene, number, d, config)]
    executed: list[int] = []
    distance = full
    for candidate in order:
        executed.append(candidate)
        if candidate not in allowed:
            distance = full  # a veto feels like a pull that moves nothing
            continue
        distance, state = pull(scene, number, grasp.position, DIRECTIONS[candidate], config, before)
        if state != scene.triggers[number].state:
            scene.set_trigger(number, state)
            break
    return tuple(executed), distance, not allowed


def permitted(scene: BoardScene, number: int, direction: int, config: InteractionConfig) -> bool:
    """Strict mode's veto: whether a direction is near enough to one that the object's annotation calls effective."""
    index = scene.triggers[number].object
    annotated = annotated_directions(scene.models[index].directions, scene.spec.objects[index].yaw)
    if not len(annotated):
        return False
    return bool((annotated @ DIRECTIONS[direction]).max() > np.cos(np.deg2rad(config.strict_angle_deg)))


def pull(
    scene: BoardScene,
    number: int,
    point: np.ndarray,
    direction: np.ndarray,
    config: InteractionConfig,
    before: Image | None,
) -> tuple[float, int]:
    """Move in growing distances; afterwards all joints of the object rest where they were, also those taken along.

    Returns:
        distance and the state reached.
    """
    joint = scene.triggers[number]
    at_rest = joint.articulation.qpos
    at_rest[joint.axis] = joint.rest(joint.state)
    drive = _attach(scene, joint, point, config)
    reached, distance = joint.state, 0.0
    with joint.alone(), joint.held() if scene.locked(number) else nullcontext():
        for count in range(1, config.increments + 1):
            distance = config.increment * count
            drive.set_drive_target(sapien.Pose((direction * distance).astype(np.float32)))
            joint.body.wake_up()
            for _ in range(config.physics_steps):
                scene.scene.step()
            reached = joint.state_at(joint.position())
            if _stopped(scene, number, reached, config, before):
                break
    joint.body.entity.remove_component(drive)
    rest_at(joint.articulation, range(len(at_rest)), at_rest)
    return round(distance, 6), reached


def _stopped(scene: BoardScene, number: int, reached: int, config: InteractionConfig, before: Image | None) -> bool:
    if config.stop == "physics" or before is None:
        return reached != scene.triggers[number].state
    with scene.showing(number, reached):
        now = scene.observe()
    return _changed(before, before.next(now) if isinstance(before, Photo) else now, config) > config.delta


def _changed(before: Image, after: Image, config: InteractionConfig) -> int:
    """Number of pixels that changed, as the camera that took both pictures can tell."""
    if isinstance(after, Photo):
        return changed_area(before.rgb, after.rgb, after.config.tolerance)
    return changed_pixels(before.rgb, after.rgb, config.tolerance)


def _attach(scene: BoardScene, joint: TriggerJoint, point: np.ndarray, config: InteractionConfig) -> Any:
    """A drive from the world to the held point of the link, aligned with the board's axes."""
    into_link = joint.body.entity.pose.inv()
    world = sapien.Pose(point.astype(np.float32))
    drive = scene.scene.create_drive(None, world, joint.body, sapien.Pose((into_link * world).p, into_link.q))
    for set_axis in (drive.set_drive_property_x, drive.set_drive_property_y, drive.set_drive_property_z):
        set_axis(config.stiffness, config.damping, config.force_limit, "force")
    return drive
