"""The parts of a URDF that boards need, and forward kinematics over mesh vertices. No simulator.

Links, joints, the tree, and which files it names. Hostile or broken documents are refused by name: DTDs and entities,
cycles, duplicate names, numbers that are not finite, monstrous counts, references out of the folder.

The annotation's boxes cannot be trusted for placing: on most of the 58 objects y is mirrored (on lamps x too), the
toys' boxes are too small. The layout of a board needs what the object really occupies, for given joint positions.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NoReturn
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from busybot.objects.partnet.folder_snapshot import Snapshot

FILE_NAME = "mobility.urdf"
MAX_BYTES = 4 << 20
MAX_ELEMENTS = 50_000
MAX_DEPTH = 16
MAX_LINKS = 64
MAX_VISUALS = 512
MAX_NUMBER = 1e4
JOINT_TYPES = ("fixed", "revolute", "prismatic", "continuous")
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
# Numeric attributes by tag, with how many numbers each holds.
_NUMERIC = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "mesh": {"scale": 3},
    "color": {"rgba": 4},
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
}


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint.

    Attributes:
        lower, upper: limits; None where the document has none (fixed, continuous or infinite).
        origin: child frame at position 0 in the parent's frame, homogeneous, (4, 4).
        axis: unit vector in the child's frame, (3,).
    """

    name: str
    type: str
    parent: str
    child: str
    lower: float | None
    upper: float | None
    origin: np.ndarray
    axis: np.ndarray


@dataclass(frozen=True, eq=False)
class Shape:
    """What a link shows: a mesh file, or else the corners of a primitive's box; in the link's frame after `transform`.

    Attributes:
        transform: homogeneous, (4, 4), the mesh's scale included.
    """

    mesh: str | None
    corners: np.ndarray
    transform: np.ndarray


@dataclass(frozen=True, eq=False)
class Urdf:
    """The checked document.

    Attributes:
        root: name of the root link.
        joints: depth first from the root, children in document order: PyBullet's numbering.
        visuals: shapes by link.
        meshes: mesh files relative to the folder, without repetition.
        textures: texture files that the document itself names.
    """

    root: str
    joints: tuple[Joint, ...]
    visuals: dict[str, tuple[Shape, ...]]
    meshes: tuple[str, ...]
    textures: tuple[str, ...]


def vector(element: Element | None, attribute: str, default: tuple[float, ...]) -> np.ndarray:
    """The numbers of an attribute that `_Reader.check_numbers` has seen."""
    text = None if element is None else element.get(attribute)
    return np.array(default if text is None else [float(part) for part in text.split()], dtype=np.float64)


def transform(origin: Element | None) -> np.ndarray:
    """An `<origin>` as a homogeneous matrix; `rpy` turns about the fixed axes x, then y, then z."""
    result = np.eye(4)
    result[:3, 3] = vector(origin, "xyz", (0.0, 0.0, 0.0))
    (cr, cp, cy), (sr, sp, sy) = (f(vector(origin, "rpy", (0.0, 0.0, 0.0))) for f in (np.cos, np.sin))
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    result[:3, :3] = about_z @ about_y @ about_x
    return result


def primitive_half_size(form: Element) -> np.ndarray | None:
    """Half the box around a `<box>`, `<sphere>`, `<cylinder>` or `<capsule>`; None for anything else."""
    if form.tag == "box":
        return vector(form, "size", (1.0, 1.0, 1.0)) / 2
    if form.tag not in ("sphere", "cylinder", "capsule"):
        return None
    radius = float(vector(form, "radius", (1.0,))[0])
    half = radius if form.tag == "sphere" else float(vector(form, "length", (1.0,))[0]) / 2
    return np.array([radius, radius, half + radius if form.tag == "capsule" else half])


