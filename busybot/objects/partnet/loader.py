"""From a folder to an `ObjectModel`: annotation, URDF and meshes, checked and brought together. No simulator."""

from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal, NoReturn, cast

import numpy as np

from busybot.objects.model import Effect, ObjectModel, TriggerLink, Vector
from busybot.objects.partnet.annotation import FILE_NAME, EffectEntry, parse_annotation
from busybot.objects.partnet.folder_snapshot import Snapshot, read_snapshot
from busybot.objects.partnet.meshes import check_meshes
from busybot.objects.partnet.urdf import Joint, bounds, flatter_first, link_vertices, parse_urdf

UNLIMITED_RANGE = (0.0, 1.5707963267948966)
"""Joint limits (radians) that stand for those of a continuous joint, and for infinite ones: a quarter turn."""
WHOLE = "body"
"""What boards and recordings call an object as a whole (`boards.spec.BODY`): no moving link may have this name."""

Triple = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]
Pair = tuple[tuple[float, ...], tuple[float, ...]]


def load_object(folder: Path, known: dict[str, ObjectModel] | None = None) -> ObjectModel:
    """Read an annotated object folder.

    Args:
        folder: holds `object_meta_info.json`, `mobility.urdf` and the meshes. It may itself be reached through a link.
        known: objects by the hash of their files, which need not be parsed again; takes up those that were parsed.

    Raises:
        BusybotError: something is missing, malformed, monstrous or leads out of the folder; names file, place and hint.
    """
    snapshot = read_snapshot(folder.absolute())
    if known is not None and snapshot.sha256 in known:
        return replace(known[snapshot.sha256], folder=snapshot.folder)
    model = _parse(_Hashed(snapshot.folder, snapshot.sha256, [snapshot]))
    if known is not None:
        known[model.sha256] = model
    return model


def parse_object(snapshot: Snapshot) -> ObjectModel:
    """The object that these files would be; `load_object` without a disk."""
    return _Builder(snapshot).build()


@dataclass(frozen=True)
class _Hashed:
    """A snapshot that is equal to another when place and content are: the key of the cache."""

    folder: Path
    sha256: str
    snapshot: list[Snapshot] = field(compare=False)


@lru_cache(maxsize=1024)
def _parse(hashed: _Hashed) -> ObjectModel:
    return parse_object(hashed.snapshot.pop())  # the cache keeps the key, not the bytes


