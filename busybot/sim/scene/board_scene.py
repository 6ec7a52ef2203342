"""A board made physical: a SAPIEN scene from a BoardSpec (paper section 3).

A `Simulator` belongs to one process and one way of looking: it caches loaded objects (`asset_cache`) and keeps one
scene alive, because SAPIEN compiles its shaders again when the last scene of a process goes. A `BoardScene` is one
board: it can be looked at, acted on (`sim.interaction`), saved and restored.

There is no gravity and there are no collision shapes: convex hulls make doors and switches drift at rest, and the
gripper is a drive that needs none. Between interactions everything rests in its detent, so the discrete trigger states
*are* the state of the board.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien

from busybot.boards.relations import responder_state
from busybot.boards.spec import BoardSpec, PlacedObject, Relation
from busybot.common.errors import BusybotError
from busybot.episodes.episode import Camera, Image, Link
from busybot.objects.library import Library
from busybot.objects.model import ObjectModel
from busybot.sim.scene.asset_cache import Builders
from busybot.sim.scene.joints import JOINT_DAMPING, Responder, TriggerJoint, make_responder, make_triggers
from busybot.sim.scene.render import RenderConfig, Surroundings, add_camera, camera_model, read_picture

TIME_STEP = 0.01
"""Seconds of simulated time per physics step."""
KNOWN_KINDS = frozenset({"one-to-one", "one-to-many-effects", "one-to-many-objects"})


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
        scene = sapien.Scene() if self.render else sapien.Scene([sapien.physx.PhysxCpuSystem()])
        scene.set_timestep(TIME_STEP)
        if self._surroundings is not None:
            self._surroundings.add(scene, spec, models)
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
    """All that distinguishes a board at rest from its initial state: the trigger links' states."""

    triggers: tuple[int, ...]


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
        self.models = [simulator.library.get(placed.key) for placed in spec.objects]
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
            for joint in make_triggers(index, model, placed.states, articulation):
                self.triggers.append(joint)
                links.append(Link(index, joint.link.name, True))
                codes[joint.body.entity.per_scene_id] = len(links)
                self._trigger_of_link[len(links)] = len(self.triggers) - 1
        self.links = tuple(links)
        self._codes = np.zeros(max(codes, default=0) + 2, np.uint16)
        self._codes[list(codes)] = list(codes.values())
        self.trigger_numbers = {(joint.object, joint.link.name): number for number, joint in enumerate(self.triggers)}
        relations = spec.relations if simulator.responders else ()
        self._relation_of = {self._driver(relation): relation for relation in relations}
        for number, joint in enumerate(self.triggers):
            self._respond(number, joint.state)
        self._camera: Any = add_camera(self.scene, self._render) if self._render else None
        self.scene.step()

    @property
    def camera(self) -> Camera:
        """The camera's pinhole model."""
        return camera_model(self.view)

    @property
    def view(self) -> RenderConfig:
        """How the board is looked at.

        Raises:
            BusybotError: it is simulated without a renderer.
        """
        if self._render is None:
            raise BusybotError("this simulation has no renderer", "make the Simulator with a RenderConfig")
        return self._render

    def observe(self) -> Image:
        """Render: RGB, depth and link segmentation with the objects' boxes."""
        config = self.view
        self.scene.update_render()
        self._camera.take_picture()
        rgb, depth, entities = read_picture(self._camera, config)
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
        """Let a trigger rest in a state; its responder follows at once."""
        self.triggers[number].settle(state)
        self._respond(number, state)
        # SAPIEN places links a millionth of a unit off until the next step, which shows at edges
        self.scene.step()

    @contextmanager
    def showing(self, number: int, state: int) -> Iterator[None]:
        """Let the trigger's responder show what it would show in a trigger state, for a look in mid-motion."""
        self._respond(number, state)
        yield
        self._respond(number, self.triggers[number].state)

    def save(self) -> BoardState:
        """The board's exact state; only between interactions."""
        return BoardState(self.trigger_states())

    def restore(self, state: BoardState) -> None:
        """Put the board back; what follows is what would have followed then."""
        if len(state.triggers) != len(self.triggers):
            raise BusybotError(f"the state has {len(state.triggers)} triggers, the board {len(self.triggers)}")
        for number, value in enumerate(state.triggers):
            self.set_trigger(number, value)

    def rest(self, state: BoardState) -> None:
        """Put the board into a state in which everything has been through a step, as in a recorded picture."""
        self.restore(state)
        self.scene.step()

    def relation_of(self, number: int) -> Relation | None:
        """The relation that a trigger joint drives. Ground truth."""
        return self._relation_of.get(number)

    def _driver(self, relation: Relation) -> int:
        """Number of the trigger joint that a relation names."""
        reference = relation.triggers[0]
        number = self.trigger_numbers.get((reference.object, reference.link))
        if number is None:
            what = f"a relation names link {reference.link!r} of object {reference.object}, which is no trigger link"
            raise BusybotError(what)
        states = self.triggers[number].link.states
        if len(relation.states) != states:
            raise BusybotError(f"a relation lists {len(relation.states)} states, its link has {states}")
        return number

    def _respond(self, number: int, state: int) -> None:
        """Let the trigger's responder show what belongs to a trigger state."""
        relation = self._relation_of.get(number)
        if relation is not None:
            self.responders[relation.responder].show(responder_state(relation, state))

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


def _stages(spec: BoardSpec) -> dict[int, str]:
    """Stage of each controlled responder; refuses relations that this simulator cannot make physical."""
    for relation in spec.relations:
        if relation.kind not in KNOWN_KINDS or len(relation.triggers) != 1:
            raise BusybotError(
                f"board {spec.index}: a relation of kind {relation.kind!r} with {len(relation.triggers)} triggers",
                f"this version simulates {', '.join(sorted(KNOWN_KINDS))} with one trigger",
            )
    return {relation.responder: relation.stage for relation in spec.relations}