class _Reader:
    """One document being read; keeps the place for error messages."""

    def __init__(self, snapshot: Snapshot):
        self.snapshot = snapshot

    def refuse(self, what: str, hint: str = "correct the document") -> NoReturn:
        self.snapshot.refuse(FILE_NAME, what, hint)

    def document(self) -> Element:
        data = self.snapshot.require(FILE_NAME, MAX_BYTES, "correct the document")
        try:
            root: Element = fromstring(data, forbid_dtd=True)
        except DefusedXmlException as error:
            self.refuse(f"has a DTD or entities: {type(error).__name__}", "remove the DOCTYPE")
        except (ParseError, ValueError, LookupError) as error:
            self.refuse(f"not valid XML: {str(error)[:200]}")
        if root.tag != "robot":
            self.refuse(f"the root element is <{str(root.tag)[:40]}>, not <robot>")
        count, level = 0, [root]
        for _ in range(MAX_DEPTH):
            count += len(level)
            level = [child for element in level for child in element]
        if level:
            self.refuse(f"elements are nested more than {MAX_DEPTH} deep")
        if count > MAX_ELEMENTS:
            self.refuse(f"{count} elements are more than the {MAX_ELEMENTS} allowed")
        return root

    def name(self, element: Element) -> str:
        name = element.get("name", "")
        if not _NAME.fullmatch(name):
            self.refuse(f"<{element.tag}> has the name {name[:80]!r}", "use letters, digits, '_', '.', '-', at most 64")
        return name

    def number(self, text: str, place: str) -> float:
        value = float(text) if _NUMBER.fullmatch(text) else math.nan
        if not abs(value) <= MAX_NUMBER:
            self.refuse(f"{place}: {text[:40]!r} is not a finite number of sensible size")
        return value

    def check_numbers(self, element: Element) -> None:
        for attribute, count in _NUMERIC.get(element.tag, {}).items():
            text = element.get(attribute)
            if text is None:
                continue
            parts, place = text.split(), f"<{element.tag} {attribute}={text[:60]!r}>"
            if len(parts) != count:
                self.refuse(f"{place} needs {count} numbers")
            values = [self.number(part, place) for part in parts]
            positive = element.tag in ("box", "sphere", "cylinder", "capsule")
            if (positive and min(values) <= 0) or (element.tag == "mesh" and 0 in values):
                self.refuse(f"{place} must not be zero or negative")

    def limit(self, joint: Element, name: str, attribute: str) -> float | None:
        element = joint.find("limit")
        text = None if element is None else element.get(attribute)
        if text is None:
            hint = "give both limits, numbers or inf; a joint that turns without end is of the type continuous"
            self.refuse(f"joint {name!r} has no {attribute} limit", hint)
        if text.strip().lower().lstrip("+-") in ("inf", "infinity"):
            return None
        return self.number(text.strip(), f"joint {name!r}: limit {attribute}")

    def joint(self, element: Element) -> Joint:
        name, kind = self.name(element), element.get("type", "")
        if kind not in JOINT_TYPES:
            self.refuse(f"joint {name!r} has the type {kind[:40]!r}", f"use one of {', '.join(JOINT_TYPES)}")
        if element.find("mimic") is not None:
            self.refuse(f"joint {name!r} follows another joint: <mimic> is not simulated", "remove the <mimic>")
        ends = []
        for tag in ("parent", "child"):
            end = element.find(tag)
            if end is None or not end.get("link"):
                self.refuse(f"joint {name!r} has no {tag} link")
            ends.append(str(end.get("link")))
        limited = kind in ("revolute", "prismatic")
        lower, upper = (self.limit(element, name, end) if limited else None for end in ("lower", "upper"))
        if lower is None or upper is None:
            lower = upper = None
        elif lower > upper:
            self.refuse(f"joint {name!r}: lower limit {lower} is above the upper limit {upper}")
        axis = vector(element.find("axis"), "xyz", (1.0, 0.0, 0.0))
        length = float(np.linalg.norm(axis))
        if length < 1e-6:
            self.refuse(f"joint {name!r}: the axis is the zero vector")
        return Joint(name, kind, ends[0], ends[1], lower, upper, transform(element.find("origin")), axis / length)

    def shape(self, visual: Element) -> Shape:
        placed, geometry = transform(visual.find("origin")), visual.find("geometry")
        if geometry is None or len(geometry) != 1:
            self.refuse("a <visual> has no geometry, or more than one")
        form = geometry[0]
        if form.tag == "mesh":
            placed[:3, :3] *= vector(form, "scale", (1.0, 1.0, 1.0))
            target = self.snapshot.reference(FILE_NAME, form.get("filename", ""), limit=MAX_BYTES << 3)
            return Shape(target, np.zeros((0, 3)), placed)
        half = primitive_half_size(form)
        if half is None:
            self.refuse(f"a <visual> has the geometry <{str(form.tag)[:40]}>", "use meshes")
        signs = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0
        return Shape(None, signs * half, placed)

    def tree(self, links: list[str], joints: list[Joint]) -> tuple[str, tuple[Joint, ...]]:
        for kind, names in (("link", links), ("joint", [j.name for j in joints])):
            if len(set(names)) < len(names):
                self.refuse(f"two {kind}s have the name {next(n for n in names if names.count(n) > 1)!r}")
        children: dict[str, list[Joint]] = {}
        for joint in joints:
            for end in (joint.parent, joint.child):
                if end not in links:
                    self.refuse(f"joint {joint.name!r} names the link {end[:80]!r}, which does not exist")
            children.setdefault(joint.parent, []).append(joint)
        moved = [joint.child for joint in joints]
        roots = [link for link in links if link not in moved]
        if len(set(moved)) < len(moved) or len(roots) != 1:
            self.refuse("the joints form no tree: a link has two parents, there is a cycle or not one root")
        ordered: list[Joint] = []
        stack = children.get(roots[0], [])[::-1]
        while stack:
            joint = stack.pop()
            ordered.append(joint)
            stack.extend(children.get(joint.child, [])[::-1])
        if len(ordered) < len(joints):
            self.refuse("the joints form a cycle")
        return roots[0], tuple(ordered)

    def references(self, root: Element) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Every file that the document names, whatever the element: loaders may open any of them."""
        meshes, textures = dict[str, None](), dict[str, None]()
        for element in root.iter():
            self.check_numbers(element)
            target = element.get("filename")
            if target is None:
                if element.tag in ("mesh", "texture"):
                    self.refuse(f"a <{element.tag}> has no filename")
                continue
            name = self.snapshot.reference(FILE_NAME, target, limit=MAX_BYTES << 3)
            if element.tag == "mesh" and name.endswith(".obj"):
                meshes[name] = None
            elif element.tag == "texture":
                textures[name] = None
            else:
                what = f"<{str(element.tag)[:40]}> refers to {target[:80]!r}, which is no .obj mesh"
                self.refuse(what, "use .obj meshes")
        return tuple(meshes), tuple(textures)


def parse_urdf(snapshot: Snapshot) -> Urdf:
    """Read and check `mobility.urdf`; errors name the file, the place and the hint."""
    reader = _Reader(snapshot)
    root = reader.document()
    if FILE_NAME[:-4] + "srdf" in snapshot.files:
        reader.refuse("an SRDF lies beside it, which loaders would read unchecked", "remove mobility.srdf")
    linked = root.findall("link")
    links = [reader.name(link) for link in linked]
    elements = root.findall("joint")
    visuals = sum(1 for tag in ("visual", "collision") for _ in root.iter(tag))
    if len(links) > MAX_LINKS or len(elements) > MAX_LINKS or visuals > MAX_VISUALS:
        allowed = f"allowed are {MAX_LINKS}, {MAX_LINKS}, {MAX_VISUALS}"
        found = f"{len(links)} links, {len(elements)} joints, {visuals} visual and collision shapes"
        reader.refuse(f"{found}; {allowed}")
    meshes, textures = reader.references(root)
    base, joints = reader.tree(links, [reader.joint(element) for element in elements])
    shapes = {reader.name(link): tuple(reader.shape(visual) for visual in link.findall("visual")) for link in linked}
    return Urdf(base, joints, shapes, meshes, textures)


def rotation(quaternion: Sequence[float]) -> np.ndarray:
    """Rotation matrix (3, 3) of a quaternion (w, x, y, z), normalised here."""
    w, x, y, z = np.asarray(quaternion, dtype=np.float64) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def joint_motion(joint: Joint, position: float) -> np.ndarray:
    """What the joint's position adds to its origin, homogeneous, (4, 4)."""
    result = np.eye(4)
    if joint.type == "prismatic":
        result[:3, 3] = joint.axis * position
    elif joint.type != "fixed":
        half = position / 2
        result[:3, :3] = rotation([np.cos(half), *(np.sin(half) * joint.axis)])
    return result