class _Builder:
    """One object on its way from files to a model."""

    def __init__(self, snapshot: Snapshot):
        self.snapshot = snapshot
        self.annotation, self.urdf = parse_annotation(snapshot), parse_urdf(snapshot)
        self.meshes = check_meshes(snapshot, self.urdf.meshes, self.urdf.textures)
        if not any(self.urdf.visuals.values()):
            snapshot.refuse("mobility.urdf", "shows nothing", "give its links visual meshes")
        x, y, z, w = self.annotation.Orientation
        self.orientation = (w, x, y, z)

    def build(self) -> ObjectModel:
        annotation, links, effect = self.annotation, self.trigger_links(), self.effect()
        low, high = self.occupied(links, effect)
        return ObjectModel(
            category=annotation.Category,
            instance=annotation.InstanceId,
            role="trigger" if annotation.Cause else "responder",
            scale=annotation.Scale,
            orientation=self.orientation,
            bounds_min=low,
            bounds_max=high,
            offset_z=annotation.Offset_z,
            trigger_links=links,
            directions=annotation.Direction or (),
            effect=effect,
            folder=self.snapshot.folder,
            sha256=self.snapshot.sha256,
        )

    def trigger_links(self) -> tuple[TriggerLink, ...]:
        links = []
        for index, cause in enumerate(self.annotation.Cause):
            place = f"Cause.{index}.JointId"
            joint = self.joint(cause.JointId, place)
            if joint.type == "fixed":
                self.refuse(f"{place} {cause.JointId} is the fixed joint {joint.name!r}")
            if joint.child not in self.annotation.Movable_link:
                self.refuse(f"{place} {cause.JointId} moves {joint.child!r}, which is not in Movable_link")
            if not self.urdf.visuals.get(joint.child):
                self.refuse(f"{place} {cause.JointId} moves {joint.child!r}, which shows nothing")
            if joint.child == WHOLE:
                hint = "rename the link in the URDF, and in Movable_link where there is an annotation"
                what = f"joint {joint.name!r} moves the link {WHOLE!r}, which is what boards call an object as a whole"
                self.snapshot.refuse("mobility.urdf", what, hint)
            lower, upper = limits(joint)
            if upper - lower < 1e-6:
                self.refuse(f"{place}: the joint {joint.name!r} has no range: {lower} to {upper}")
            moves: Literal["prismatic", "revolute"] = "prismatic" if joint.type == "prismatic" else "revolute"
            kind: Literal["two-state", "multi-direction"] = "multi-direction" if cause.IsLargeCause else "two-state"
            links.append(TriggerLink(joint.child, joint.name, moves, kind, lower, upper))
        unknown = set(self.annotation.Movable_link) - {link.name for link in links}
        if links and unknown:
            self.refuse(f"Movable_link names {min(unknown)!r}, which no Cause moves")
        return tuple(links)

    def effect(self) -> Effect | None:
        if not self.annotation.Effect:
            return None
        entry = self.annotation.Effect[0]
        if entry.Type == "link":
            assert entry.LinkId is not None  # the annotation's validator saw to it
            link = self.joint(entry.LinkId, "Effect.0.LinkId").child
            if not self.urdf.visuals.get(link):
                self.refuse(f"Effect.0.LinkId {entry.LinkId} paints {link!r}, which shows nothing")
            return Effect("color", link, (), *_stages(entry, channels=3))
        joints = [self.joint(number, "Effect.0.JointId") for number in entry.joint_ids]
        if any(joint.type == "fixed" for joint in joints):
            self.refuse(f"Effect.0.JointId {entry.JointId} names a fixed joint")
        single, multi = _stages(entry, channels=None)
        if single is None and entry.IsSingleEffect:
            single = self.closed_and_open(joints[0])
        return Effect("joint", None, tuple(joint.name for joint in joints), single, multi)

    def closed_and_open(self, joint: Joint) -> Pair:
        """The joint's two limits; closed is the one with which the object is flatter."""
        ends = limits(joint)
        if ends[1] - ends[0] < 1e-6:
            self.refuse(f"Effect.0: the joint {joint.name!r} has no range: {ends[0]} to {ends[1]}")
        closed, opened = flatter_first(self.urdf, self.meshes, self.orientation, joint, ends)
        unit = self.annotation.Scale if joint.type == "prismatic" else 1.0  # board units
        return (closed * unit,), (opened * unit,)

    def occupied(self, links: tuple[TriggerLink, ...], effect: Effect | None) -> tuple[Vector, Vector]:
        """The box around all states that triggers and responders can show; other joints rest."""
        states = [dict[str, float]()]
        if links:
            states = [{link.joint: getattr(link, end) for link in links} for end in ("lower", "upper")]
        if effect is not None and effect.joints:
            # annotated positions of sliding joints are board units, whatever the scale
            sliding = {joint.name for joint in self.urdf.joints if joint.type == "prismatic"}
            units = [1 / self.annotation.Scale if name in sliding else 1.0 for name in effect.joints]
            values = np.array([*(effect.single or ()), *(effect.multi or ())]) * units
            states = [dict(zip(effect.joints, value.tolist(), strict=True)) for value in values]
        boxes = [bounds(link_vertices(self.urdf, self.meshes, self.orientation, state)) for state in states]
        low, high = np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)
        if not 1e-4 <= self.annotation.Scale * float((high - low).min()) <= 100:
            self.refuse(f"the object occupies {(high - low).round(6).tolist()} times Scale: flat or monstrous")
        return cast(Vector, tuple(low.tolist())), cast(Vector, tuple(high.tolist()))

    def joint(self, number: int, place: str) -> Joint:
        if number >= len(self.urdf.joints):
            self.refuse(f"{place} is {number}, but the URDF has {len(self.urdf.joints)} joints")
        return self.urdf.joints[number]

    def refuse(self, what: str) -> NoReturn:
        hint = "count joints from 0, fixed ones included, depth first from the root; correct what differs"
        self.snapshot.refuse(FILE_NAME, what, hint)


def _stages(entry: EffectEntry, channels: int | None) -> tuple[Pair | None, Triple | None]:
    single = tuple(value[:channels] for value in entry.States) if entry.IsSingleEffect and entry.States else None
    multi = tuple(value[:channels] for value in entry.Steps) if entry.IsMultiEffect and entry.Steps else None
    return cast(Pair | None, single), cast(Triple | None, multi)


def limits(joint: Joint) -> tuple[float, float]:
    """Joint limits, with `UNLIMITED_RANGE` where the document has none."""
    if joint.lower is None or joint.upper is None:
        return UNLIMITED_RANGE
    return joint.lower + 0.0, joint.upper + 0.0  # -0.0 becomes 0.0
