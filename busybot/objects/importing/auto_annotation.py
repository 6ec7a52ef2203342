"""Rules that annotate a raw PartNet-Mobility object: what a reviewer would decide, from names, joints and meshes.

Which links move, how far and which way is measured on the vertices at both ends of each joint.

A joint *moves* when it is not fixed, its link shows something and it has a range (a turning joint without end has a
quarter turn, `loader.UNLIMITED_RANGE`; a sliding one without end does not count). Sizes are those at rest: joints at
0, or at the limit nearest to 0. `benchmarks/studies/import_rules.py` compares the rules with the annotation of the
58 objects.

| decision | rule |
|---|---|
| category | PartNet's Switch, Lamp, Door, Toy stay. Others: a Switch if a moving link is a control, else a Door |
| control | a link with a word of `CONTROLS` and none of `LEAVES` in its name; without any such word, a link whose
  largest face is less than 0.6 of the object's. What rides on a moving link that is no control (a handle) is none |
| role | a Switch is a trigger, the rest are responders |
| upright pose | a Lamp or Toy stands on the board; a Switch or Door turns its front to the camera; an object of
  another category its front, or its top if the links that it uses are nearer to that by 0.25 half heights; where
  neither is plain, the reviewer is asked |
| scale | by the upright footprint: side of the square of equal area 0.29 (Switch), 0.42 (Lamp), 0.57 (Toy) board
  units, longer side 0.71 (Door); at most 1.8 high |
| movable links | of a Switch all that move, of another category its controls; the 4 largest if there are more |
| kind | multi-direction if the only link travels along the board, by at least 0.15 of the footprint's diagonal,
  and the object is a box: higher than its footprint is wide. Else two-state. What then has to go farther than an
  action takes it (`partnet.reach`) is asked about |
| directions | a link that travels along the board: both ways along its travel; a knob (hinge along the line of
  sight): plus and minus x and y; else pressing: plus and minus z, and the diagonals of z with the way in which the
  link tilts (with x for a button) |
| lamp | paints the link with a word of `LIGHTS` in its name or parts, else any: the deepest in the tree of joints,
  the larger of two. Colours are drawn from six, by the id |
| door | the link with the largest face goes from the end where the object is flatter to the other; a second leaf of
  at least half its size makes it a multi-stage responder too |
| toy | the last joint that moves: rest (the middle, if that is near an end), lower limit, upper limit; at most three
  quarters of a turn apart, else they look alike |
| height | the lowest point at rest stands on the board |

Refused: nothing moves (Switch, Door, Toy), nothing to paint (a Lamp with a single link), a joint of another type than
`urdf.JOINT_TYPES`, and whatever `objects.partnet.loader` refuses.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NoReturn, cast

import numpy as np

from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.objects.importing.annotation_edits import Category, Choices, EffectChoice, Kind
from busybot.objects.importing.raw import IDENTITY, RawObject
from busybot.objects.model import CATEGORIES
from busybot.objects.partnet.loader import limits
from busybot.objects.partnet.reach import out_of_reach
from busybot.objects.partnet.urdf import Joint, bounds, flatter_first, link_vertices, rotation

FLAT = 0.02
"""A hinge whose link leaves the plane by less than this share of its travel turns about the line of sight; a leaf that
comes nearer or goes away by less opens sideways."""


@dataclass(frozen=True, eq=False)
class Moving:
    """A link that moves.

    Attributes:
        low, high: its vertices at the joint's lower and upper limit, (n, 3), URDF frame; the other joints rest.
        face: area of the largest face of its box.
    """

    joint: Joint
    low: np.ndarray
    high: np.ndarray
    face: float

    @property
    def link(self) -> str:
        return self.joint.child

    @property
    def slides(self) -> bool:
        return self.joint.type == "prismatic"


def rest(joint: Joint) -> float:
    """The position at rest: 0, or the limit nearest to it."""
    return float(np.clip(0.0, *limits(joint)))


def shown(raw: RawObject, positions: Mapping[str, float] = MappingProxyType({})) -> dict[str, np.ndarray]:
    """Vertices of every link that shows something, URDF frame; joints that are not named rest."""
    resting = {joint.name: rest(joint) for joint in raw.urdf.joints if joint.type != "fixed"}
    return link_vertices(raw.urdf, raw.meshes, IDENTITY, resting | dict(positions))


def moving_links(raw: RawObject) -> list[Moving]:
    """The links that move, in the joints' order."""
    found = []
    for joint in raw.urdf.joints:
        lower, upper = limits(joint)
        if joint.type == "fixed" or (joint.type == "prismatic" and joint.lower is None) or upper - lower < 1e-6:
            continue
        low, high = (shown(raw, {joint.name: end}).get(joint.child) for end in (lower, upper))
        if low is not None and high is not None:
            found.append(Moving(joint, low, high, face(np.ptp(low, axis=0))))
    return found