def link_vertices(
    urdf: Urdf, meshes: Mapping[str, np.ndarray], upright: Sequence[float], positions: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Vertices of every link that shows something.

    Args:
        meshes: vertices by mesh file.
        upright: the annotated orientation (w, x, y, z).
        positions: by joint name, radians or object units; absent joints are at 0.

    Returns:
        By link, (n, 3), upright frame before scaling.
    """
    frames = {urdf.root: np.eye(4)}
    frames[urdf.root][:3, :3] = rotation(upright)
    for joint in urdf.joints:
        motion = joint_motion(joint, positions.get(joint.name, 0.0))
        frames[joint.child] = frames[joint.parent] @ joint.origin @ motion
    found = {link: shape_vertices(shapes, meshes, frames[link]) for link, shapes in urdf.visuals.items()}
    return {link: points for link, points in found.items() if len(points)}


def shape_vertices(shapes: Sequence[Shape], meshes: Mapping[str, np.ndarray], frame: np.ndarray) -> np.ndarray:
    """Vertices of a link's shapes, (n, 3), when the link has this frame, (4, 4)."""
    parts = [np.zeros((0, 3))]
    for shape in shapes:
        points = shape.corners if shape.mesh is None else meshes[shape.mesh]
        matrix = frame @ shape.transform
        parts.append(points @ matrix[:3, :3].T + matrix[:3, 3])
    return np.concatenate(parts)


def bounds(vertices: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest corner, (3,) each, over all links."""
    points = np.concatenate([*vertices.values()])
    return points.min(axis=0), points.max(axis=0)


def flatter_first(
    urdf: Urdf, meshes: Mapping[str, np.ndarray], upright: Sequence[float], joint: Joint, ends: tuple[float, float]
) -> tuple[float, float]:
    """The joint's two ends, first the one at which the object is flatter (upright frame): a door is closed there."""

    def height(position: float) -> float:
        low, high = bounds(link_vertices(urdf, meshes, upright, {joint.name: position}))
        return float(high[2] - low[2])

    first, second = sorted(ends, key=height)
    return first, second
