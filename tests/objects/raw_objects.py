"""Small raw PartNet-Mobility folders for tests: boxes for meshes, PartNet's frame (z up, -x the front)."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from busybot.objects.importing.annotation_edits import Choices, Overrides
from busybot.objects.importing.importer import import_objects
from busybot.objects.library import Library

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
BODY: Box = ((-0.1, -0.5, -0.6), (0.1, 0.5, 0.6))
"""A wall plate: 0.2 deep, 1 wide, 1.2 high."""
_FACES = "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"


@dataclass(frozen=True)
class Link:
    """A link of the body; `box` is in the URDF's frame, `origin` the joint's place."""

    name: str
    box: Box
    joint: str = "revolute"
    axis: tuple[float, float, float] = (0, 1, 0)
    limits: tuple[float, float] | None = (0.0, 0.4)
    origin: tuple[float, float, float] = (0, 0, 0)
    parent: str = "body"


ROCKER = Link("toggle_button", ((-0.2, -0.2, -0.2), (-0.1, 0.2, 0.2)), origin=(-0.1, 0, 0))
LEVER = Link("lever", ((-1.0, -0.05, -0.05), (-0.1, 0.05, 0.05)), limits=(-0.5, 0.5))
KNOB = Link("knob", ((-0.2, -0.2, -0.2), (-0.1, 0.2, 0.2)), "continuous", (1, 0, 0), None)
LEAF = Link("rotation_door", ((-0.15, -0.45, -0.55), (-0.1, 0.45, 0.55)), axis=(0, 0, 1), origin=(-0.1, -0.45, 0))
DRAWER = Link("drawer", ((-0.15, -0.45, -0.5), (-0.1, 0.45, 0.5)), "prismatic", (-1, 0, 0), (0.0, 0.5))

STICK = Link("lever", ((-0.03, -0.03, 0.1), (0.03, 0.03, 0.6)), axis=(0, 1, 0), limits=(-0.5, 0.5), origin=(0, 0, 0.1))
GROUND = ((-0.2, -0.2, 0.0), (0.2, 0.2, 0.1))
"""A foot on the ground: the lever on it stands upright."""


def make_raw(folder: Path, category: str | None, *links: Link, body: Box = BODY, **changes: Any) -> Path:
    """Write a raw object; link k is `link_k` with joint `joint_k`, the body is `body`."""
    (folder / "textured_objs").mkdir(parents=True)
    parts = [_link("body", (0, 0, 0)), _joint("joint_body", "fixed", "base", "body", (0, 0, 0), (1, 0, 0), None)]
    _mesh(folder / "textured_objs" / "body.obj", body)
    for k, link in enumerate(links):
        _mesh(folder / "textured_objs" / f"link_{k}.obj", link.box)
        parts.append(_link(f"link_{k}", tuple(-value for value in link.origin)))
        parts.append(
            _joint(f"joint_{k}", link.joint, link.parent, f"link_{k}", link.origin, link.axis, link.limits),
        )
    (folder / "textured_objs" / "paint.mtl").write_text("newmtl paint\nKd 0.8 0.2 0.2\n")
    (folder / "mobility.urdf").write_text(f'<robot name="raw"><link name="base"/>{"".join(parts)}</robot>')
    semantics = [
        f"link_{k} {'slider' if link.joint == 'prismatic' else 'hinge'} {link.name}" for k, link in enumerate(links)
    ]
    (folder / "semantics.txt").write_text("\n".join([*semantics, "body heavy frame"]) + "\n")
    described = [{"id": k, "name": link.name, "parts": [{"name": link.name}]} for k, link in enumerate(links)]
    (folder / "mobility_v2.json").write_text(json.dumps(described))
    if category is not None:
        (folder / "meta.json").write_text(json.dumps({"model_cat": category, "anno_id": folder.name}))
    for name, value in changes.items():
        (folder / name.replace("__", ".")).write_text(value)
    return folder


def library_of(folder: Path, urdf: str, **choices: Any) -> Library:
    """A library with one object, `thing`, of a URDF without mesh files, imported with these choices."""
    raw = folder / "raw" / "thing"
    raw.mkdir(parents=True)
    (raw / "mobility.urdf").write_text(f'<robot name="thing">{urdf}</robot>')
    given = Overrides(None, {"thing": Choices(**choices)}, {})
    (outcome,) = import_objects([raw], folder / "library", given)
    assert outcome.problem is None, outcome.problem
    return Library.load(folder / "library")


def box_link(name: str, size: str, place: str = "0 0 0", inside: str = "") -> str:
    """A link that is a box; `inside` is what else its `<visual>` has."""
    shown = f'<origin xyz="{place}"/><geometry><box size="{size}"/></geometry>{inside}'
    return f'<link name="{name}"><visual>{shown}</visual></link>'


BOX_LAMP = (
    '<link name="base"/>{foot}{shade}'
    '<joint name="j0" type="fixed"><parent link="base"/><child link="foot"/></joint>'
    '<joint name="j1" type="fixed"><parent link="foot"/><child link="shade"/></joint>'
).format(foot=box_link("foot", "0.4 0.4 0.2", "0 0 0.1"), shade=box_link("shade", "0.3 0.3 0.4", "0 0 0.4"))
"""A lamp whose shade is a box, which is painted."""


def _mesh(path: Path, box: Box) -> None:
    corners = [
        (x, y, z) for x in (box[0][0], box[1][0]) for y in (box[0][1], box[1][1]) for z in (box[0][2], box[1][2])
    ]
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
    path.write_text(f"mtllib paint.mtl\n{vertices}usemtl paint\n{_FACES}")


def _link(name: str, offset: tuple[float, ...]) -> str:
    place = " ".join(map(str, offset))
    mesh = f'<origin xyz="{place}"/><geometry><mesh filename="textured_objs/{name}.obj"/></geometry>'
    return f'<link name="{name}"><visual>{mesh}</visual></link>'


def _joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    origin: tuple[float, ...],
    axis: tuple[float, ...],
    limits: tuple[float, float] | None,
) -> str:
    limit = f'<limit lower="{limits[0]}" upper="{limits[1]}"/>' if limits else ""
    place, way = " ".join(map(str, origin)), " ".join(map(str, axis))
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{place}"/><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{way}"/>{limit}</joint>'
    )