def face(size: np.ndarray) -> float:
    """Area of the largest face of a box."""
    return float(np.prod(np.sort(size)[1:]))


def travel(motion: np.ndarray) -> float:
    """How far a link travels along the board; 0 when it moves more toward the camera or away.

    Args:
        motion: what each vertex does from one end to the other, (n, 3), upright frame.
    """
    along = float(np.linalg.norm(motion[:, :2], axis=1).max())
    return along if along > np.abs(motion[:, 2]).max() else 0.0


def ways(moving: Moving, motion: np.ndarray) -> list[tuple[float, float, float]]:
    """Directions that move the link, upright frame, each with its opposite; the rule is in `auto_annotation`."""
    x, y = _axis(motion)
    along = travel(motion)
    if not along:
        return _both([(0.0, 0.0, 1.0), (x, y, 1.0), (x, y, -1.0)])
    if not moving.slides and np.abs(motion[:, 2]).max() < FLAT * along:
        return _both([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
    return _both([(x, y, 0.0)])


def _both(directions: list[tuple[float, float, float]]) -> list[tuple[float, float, float]]:
    return [way for x, y, z in directions for way in ((x, y, z), (0.0 - x, 0.0 - y, 0.0 - z))]


def _axis(motion: np.ndarray) -> tuple[float, float]:
    """Which way along the board the link travels or tilts: one of x, y and their diagonals; x when it does neither."""
    plane = motion[np.linalg.norm(motion[:, :2], axis=1).argmax(), :2]
    largest = plane[np.abs(plane).argmax()]
    if abs(largest) < 1e-6:
        return 1.0, 0.0
    x, y = np.round(plane / largest)
    return float(x) + 0.0, float(y) + 0.0


RULES_VERSION = "1.1"
"""Changes when the same raw object gets another annotation."""
CONTROLS = frozenset({"button", "knob", "switch", "lever", "slider", "toggle", "key", "dial"})
LEAVES = frozenset({"door", "drawer", "lid", "window", "cover", "screen", "flap", "hatch", "gate", "leaf"})
LIGHTS = frozenset({"light", "bulb", "shade", "lampshade", "head"})
CONTROL_FACE = 0.6
MAX_LINKS = 4
BOX_TRAVEL = 0.15
SECOND_LEAF = 0.5
NEAR_END, MOST_TURN = 0.1, 1.5 * np.pi
"""A toy's rest is an end if it is nearer to one than this share of its way; what turns by more radians than this comes
round again."""
SIDES: dict[str, float] = {"Switch": 0.29, "Lamp": 0.42, "Toy": 0.57, "Door": 0.71}
MAX_HEIGHT = 1.8
Quaternion = tuple[float, float, float, float]
TOP_LEAD = 0.25
STANDING: Quaternion = (0.0, 0.0, 0.0, 1.0)
FACING: Quaternion = (0.0, 0.7071068, 0.0, 0.7071068)
POSES: dict[str, Quaternion] = {
    "top": STANDING,
    "-x": FACING,
    "+x": (0.7071068, 0.0, 0.7071068, 0.0),
    "-y": (-0.5, 0.5, -0.5, 0.5),
    "+y": (0.5, 0.5, 0.5, 0.5),
}
"""Orientation by the side of the URDF that faces the camera."""
PLATE, AHEAD, ON_TOP = 0.6, 0.15, 0.5
"""A front is plain if the object is less deep than this share of its face, or if the links that it uses are nearer to
the front than to the top by so many half sizes; a top if they are so many half heights above its middle."""
OFF = (0.0, 0.0, 0.0)
PALETTE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 0.0), (1.0, 0.0, 1.0), (0.0, 1.0, 1.0))


