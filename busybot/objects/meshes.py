"""Fast checks of OBJ meshes, their materials and textures, on bytes already read.

A loader would follow `mtllib` and `map_*` anywhere and allocate what the files claim; here every reference must stay in
the folder, every number be finite, every index exist and every size be sane. Statements outside the plain polygon
subset of OBJ and the usual ones of MTL are refused, so what was checked is what a loader sees.
"""

import io
import re
import warnings
from typing import NoReturn

import numpy as np
from PIL import Image

from busybot.errors import BusybotError
from busybot.objects.snapshot import Snapshot

MAX_MESH_BYTES = 32 << 20
MAX_TEXTURE_BYTES = 32 << 20
MAX_MATERIAL_BYTES = 1 << 20
MAX_VERTICES = 200_000
MAX_OBJECT_VERTICES = 1_000_000
MAX_CORNERS = 1_000_000
MAX_COORDINATE = 1e4
MAX_PIXELS = 4096 * 4096
MAX_LINE_BYTES = 1 << 16

_OBJ_KEYS = frozenset(b"v vn vt f l p o g s usemtl mtllib".split())
_MTL_NUMBERS = frozenset(b"Ka Kd Ks Ke Tf Ns Ni d Tr illum sharpness Pr Pm Ps Pc Pcr aniso anisor".split())
_MTL_TEXTURES = re.compile(rb"(map_\w{1,16}|bump|disp|decal|refl|norm)", re.IGNORECASE)
_KEY = re.compile(rb"^[ \t]*([^\s#]\S*)", re.MULTILINE)
_LONG_LINE = re.compile(rb"[^\n\r]{%d}" % MAX_LINE_BYTES)
_FLOAT = rb"([-+0-9.eE]{1,40})"
_VERTEX = re.compile(rb"^[ \t]*v[ \t]+" + rb"[ \t]+".join([_FLOAT] * 3) + rb"(?=[\s])", re.MULTILINE)
_VECTOR = re.compile(rb"^[ \t]*v[tn]?[ \t]+([^\r\n]*)", re.MULTILINE)
_ELEMENT = re.compile(rb"^[ \t]*[flp][ \t]+([^\r\n]*)", re.MULTILINE)
_CORNER = re.compile(rb"(\d{1,9})(?:/(\d{0,9}))?(?:/(\d{0,9}))?(?![\d/])")
_NUMBERS_ONLY = b"0123456789+-.eE \t\r\n"


class _File:
    """One file of a snapshot, for error messages."""

    def __init__(self, snapshot: Snapshot, name: str):
        self.snapshot, self.name, self.data = snapshot, name, snapshot.files[name] + b"\n"

    def refuse(self, what: str, mend: str) -> NoReturn:
        raise BusybotError(f"{self.snapshot.folder / self.name}: {what}", mend)

    def check_text(self) -> None:
        if b"\0" in self.data or _LONG_LINE.search(self.data):
            self.refuse(f"is not text, or a line is longer than {MAX_LINE_BYTES} bytes", "export it again as text")
        if re.search(rb"\\[ \t]*\r?\n", self.data) or b"\x0b" in self.data or b"\x0c" in self.data:
            self.refuse("has line continuations or other unusual breaks", "write every statement on one line")

    def values(self, key: bytes) -> list[str]:
        """What follows `key` on its lines, without repetition."""
        found = re.findall(rb"^[ \t]*" + re.escape(key) + rb"[ \t]+([^\r\n]*)", self.data, re.MULTILINE)
        return list(dict.fromkeys(value.strip().decode("utf-8", "backslashreplace") for value in found))


