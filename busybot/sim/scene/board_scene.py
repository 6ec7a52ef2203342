"""A board made physical: a SAPIEN scene from a BoardSpec (paper section 3).

A `Simulator` belongs to one process and one way of looking: it caches loaded objects (`asset_cache`) and keeps one
scene alive, because SAPIEN compiles its shaders again when the last scene of a process goes. A `BoardScene` is one
board: it can be looked at, acted on (`sim.interaction`), saved and restored.

There is no gravity and there are no collision shapes: convex hulls make doors and switches drift at rest, and the
gripper is a drive that needs none. Between interactions everything rests in its detent, so the discrete trigger states
and what the mechanisms remember (`boards.dynamics`) *are* the state of the board.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien

from busybot.boards.dynamics import Dynamics, DynamicState
from busybot.boards.spec import BoardSpec, PlacedObject
from busybot.boards.worlds import links_of
from busybot.common.errors import BusybotError
from busybot.episodes.episode import Camera, Image, Link
from busybot.objects.library import Library
from busybot.objects.model import ObjectModel
from busybot.sim.scene.appearance import lights_of
from busybot.sim.scene.asset_cache import Builders
from busybot.sim.scene.joints import JOINT_DAMPING, Responder, TriggerJoint, make_responder, make_triggers
from busybot.sim.scene.render import RenderConfig, Surroundings, add_camera, camera_model, new_renderer, read_picture

TIME_STEP = 0.01
"""Seconds of simulated time per physics step."""


class Simulator:
    """Builds boards in this process.

    Args:
        library: where the objects come from.
        render: how boards are looked at; None for a simulation without pictures, which needs no renderer.
        responders: whether responders follow their triggers.
    """

    def __init__(self, library: Library, render: RenderConfig | None, responders: bool = True):
        self.library, self.render, self.responders = library, render, responders
        self._builders = Builders(looks=render is not None)
        sapien.physx.set_scene_config(gravity=np.zeros(3, np.float32))
        sapien.set_log_level("critical")
        self._surroundings = None if render is None else Surroundings(lights=render.shader != "busybot")
        self._keep_alive: Any = None

    def board(self, spec: BoardSpec) -> "BoardScene":
        """Build the board.

        Raises:
            BusybotError: an object is missing or cannot be loaded, or a relation is of an unknown kind.
        """
        self._builders.forget()
        board = BoardScene(self, spec)
        self._keep_alive = board.scene
        return board

    def new_scene(self, spec: BoardSpec, models: list[ObjectModel]) -> sapien.Scene:
        """A scene with what the objects stand on, if anybody looks."""
        scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), *([new_renderer()] if self.render else [])])
        scene.set_timestep(TIME_STEP)
        if self._surroundings is not None and self.render is not None:
            self._surroundings.add(scene, spec, models, self.render.randomise)
        return scene

    def build_object(self, scene: sapien.Scene, model: ObjectModel, placed: PlacedObject) -> Any:
        """An articulation of the object, at its place, its joints damped and free of friction."""
        builder = self._builders.get(model, placed.scale)
        builder.set_scene(scene)
        turn = sapien.Pose(q=[np.cos(placed.yaw / 2), 0, 0, np.sin(placed.yaw / 2)])
        builder.set_initial_pose(sapien.Pose(placed.position) * turn * sapien.Pose(q=model.orientation))
        articulation = builder.build()
        for joint in articulation.active_joints:
            joint.set_drive_properties(0, JOINT_DAMPING)
            joint.set_friction(0)
            joint.set_armature(np.zeros(1, np.float32))
        return articulation


@dataclass(frozen=True)
class BoardState:
    """All that distinguishes a board at rest from its initial state.

    Attributes:
        triggers: the trigger links' states.
        dynamics: what shows and what the mechanisms remember; None for what a new board shows with these triggers,
            which is all where nothing is remembered.
    """

    triggers: tuple[int, ...]
    dynamics: DynamicState | None = None


class BoardScene:
    """One physical board.

    Attributes:
        triggers: movable trigger links, in board order.
        trigger_numbers: place among them, by object index and name of the link.
        responders: by object index.
        links: what segmentation names: per object its body, then its trigger links.
    """

    def __init__(self, simulator: Simulator, spec: BoardSpec):
        self.spec = spec
        self._render = simulator.render
        self._seen = simulator.render and simulator.render.of_board(spec)
        self.models = [simulator.library.get(placed.key) for placed in spec.objects]
        self.dynamics = Dynamics(spec, links_of(self.models))
        self.scene = simulator.new_scene(spec, self.models)
        stages = _stages(spec)
        self.triggers: list[TriggerJoint] = []
        self.responders: dict[int, Responder] = {}
        links: list[Link] = []
        codes: dict[int, int] = {}
        self._trigger_of_link: dict[int, int] = {}
        for index, (placed, model) in enumerate(zip(spec.objects, self.models, strict=True)):
            articulation = simulator.build_object(self.scene, model, placed)
            links.append(Link(index, "body", False))
            codes |= {link.entity.per_scene_id: len(links) for link in articulation.links}
            if placed.role == "responder":
                painted = simulator.render is not None
                self.responders[index] = make_responder(index, model, stages.get(index), articulation, painted)
            own: dict[int, int] = {}
            for joint in make_triggers(index, model, placed.states, articulation):
                self.triggers.append(joint)
                links.append(Link(index, joint.link.name, True))
                own[joint.body.entity.per_scene_id] = len(links)
                self._trigger_of_link[len(links)] = len(self.triggers) - 1
            codes |= _with_what_they_carry(articulation, own)
        self.links = tuple(links)
        self._codes = np.zeros(max(codes, default=0) + 2, np.uint16)
        self._codes[list(codes)] = list(codes.values())
        self.trigger_numbers = {(joint.object, joint.link.name): number for number, joint in enumerate(self.triggers)}
        self._driven = [self._responders_of(number) for number in range(len(self.triggers))]
        self._state = self.dynamics.start(self.trigger_states())
        self._effects = simulator.responders
        self._show(self._state, everything=True)
        self._camera: Any = self._seen and add_camera(
            self.scene, self._seen, lights_of(self._seen.randomise.lights, spec)
        )
        self.scene.step()

    @property
    def camera(self) -> Camera:
        """The camera's pinhole model."""
        assert self.view and self._seen
        return camera_model(self._seen)

    @property
    def view(self) -> RenderConfig:
        """How boards are looked at; this one has a camera of its own if cameras are drawn.

        Raises:
            BusybotError: it is simulated without a renderer.
        """
        if self._render is None:
            raise BusybotError("this simulation has no renderer", "make the Simulator with a RenderConfig")
        return self._render

    def observe(self) -> Image:
        """Render: RGB, depth and link segmentation with the objects' boxes."""
        config = self.view  # of all boards; a board's own camera may see farther
        self.scene.update_render()
        self._camera.take_picture()
        rgb, depth, entities = read_picture(self._camera, self._seen or config)
        segmentation = np.take(self._codes, entities, mode="clip")
        return Image(rgb, depth, segmentation, self._boxes(segmentation))

    def trigger_at(self, code: int) -> int | None:
        """Number of the trigger joint whose link has this segmentation code, None for anything else."""
        return self._trigger_of_link.get(code)

    def trigger_states(self) -> tuple[int, ...]:
        return tuple(joint.state for joint in self.triggers)

    def responder_states(self) -> tuple[int, ...]:
        """State of every object's responder, -1 for triggers."""
        shown = self.responders
        return tuple(shown[index].state if index in shown else -1 for index in range(len(self.models)))

    def joint_positions(self) -> tuple[float, ...]:
        """Positions of the trigger joints, radians or board units."""
        return tuple(joint.position() for joint in self.triggers)

    def set_trigger(self, number: int, state: int) -> None:
        """Let a trigger rest in a state; what follows it without a memory follows at once, the rest with `tick`."""
        self.triggers[number].settle(state)
        if not self.dynamics.remembers:
            now = self.dynamics.start(self.trigger_states())
            self._state = DynamicState(self._state.tick, now.shown, now.memories)
            self._show(self._state, also=self._driven[number])
        # SAPIEN places links a millionth of a unit off until the next step, which shows at edges
        self.scene.step()

    def tick(self) -> None:
        """End an action: every mechanism sees what it left, and what has changed is shown."""
        self._state = self.dynamics.step(self.trigger_states(), self._state)
        if self.dynamics.remembers:
            self._show(self._state)
            # after two steps every pose is one that a step computed, so that it can be put back in every bit
            self.scene.step()
            self.scene.step()

    def locked(self, number: int) -> bool:
        """Whether something holds a trigger's joint."""
        return self._effects and self.dynamics.locked(number, self._state.shown)

    @contextmanager
    def showing(self, number: int, state: int) -> Iterator[None]:
        """Let responders show what they would show if an action left the trigger in a state; for a look in
        mid-motion. What changes late or by itself changes when an action ends, so nothing does before the trigger."""
        states = self.trigger_states()
        reached = (*states[:number], state, *states[number + 1 :])
        shown = self._state if reached == states else self.dynamics.step(reached, self._state)
        self._show(shown, also=self._driven[number])
        yield
        self._show(self._state, also=self._driven[number])

    def save(self) -> BoardState:
        """The board's exact state; only between interactions."""
        return BoardState(self.trigger_states(), self._state if self.dynamics.remembers else None)

    @property
    def memory(self) -> tuple[int, ...]:
        """What the mechanisms remember, one after the other; empty in the paper's world."""
        return self._state.flat

    def restore(self, state: BoardState) -> None:
        """Put the board back; what follows is what would have followed then."""
        if len(state.triggers) != len(self.triggers):
            raise BusybotError(f"the state has {len(state.triggers)} triggers, the board {len(self.triggers)}")
        for number, value in enumerate(state.triggers):
            self.set_trigger(number, value)
        if self.dynamics.remembers or state.dynamics is not None:
            self._state = state.dynamics or self.dynamics.start(state.triggers)
            self._show(self._state)
            self.scene.step()

    def rest(self, state: BoardState) -> None:
        """Put the board into a state in which everything has been through a step, as in a recorded picture."""
        self.restore(state)
        self.scene.step()

    def _responders_of(self, number: int) -> tuple[int, ...]:
        """Objects of the relations that a trigger joint has a part in."""
        joint = self.triggers[number]
        named = (joint.object, joint.link.name)
        return tuple(
            relation.responder
            for relation in self.spec.relations
            if any((ref.object, ref.link) == named for ref in relation.triggers)
        )

    def _show(self, state: DynamicState, also: Sequence[int] = (), everything: bool = False) -> bool:
        """Let the responders show a state: those that do not yet, and those in `also`; returns whether one did not."""
        changed = False
        for index, responder in self.responders.items() if self._effects else ():
            shown = state.shown[index]
            differs = responder.state != shown
            if differs or everything or index in also:
                responder.show(shown)
            changed |= differs
        return changed

    def _boxes(self, segmentation: np.ndarray) -> np.ndarray:
        """Bounding box of each object's visible pixels, int16 (N, 4), -1 where nothing shows."""
        # one bit per object: two reductions find all boxes at once
        bits = np.array([0, *(1 << link.object for link in self.links)], np.uint64)
        present = np.take(bits.astype(np.min_scalar_type(bits.max())), segmentation)
        in_column, in_row = np.bitwise_or.reduce(present, axis=0), np.bitwise_or.reduce(present, axis=1)
        boxes = np.full((len(self.models), 4), -1, np.int16)
        for index in range(len(self.models)):
            columns, rows = np.flatnonzero(in_column >> index & 1), np.flatnonzero(in_row >> index & 1)
            if len(columns):
                boxes[index] = columns[0], rows[0], columns[-1] + 1, rows[-1] + 1
        return boxes


def _with_what_they_carry(articulation: Any, codes: dict[int, int]) -> dict[int, int]:
    """Codes of links by entity, and the same of links that move with them and have none of their own, as a knob that is
    fixed to a lever: who holds it holds that."""
    found = {}
    for link in articulation.links:
        above = link
        while above is not None and above.entity.per_scene_id not in codes:
            above = above.parent
        if above is not None:
            found[link.entity.per_scene_id] = codes[above.entity.per_scene_id]
    return found


def _stages(spec: BoardSpec) -> dict[int, str]:
    """Stage of each controlled responder."""
    return {relation.responder: relation.stage for relation in spec.relations}
