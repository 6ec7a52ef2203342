"""Writing a design as an annotated PartNet-Mobility folder. The same design gives the same bytes.

`mobility.urdf`, `textured_objs/*.obj` with materials, `bounding_box.json` and `object_meta_info.json`.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from busybot.common.atomic_io import make_folder, write_new
from busybot.objects.procedural.cad import Solid, joined
from busybot.objects.procedural.design import Design, Material, MovingLink, Part, by_material, shifted

CREASE = np.cos(np.deg2rad(38.0))
"""Faces that meet at a smaller angle share their normals and look round."""
_INERTIAL = '<inertial><mass value="10"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def write_object(design: Design, folder: Path) -> None:
    """Write the object's files into a new folder."""
    make_folder(folder / "textured_objs")
    for name, parts, origin in _links(design):
        if parts:
            local = shifted(parts, [-value for value in origin])
            _write_mesh(folder / "textured_objs", name, local, 1 / design.scale)
    write_new(folder / "mobility.urdf", _urdf(design).encode())
    low, high = _box(design)
    _write_json(folder / "bounding_box.json", {"min": low, "max": high})
    _write_json(folder / "object_meta_info.json", _annotation(design, low, high))


def _links(design: Design) -> list[tuple[str, Sequence[Part], Sequence[float]]]:
    """Name, parts and frame origin of each link; the body comes first and is called `body`."""
    links: list[tuple[str, Sequence[Part], Sequence[float]]] = [("body", design.body, (0.0, 0.0, 0.0))]
    links += [(f"link_{k}", link.parts, link.origin) for k, link in enumerate(design.links)]
    if design.shade is not None:
        links.append(("shade", design.shade.parts, (0.0, 0.0, 0.0)))
    return links


def _box(design: Design) -> tuple[list[float], list[float]]:
    """The box in the upright frame before scaling, joints at 0."""
    vertices = joined([part.solid for _, parts, _ in _links(design) for part in parts]).vertices / design.scale
    return [round(float(v), 6) for v in vertices.min(axis=0)], [round(float(v), 6) for v in vertices.max(axis=0)]