def check_meshes(snapshot: Snapshot, meshes: tuple[str, ...], textures: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """Check meshes and all that they refer to; errors name the file and the mend.

    Returns:
        Vertices by mesh, (n, 3), mesh units.
    """
    vertices, materials, pictures = dict[str, np.ndarray](), dict[str, None](), dict.fromkeys(textures)
    for name in meshes:
        vertices[name], libraries = _check_obj(_File(snapshot, name))
        materials.update(dict.fromkeys(libraries))
    total = sum(map(len, vertices.values()))
    if total > MAX_OBJECT_VERTICES:
        raise BusybotError(
            f"{snapshot.folder}: {total} vertices are more than the {MAX_OBJECT_VERTICES} allowed",
            "simplify the meshes",
        )
    for name in materials:
        pictures.update(dict.fromkeys(_check_mtl(_File(snapshot, name))))
    for name in pictures:
        _check_texture(_File(snapshot, name))
    return vertices


def _check_obj(file: _File) -> tuple[np.ndarray, list[str]]:
    """The vertices and the material libraries."""
    if len(file.data) > MAX_MESH_BYTES:
        file.refuse(f"{len(file.data)} bytes are more than the {MAX_MESH_BYTES} allowed", "simplify the mesh")
    file.check_text()
    unknown = set(_KEY.findall(file.data)) - _OBJ_KEYS
    if unknown:
        file.refuse(f"has the statement {min(unknown)[:40]!r}", "export it again as a plain polygon mesh")
    vertices = _check_vertices(file)
    _check_elements(file, len(vertices))
    return vertices, [
        file.snapshot.reference(file.name, target, MAX_MATERIAL_BYTES) for target in file.values(b"mtllib")
    ]


def _check_vertices(file: _File) -> np.ndarray:
    found = _VERTEX.findall(file.data)
    count = len(re.findall(rb"^[ \t]*v[ \t]", file.data, re.MULTILINE))
    if count > MAX_VERTICES:
        file.refuse(f"{count} vertices are more than the {MAX_VERTICES} allowed", "simplify the mesh")
    if count != len(found) or any(text.translate(None, _NUMBERS_ONLY) for text in _VECTOR.findall(file.data)):
        file.refuse("a vertex, normal or texture coordinate is not a list of numbers", "export the mesh again")
    try:
        coordinates = np.array(found, dtype=np.float64).reshape(-1, 3)
    except ValueError:
        file.refuse("a vertex has a coordinate that is not a number", "export the mesh again")
    if count and not np.abs(coordinates).max() <= MAX_COORDINATE:
        file.refuse(f"a coordinate is not finite or above {MAX_COORDINATE:g}", "export the mesh again")
    return coordinates


def _check_elements(file: _File, vertices: int) -> None:
    text = b" ".join(_ELEMENT.findall(file.data))
    corners = _CORNER.findall(text)
    if len(corners) > MAX_CORNERS:
        file.refuse(f"{len(corners)} face corners are more than the {MAX_CORNERS} allowed", "simplify the mesh")
    if len(corners) != len(text.split()) or text.translate(None, b"0123456789/ \t"):
        file.refuse("a face has an index that is not a positive number", "export the mesh with absolute indices")
    if not corners:
        file.refuse("has no faces", "remove the mesh from the URDF")
    counts = (
        vertices,
        *(len(re.findall(rb"^[ \t]*" + key + rb"[ \t]", file.data, re.MULTILINE)) for key in (b"vt", b"vn")),
    )
    for column, count, what in zip(zip(*corners, strict=True), counts, ("vertex", "vt", "vn"), strict=True):
        indices = [int(index) for index in set(column) if index]
        if indices and not 1 <= min(indices) <= max(indices) <= count:
            file.refuse(f"a face names {what} {max(indices)} of {count}", "export the mesh again")


def _check_mtl(file: _File) -> list[str]:
    """The textures that the materials name."""
    file.check_text()
    textures: list[str] = []
    for key in sorted(set(_KEY.findall(file.data)) - {b"newmtl"}):
        values = file.values(key)
        if _MTL_TEXTURES.fullmatch(key):
            textures += [file.snapshot.reference(file.name, target, MAX_TEXTURE_BYTES) for target in values]
        elif key not in _MTL_NUMBERS:
            file.refuse(f"has the statement {key[:40]!r}", "keep to colours, shininess and textures")
        elif any(not _finite(value) for value in values):
            file.refuse(f"{key.decode()} is not a list of finite numbers", "export the material again")
    return textures


def _finite(text: str) -> bool:
    try:
        return all(abs(float(part)) <= 1e6 for part in text.split())
    except ValueError:
        return False


def _check_texture(file: _File) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with Image.open(io.BytesIO(file.data), formats=("PNG", "JPEG")) as picture:
                width, height = picture.size
                if width * height > MAX_PIXELS or max(width, height) > 16384:
                    file.refuse(f"{width} x {height} pixels are more than the {MAX_PIXELS} allowed", "make it smaller")
                if picture.format == "JPEG":  # verify() would not notice a cut-off one; an eighth of the size is cheap
                    picture.draft("L", (max(1, width // 8), max(1, height // 8)))
                    picture.load()
                else:
                    picture.verify()
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            file.refuse(f"not a PNG or JPEG picture that can be read: {str(error)[:100]}", "save it again")