@dataclass(frozen=True)
class AutoAnnotation:
    """A complete annotation.

    Attributes:
        choices: every field that the object's role needs is set.
        low, high: box at rest in the upright frame before scaling.
        notes: why, for the reviewer.
        questions: what the rules doubt, with the answers to choose from.
    """

    choices: Choices
    low: tuple[float, ...]
    high: tuple[float, ...]
    notes: tuple[str, ...]
    questions: tuple[str, ...] = ()


def decide(raw: RawObject, given: Choices | None = None) -> AutoAnnotation:
    """Annotate; what `given` holds is taken from there, the rest by the rules.

    Raises:
        BusybotError: the object cannot be used, with the reason.
    """
    return _Rules(raw, given or Choices()).decide()


class _Rules:
    """One object on its way to a decision."""

    def __init__(self, raw: RawObject, given: Choices):
        self.raw, self.given, self.notes, self.questions = raw, given, [*raw.notes], list[str]()
        self.low, self.high = bounds(shown(raw))
        self.moving = moving_links(raw)

    def decide(self) -> AutoAnnotation:
        category = self.category()
        self.check_given(category)
        used = self.used(category)
        self.tell_left_out(category, used)
        orientation = self.orientation(category, used)
        turn = _turn(orientation)
        low, high = bounds({link: points @ turn.T for link, points in shown(self.raw).items()})
        scale = self.given.scale or _scale(category, high - low)
        links, directions, effect = None, None, None
        if category == "Switch":
            motions = [(moving.high - moving.low) @ turn.T for moving in used]
            links = self.given.links or _kinds(used, motions, high - low)
            found = [way for moving, motion in zip(used, motions, strict=True) for way in ways(moving, motion)]
            directions = self.given.directions or tuple(dict.fromkeys(found))
            self.ask_what_is_out_of_reach(used, links, scale)
        else:
            effect = self.given.effect or self.effect(category, used, orientation, scale)
        choices = Choices(
            category=category, scale=scale, orientation=orientation, links=links, directions=directions, effect=effect
        )
        told = tuple(self.notes), tuple(self.questions)
        return AutoAnnotation(choices, tuple(low.tolist()), tuple(high.tolist()), *told)

    def category(self) -> Category:
        told = self.given.category or self.raw.category
        source = "the overrides" if self.given.category else self.raw.source
        if told in CATEGORIES:
            category = cast(Category, told)
            self.notes.append(f"{told} ({source})")
        else:
            controls = [moving.link for moving in self.moving if self.is_control(moving)]
            category = "Switch" if controls else "Door"
            why = f"{', '.join(controls)} can be operated" if controls else "it has doors, drawers or lids alone"
            self.notes.append(f"{told or 'unknown category'} ({source}) serves as {category}: {why}")
        if category != "Lamp" and not self.moving:
            joints = ", ".join(f"{joint.name} ({joint.type})" for joint in self.raw.urdf.joints) or "none"
            self.refuse(f"no joint moves anything that shows (joints: {joints}), so it can be no {category}")
        return category

    def check_given(self, category: Category) -> None:
        """Refuse decisions about the other role, which would be left aside."""
        others = ("effect",) if category == "Switch" else ("links", "directions")
        if given := [name for name in others if getattr(self.given, name) is not None]:
            what = f"the rules make it a {category}, which has no {' or '.join(given)}"
            raise BusybotError(f"{self.raw.folder}: {what}", "say its category, too, in the overrides")

    def is_control(self, moving: Moving) -> bool:
        carrier = next((other for other in self.moving if other.link == moving.joint.parent), None)
        if carrier is not None and not self.is_control(carrier):
            return False
        words = _words(self.raw.names.get(moving.link, ""))
        if words & (CONTROLS | LEAVES):
            return bool(words & CONTROLS) and not words & LEAVES
        return moving.face < CONTROL_FACE * face(self.high - self.low)

    def used(self, category: Category) -> list[Moving]:
        """The moving links that the role needs: a trigger's controls, a responder's leaves."""
        used = self.moving
        if category == "Switch" and self.given.links:
            return [moving for moving in used if moving.link in self.given.links]
        if category == "Switch" and self.raw.category != "Switch":
            used = [moving for moving in used if self.is_control(moving)] or used
        largest = sorted(used, key=lambda moving: -moving.face)
        if category == "Switch" and len(used) > MAX_LINKS:
            used = [moving for moving in used if moving in largest[:MAX_LINKS]]
            self.notes.append(f"only the {MAX_LINKS} largest of its links are movable")
        if category == "Door":
            used = [moving for moving in largest[:2] if moving.face >= SECOND_LEAF * largest[0].face]
        return used[-1:] if category == "Toy" else used

    def tell_left_out(self, category: Category, used: list[Moving]) -> None:
        """Name the links with a joint that the annotation does not use."""
        kept = {moving.link for moving in used}
        left = [joint.child for joint in self.raw.urdf.joints if joint.type != "fixed" and joint.child not in kept]
        if left and category != "Lamp":
            named = (f"{link} ({name})" if (name := self.raw.names.get(link)) else link for link in left)
            self.notes.append(f"left out, so that nobody moves them: {', '.join(named)}")

    def orientation(self, category: Category, used: list[Moving]) -> Quaternion:
        if self.given.orientation:
            return self.given.orientation
        if category in ("Lamp", "Toy"):
            return STANDING
        size = np.maximum(self.high - self.low, 1e-6)
        centres = [(moving.low.min(axis=0) + moving.low.max(axis=0)) / 2 for moving in used]
        offset = (np.mean(centres, axis=0) - (self.low + self.high) / 2) / (size / 2)
        known, lead = self.raw.category in ("Switch", "Door"), offset[2] + offset[0]
        facing = known or bool(lead <= TOP_LEAD)
        if not known:
            self.notes.append(f"its {'front' if facing else 'top'} faces the camera: what it uses is there")
        if not self.plain(facing, used):
            others = "; ".join(f"{side}: {list(pose)}" for side, pose in POSES.items())
            chosen = "-x, its front in PartNet," if facing else "its top"
            what = f"which side faces the camera? The rules chose {chosen} in doubt"
            self.questions.append(f"{what}. Orientation by side: {others}")
        return FACING if facing else STANDING

    def plain(self, facing: bool, used: list[Moving]) -> bool:
        """Whether the front, or the top, is where the object at rest has what it uses, and nothing else comes near."""
        visible, size = shown(self.raw), np.maximum(self.high - self.low, 1e-6)
        boxes = [(visible[moving.link].min(axis=0) + visible[moving.link].max(axis=0)) / 2 for moving in used]
        offset = (np.mean(boxes, axis=0) - (self.low + self.high) / 2) / (size / 2)
        if not facing:
            return bool(offset[2] >= ON_TOP)
        return bool(size[0] <= PLATE * size[1:].min() or offset[2] + offset[0] <= -AHEAD)

    def ask_what_is_out_of_reach(self, used: list[Moving], links: Mapping[str, Kind], scale: float) -> None:
        for moving in used:
            states = 2 if links[moving.link] == "two-state" else 3
            found = out_of_reach(self.raw.urdf, self.raw.meshes, moving.joint, states, scale)
            if found is not None:
                what, largest = found
                self.questions.append(f"{what}. Shall its scale be {largest} or less, or its travel shorter?")

    def effect(self, category: Category, used: list[Moving], orientation: Quaternion, scale: float) -> EffectChoice:
        if category == "Lamp":
            return self.lamp()
        units = [scale if moving.slides else 1.0 for moving in used]
        if category == "Toy":
            return self.toy(used[-1], units[-1])
        return self.door(used, units, orientation)

    def toy(self, moving: Moving, unit: float) -> EffectChoice:
        lower, upper = limits(moving.joint)
        if not moving.slides:
            upper = min(upper, lower + MOST_TURN)
        first = rest(moving.joint)
        if min(first - lower, upper - first) < NEAR_END * (upper - lower):
            first = (lower + upper) / 2
        steps = ((first * unit,), (lower * unit,), (upper * unit,))
        return EffectChoice(type="joint", joints=(moving.joint.name,), steps=steps)

    def door(self, used: list[Moving], units: list[float], orientation: Quaternion) -> EffectChoice:
        x, y, z, w = orientation
        raw, joints = self.raw, [moving.joint for moving in used]
        ends = [flatter_first(raw.urdf, raw.meshes, (w, x, y, z), joint, limits(joint)) for joint in joints]
        motion = (used[0].high - used[0].low).mean(axis=0) * np.sign(ends[0][1] - ends[0][0])
        if motion @ _turn(orientation)[2] < -FLAT * np.linalg.norm(motion):
            self.notes.append("it opens away from the camera, into the board")
        closed = tuple(shut * unit for (shut, _), unit in zip(ends, units, strict=True))
        opened = tuple(wide * unit for (_, wide), unit in zip(ends, units, strict=True))
        first, second = (opened[0], *closed[1:]), (closed[0], *opened[1:])
        return EffectChoice(
            type="joint",
            joints=tuple(joint.name for joint in joints),
            states=(closed, first),
            steps=(closed, first, second) if len(used) > 1 else None,
        )

    def lamp(self) -> EffectChoice:
        visible, depth = shown(self.raw), {self.raw.urdf.root: 0}
        for joint in self.raw.urdf.joints:
            depth[joint.child] = depth[joint.parent] + 1
        candidates = [joint.child for joint in self.raw.urdf.joints if joint.child in visible]
        named = [link for link in candidates if LIGHTS & _words(" ".join(self.describe(link)))]
        if len(candidates) < 2 and not named:
            self.refuse("nothing but a single link shows, so there is no lamp shade to paint")
        link = max(named or candidates, key=lambda link: (depth[link], face(np.ptp(visible[link], axis=0))))
        self.notes.append(f"{link} shines: {'by its name' if named else 'it ends the chain of joints'}")
        draw = generator(0, "import", 0, f"Lamp/{self.raw.instance}").permutation(len(PALETTE))
        single, first, second = (PALETTE[index] for index in draw[:3])
        return EffectChoice(type="color", link=link, states=(OFF, single), steps=(OFF, first, second))

    def describe(self, link: str) -> tuple[str, ...]:
        return (self.raw.names.get(link, ""), *self.raw.parts.get(link, ()))

    def refuse(self, what: str) -> NoReturn:
        hint = "leave it out, or say in an override what it is (`assets import --review`)"
        raise BusybotError(f"{self.raw.folder}: {what}", hint)


def _kinds(used: list[Moving], motions: list[np.ndarray], size: np.ndarray) -> dict[str, Kind]:
    box = len(used) == 1 and size[2] >= min(size[:2])
    least = BOX_TRAVEL * float(np.linalg.norm(size[:2]))
    return {
        moving.link: "multi-direction" if box and travel(motion) >= least else "two-state"
        for moving, motion in zip(used, motions, strict=True)
    }


def _turn(orientation: Quaternion) -> np.ndarray:
    """Rotation matrix (3, 3) of a quaternion (x, y, z, w)."""
    x, y, z, w = orientation
    return rotation((w, x, y, z))


def _words(name: str) -> frozenset[str]:
    return frozenset(re.split(r"[^a-z]+", name.lower()))


def _scale(category: str, size: np.ndarray) -> float:
    side = float(max(size[:2])) if category == "Door" else float(np.sqrt(size[0] * size[1]))
    scale = min(SIDES[category] / max(side, 1e-4), MAX_HEIGHT / max(float(size[2]), 1e-4), 100.0)
    return float(f"{scale:.3g}")