def corner_normals(solid: Solid) -> np.ndarray:
    """Normals per face corner, (m, 3, 3): area-weighted means over the faces around that are within the crease."""
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    weighted = np.cross(b - a, c - a)
    flat = weighted / np.maximum(np.linalg.norm(weighted, axis=1, keepdims=True), 1e-12)
    corners = solid.faces.ravel()
    order = np.argsort(corners, kind="stable")
    counts = np.bincount(corners, minlength=len(solid.vertices))
    starts = np.cumsum(counts) - counts
    # every corner is paired with every face around its vertex
    per_corner = counts[corners]
    own = np.repeat(np.arange(len(corners)), per_corner)
    step = np.arange(per_corner.sum()) - np.repeat(np.cumsum(per_corner) - per_corner, per_corner)
    other_face = order[np.repeat(starts[corners], per_corner) + step] // 3
    near = (flat[own // 3] * flat[other_face]).sum(axis=1) > CREASE
    around = weighted[other_face[near]]
    sums = np.stack([np.bincount(own[near], around[:, k], minlength=len(corners)) for k in range(3)], axis=1)
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    normals = np.where(lengths > 1e-12, sums / np.maximum(lengths, 1e-12), flat[np.arange(len(corners)) // 3])
    return normals.reshape(-1, 3, 3)


def _write_mesh(folder: Path, name: str, parts: Sequence[Part], factor: float) -> None:
    lines, vertex_base, normal_base = [f"mtllib {name}.mtl"], 1, 1
    groups = by_material(parts)
    for material, solid in groups:
        unique, index = _distinct(corner_normals(solid).reshape(-1, 3))
        vertices = np.round(solid.vertices * factor, 4) + 0.0  # no negative zeros
        lines += [f"o {material.name}", f"usemtl {material.name}"]
        lines += [_rows("v %.4f %.4f %.4f", vertices), _rows("vn %.3f %.3f %.3f", unique)]
        corners = np.stack([solid.faces + vertex_base, index.reshape(-1, 3) + normal_base], axis=2)
        lines.append(_rows("f %d//%d %d//%d %d//%d", corners.reshape(-1, 6)))
        vertex_base, normal_base = vertex_base + len(vertices), normal_base + len(unique)
    write_new(folder / f"{name}.obj", ("\n".join(lines) + "\n").encode())
    text = "\n".join(_material(material) for material, _ in groups)
    write_new(folder / f"{name}.mtl", text.encode())


def _rows(line: str, values: np.ndarray) -> str:
    """A line of text for each row; one format for all is several times faster than one each."""
    return "\n".join([line] * len(values)) % tuple(values.ravel().tolist())


def _distinct(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The different normals, rounded to thousandths, (k, 3), and for each one given which of them it is."""
    whole = np.round(normals * 1000).astype(np.int64) + 1000
    codes, index = np.unique((whole[:, 0] * 2001 + whole[:, 1]) * 2001 + whole[:, 2], return_inverse=True)
    parts = np.stack([codes // 2001**2, codes // 2001 % 2001, codes % 2001], axis=1)
    return (parts - 1000) / 1000, index


def _material(material: Material) -> str:
    color = " ".join(f"{channel:.4f}" for channel in material.color)
    gloss = f"{0.5 * material.shine:.4f}"
    sharpness = f"Ns {10 + 190 * material.shine:.1f}"
    return f"newmtl {material.name}\nillum 2\nd 1\n{sharpness}\nKd {color}\nKs {gloss} {gloss} {gloss}\n"


def _urdf(design: Design) -> str:
    scale = design.scale
    lines = ['<?xml version="1.0"?>', f'<robot name="{design.name}">', f'  <link name="base">{_INERTIAL}</link>']
    lines += _link("body", bool(design.body)) + _joint("joint_body", "base", "body")
    for k, link in enumerate(design.links):
        parent = "body" if link.parent is None else f"link_{link.parent}"
        offset = np.asarray(link.origin) - (0 if link.parent is None else design.links[link.parent].origin)
        lines += _link(f"link_{k}", bool(link.parts))
        lines += _joint(f"joint_{k}", parent, f"link_{k}", offset / scale, link, scale)
    if design.shade is not None:
        lines += _link("shade", True) + _joint("joint_shade", "body", "shade")
    return "\n".join([*lines, "</robot>"]) + "\n"


def _link(name: str, visible: bool) -> list[str]:
    mesh = f'<origin xyz="0 0 0"/><geometry><mesh filename="textured_objs/{name}.obj"/></geometry>'
    shapes = [f"    <visual>{mesh}</visual>", f"    <collision>{mesh}</collision>"] if visible else []
    return [f'  <link name="{name}">', *shapes, f"    {_INERTIAL}", "  </link>"]


def _joint(
    name: str,
    parent: str,
    child: str,
    origin: np.ndarray | None = None,
    link: MovingLink | None = None,
    scale: float = 1.0,
) -> list[str]:
    """A fixed joint at its parent's origin, or the one that moves `link`."""
    kind = "fixed" if link is None else link.joint_type
    place = " ".join(f"{float(value) + 0.0:.6g}" for value in (np.zeros(3) if origin is None else origin))
    lines = [f'  <joint name="{name}" type="{kind}">', f'    <origin xyz="{place}" rpy="0 0 0"/>']
    lines += [f'    <parent link="{parent}"/>', f'    <child link="{child}"/>']
    if link is not None:
        unit = scale if link.joint_type == "prismatic" else 1.0
        axis = " ".join(f"{float(value):.6g}" for value in link.axis)
        lines.append(f'    <axis xyz="{axis}"/>')
        lower, upper = f"{link.lower / unit:.6g}", f"{link.upper / unit:.6g}"
        lines.append(f'    <limit effort="30" lower="{lower}" upper="{upper}" velocity="1.0"/>')
    return [*lines, "  </joint>"]


def _annotation(design: Design, low: list[float], high: list[float]) -> dict[str, Any]:
    category, _, instance = design.name.partition("_")
    movable = [(k, link) for k, link in enumerate(design.links) if link.kind]
    joint_types = {"revolute": "hinge", "prismatic": "slider"}
    return {
        "Category": category,
        "InstanceId": instance,
        "Scale": design.scale,
        "Movable_link": {
            f"link_{k}": {"link_id": f"link_{k}", "link_name": link.label, "joint_type": joint_types[link.joint_type]}
            for k, link in movable
        },
        "Orientation": [0, 0, 0, 1],
        "MinBBox": low,
        "MaxBBox": high,
        "Offset_z": 0.0,
        "Direction": design.directions or None,
        "Effect": _effects(design),
        # joint 0 fixes the body to the base
        "Cause": [
            {"JointId": k + 1, "IsSmallCause": int(link.kind == "small"), "IsLargeCause": int(link.kind == "large")}
            for k, link in movable
        ],
    }


def _effects(design: Design) -> list[dict[str, Any]]:
    joints, link, states, steps = list(range(1, len(design.links) + 1)), None, design.states, design.steps
    if design.shade is not None:
        single, first, second = ((*map(float, color), 1.0) for color in design.shade.colors)
        off = (0.0, 0.0, 0.0, 1.0)
        joints, link, states, steps = [], len(design.links) + 1, (off, single), (off, first, second)
    if states is None and steps is None:
        return []
    return [
        {
            "Type": "joint" if link is None else "link",
            "JointId": joints if len(joints) > 1 else next(iter(joints), None),
            "LinkId": link,
            "IsMultiEffect": int(steps is not None),
            "Steps": steps,
            "IsSingleEffect": int(states is not None),
            "States": states,
        }
    ]


def _write_json(path: Path, value: Any) -> None:
    write_new(path, (json.dumps(value, indent=1, sort_keys=True) + "\n").encode())
