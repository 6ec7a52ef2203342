"""The two kinds of things that change on a board: trigger joints with detents, and responders with effects.

States: a two-state link is in state 0 below half of its range, else 1; a multi-direction link is in
state 0 below a quarter, 2 above three quarters, else 1. At rest a joint sits in the detent of its state: at an end, or
in the middle.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import sapien

from busybot.common.errors import BusybotError
from busybot.objects.model import Effect, ObjectModel, TriggerLink

JOINT_DAMPING = 0.02
"""Keeps the suction drive from overshooting by more than 3 % of a joint's range."""
HELD, INERTIA = 2e-4, 1e4
"""A held joint has this share of its range to either side, and so much inertia: limits alone give way to pulls."""
GLOW, PAINT = 0.35, 0.7
"""Shares of a lamp's colour that it emits, and that it reflects."""
DARK = 0.06
"""What an unlit lamp still reflects, so that one sees its shape."""


@dataclass
class TriggerJoint:
    """A movable link of a trigger on the board.

    Attributes:
        object: index of the object on the board.
        link: what the annotation says of it.
        articulation, body: SAPIEN's articulation and the link's component.
        axis: index among the articulation's degrees of freedom.
        lower, upper: joint limits, radians or board units.
        state: the discrete state in which it rests.
    """

    object: int
    link: TriggerLink
    articulation: Any
    body: Any
    axis: int
    lower: float
    upper: float
    state: int

    def rest(self, state: int) -> float:
        """Joint position of the state's detent."""
        return self.lower + (self.upper - self.lower) * state / (self.link.states - 1)

    def position(self) -> float:
        """The joint's present position, radians or board units."""
        return float(self.articulation.qpos[self.axis])

    def state_at(self, position: float) -> int:
        """Discrete state in which a joint position lies."""
        share = (position - self.lower) / (self.upper - self.lower)
        if self.link.kind == "two-state":
            return int(share >= 0.5)
        return 0 if share < 0.25 else 2 if share > 0.75 else 1

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep the joint within a hair's breadth of its detent, whatever pulls at it."""
        joint = self.articulation.active_joints[self.axis]
        rest, breadth = self.rest(self.state), HELD * (self.upper - self.lower)
        joint.set_limits(np.array([[rest - breadth, rest + breadth]], np.float32))
        joint.set_armature(np.full(1, INERTIA, np.float32))
        try:
            yield
        finally:
            joint.set_limits(np.array([[self.lower, self.upper]], np.float32))
            joint.set_armature(np.zeros(1, np.float32))

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep the joints that carry this one in their places, or a pull would move them in its stead."""
        carriers, link = [], self.body.parent
        while link is not None:
            carriers += [link.joint] if link.joint.dof else []
            link = link.parent
        for joint in carriers:
            joint.set_armature(np.full(joint.dof, INERTIA, np.float32))
        try:
            yield
        finally:
            for joint in carriers:
                joint.set_armature(np.zeros(joint.dof, np.float32))

    def settle(self, state: int) -> None:
        """Snap into the state's detent, at rest."""
        self.state = state
        rest_at(self.articulation, (self.axis,), (self.rest(state),))


@dataclass
class Responder:
    """A lamp, door or toy on the board that shows one of its states.

    Attributes:
        object: index of the object on the board.
        values: of the effect, by state.
        state: index of the value shown.
    """

    object: int
    effect: Effect
    values: Sequence[tuple[float, ...]]
    articulation: Any
    axes: tuple[int, ...]
    materials: tuple[Any, ...]
    state: int = 0

    def show(self, state: int) -> None:
        """Show a state at once."""
        self.state = state
        if self.effect.type == "color":
            for material in self.materials:
                material.set_base_color([*(DARK + (PAINT - DARK) * channel for channel in self.values[state]), 1.0])
                material.set_emission([*(GLOW * channel for channel in self.values[state]), 1.0])
        else:
            rest_at(self.articulation, self.axes, self.values[state])


def rest_at(articulation: Any, axes: Sequence[int], positions: Sequence[float]) -> None:
    """Put some joints of an articulation to these positions, all at rest."""
    every = articulation.qpos
    every[list(axes)] = positions
    articulation.set_qpos(every)
    articulation.set_qvel(np.zeros_like(every))


def make_triggers(index: int, model: ObjectModel, states: tuple[int, ...], articulation: Any) -> list[TriggerJoint]:
    """The object's trigger joints, settled in their initial states."""
    joints = []
    names = [joint.name for joint in articulation.active_joints]
    for link, state in zip(model.trigger_links, states, strict=True):
        axis = names.index(link.joint)
        lower, upper = (float(limit) for limit in articulation.qlimits[axis])
        body = articulation.find_link_by_name(link.name)
        joint = TriggerJoint(index, link, articulation, body, axis, lower, upper, state)
        joint.settle(state)
        joints.append(joint)
    return joints


def make_responder(index: int, model: ObjectModel, stage: str | None, articulation: Any, painted: bool) -> Responder:
    """The responder in state 0; without a stage, which is for one that nothing controls, its effect's first.

    With `painted`, its coloured parts lose their texture, which would hide the paint.
    """
    effect = model.effect
    stage = stage or ("single" if effect is not None and effect.single is not None else "multi")
    values = None if effect is None else effect.multi if stage == "multi" else effect.single
    if effect is None or values is None:
        raise BusybotError(f"{model.key} cannot be a {stage}-stage responder", "generate the board again")
    materials: list[Any] = []
    if effect.type == "color" and painted:
        body = articulation.find_link_by_name(effect.link)
        render = body.entity.find_component_by_type(sapien.render.RenderBodyComponent)
        materials = [part.material for shape in render.render_shapes for part in shape.parts]
        for material in materials:
            material.set_base_color_texture(None)
    names = [joint.name for joint in articulation.active_joints]
    axes = tuple(names.index(joint) for joint in effect.joints)
    for axis in axes:
        # effects may lie beyond the annotated limits (the track toys' do)
        articulation.active_joints[axis].set_limits(np.array([[-10, 10]], np.float32))
    responder = Responder(index, effect, values, articulation, axes, tuple(materials))
    responder.show(0)
    return responder
