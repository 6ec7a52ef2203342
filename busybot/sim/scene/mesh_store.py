"""Meshes of objects as SAPIEN reads them, in the user's cache: arrays, so that their files need not be read again.

SAPIEN's reader clears 32 MB of memory for every file, 3 ms each, and an object has up to 216 files, most of them of a
few kB. The arrays are those that SAPIEN made of the files, so pictures are equal bit by bit. They are kept by the hash
of the object's files and by SAPIEN's version; a damaged or unwritable cache costs time only.
"""

import io
import json
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import sapien
from sapien.wrapper.actor_builder import VisualShapeRecord
from sapien.wrapper.articulation_builder import LinkBuilder

from busybot.common.atomic_io import write_atomically
from busybot.common.errors import DAMAGED_ARRAY, BusybotError
from busybot.objects.cache import cache_folder
from busybot.objects.model import ObjectModel

_LAYOUT = 1
_VALUES = (
    *("base_color", "emission", "specular", "roughness", "metallic"),
    *("transmission", "transmission_roughness", "ior"),
)
_OTHER_TEXTURES = ("emission", "metallic", "normal", "roughness", "transmission")
"""Are not kept; none of the paper's objects has one."""


@dataclass(frozen=True)
class Part:
    """The triangles of a mesh file that have one material.

    Attributes:
        vertices: float32 (3 T, 8), triangle by triangle: position, normal, texture coordinates.
        material: arguments of a `RenderMaterial`.
        texture: of the base colour: arguments of a `RenderTexture2D`, of which the first is a path in the object's
            folder.
    """

    vertices: np.ndarray
    material: dict[str, Any]
    texture: list[Any] | None


Meshes = dict[str, list[Part]]
"""By mesh file, its path in the object's folder."""


class _NotKeptError(Exception):
    """An object looks like nothing that the cache keeps."""


def meshes_of(model: ObjectModel, links: Iterable[LinkBuilder]) -> Meshes | None:
    """The object's meshes, from the cache if they are there; None if arrays cannot tell them.

    Args:
        links: all that the object has.
    """
    place = cache_folder() / f"meshes-{_LAYOUT}-{sapien.__version__}" / f"{model.sha256}.npz"
    if (kept := _kept(place)) is not None:
        return kept
    try:
        records = [record for link in links for record in link.visual_records]
        meshes = {_within(model.folder, record.filename): _read(model.folder, record) for record in records}
    except _NotKeptError:
        return None
    _keep(place, meshes)
    return meshes


def component(link: LinkBuilder, folder: Path, meshes: Meshes) -> Any:
    """A body that looks like the link; its materials are its own but for those of the link's records.

    Args:
        folder: the object's.
    """
    body = sapien.render.RenderBodyComponent()
    for record in link.visual_records:
        for part in meshes[_within(folder, record.filename)]:
            body.attach(_shape(record, part, folder))
    body.name = link.name
    return body


def with_own_materials(link: LinkBuilder, build: Callable[[], Any]) -> Any:
    """The body that `build` makes of the link's records, with copies of their materials.

    Primitives and what the URDF paints have their materials in the records: without copies all bodies would share them,
    and painting one would paint all.
    """
    records = link.visual_records
    link.visual_records = [replace(one, material=one.material and _copy(one.material)) for one in records]
    try:
        return build()
    finally:
        link.visual_records = records


def _copy(material: Any) -> Any:
    made = sapien.render.RenderMaterial(**{name: getattr(material, name) for name in _VALUES})
    for kind in ("base_color", *_OTHER_TEXTURES):
        setattr(made, f"{kind}_texture", getattr(material, f"{kind}_texture"))
    return made


def _shape(record: VisualShapeRecord, part: Part, folder: Path) -> Any:
    material = record.material or sapien.render.RenderMaterial(**part.material)
    if record.material is None and part.texture is not None:
        name, *options = part.texture
        material.base_color_texture = sapien.render.RenderTexture2D(str(folder / name), *options)
    position, normal, uv = np.split(part.vertices, (3, 6), axis=1)
    triangles = np.arange(len(position), dtype=np.uint32).reshape(-1, 3)
    shape = sapien.render.RenderShapeTriangleMesh(position, triangles, normal, uv, material)
    shape.scale, shape.local_pose, shape.name = record.scale, record.pose, record.name
    if np.prod(record.scale) < 0:
        shape.front_face = "clockwise"
    return shape


def _read(folder: Path, record: VisualShapeRecord) -> list[Part]:
    """What SAPIEN makes of a mesh file.

    Raises:
        _NotKeptError: it is no file of the object's folder, or has textures of other kinds or from other places.
    """
    if record.type != "file":
        raise _NotKeptError
    parts = []
    for part in sapien.render.RenderShapeTriangleMesh(record.filename).parts:
        columns = (part.vertices, part.get_vertex_normal(), part.get_vertex_uv())
        vertices = np.concatenate(columns, axis=1)[part.triangles.ravel()]
        material = {name: getattr(part.material, name) for name in _VALUES}
        parts.append(Part(vertices, material, _texture(folder, part.material)))
    return parts


def _texture(folder: Path, material: Any) -> list[Any] | None:
    if any(getattr(material, f"{kind}_texture") is not None for kind in _OTHER_TEXTURES):
        raise _NotKeptError
    made = material.base_color_texture
    if made is None:
        return None
    name = _within(folder.resolve(), made.filename)
    return [name, made.mipmap_levels, made.filter_mode, made.address_mode, made.is_srgb]


def _within(folder: Path, file: str) -> str:
    try:
        return Path(file).relative_to(folder).as_posix()
    except ValueError:
        raise _NotKeptError from None


def _kept(place: Path) -> Meshes | None:
    meshes: Meshes = {}
    try:
        with np.load(place, allow_pickle=False) as file:
            vertices, told = file["vertices"], json.loads(file["parts"].tobytes())
        end = 0
        for name, parts in told.items():
            meshes[name] = []
            for corners, material, texture in parts:
                begin, end = end, end + corners
                meshes[name].append(Part(vertices[begin:end], material, texture))
    except DAMAGED_ARRAY:
        return None
    return meshes if vertices.shape == (end, 8) and vertices.dtype == np.float32 else None


def _keep(place: Path, meshes: Meshes) -> None:
    told = {
        name: [(len(part.vertices), part.material, part.texture) for part in parts] for name, parts in meshes.items()
    }
    vertices = [part.vertices for parts in meshes.values() for part in parts]
    file = io.BytesIO()
    np.savez(file, vertices=np.concatenate(vertices), parts=np.frombuffer(json.dumps(told).encode(), np.uint8))
    with suppress(OSError, BusybotError):
        write_atomically(place, file.getvalue(), cache_folder())
