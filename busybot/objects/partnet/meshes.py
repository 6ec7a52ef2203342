"""Fast checks of OBJ meshes, their materials and textures, on bytes already read.

A loader would follow `mtllib` and `map_*` anywhere and allocate what the files claim; here every reference must stay in
the folder, every number be finite, every index exist and every size be sane. Statements outside the plain polygon
subset of OBJ and the usual ones of MTL are refused, so what was checked is what a loader sees.
"""

import io
import re
import warnings
from functools import cached_property
from typing import NoReturn

import numpy as np
from PIL import Image

from busybot.common.errors import BusybotError
from busybot.objects.partnet.folder_snapshot import Snapshot

MAX_MESH_BYTES = 16 << 20
MAX_TEXTURE_BYTES = 32 << 20
MAX_MATERIAL_BYTES = 1 << 20
MAX_VERTICES = 200_000
MAX_OBJECT_VERTICES = 1_000_000
MAX_CORNERS = 1_000_000
MAX_COORDINATE = 1e4
MAX_PIXELS = 4096 * 4096
MAX_LINE_BYTES = 1 << 16
MAX_LINES = 2_000_000
MAX_KEYS = 64

_MTL_NUMBERS = frozenset(b"Ka Kd Ks Ke Tf Ns Ni d Tr illum sharpness Pr Pm Ps Pc Pcr aniso anisor".split())
_MTL_TEXTURES = re.compile(rb"(map_\w{1,16}|bump|disp|decal|refl|norm)", re.IGNORECASE)
_KEY = re.compile(rb"\n([^\s#]\S*)")
# patterns begin with a line feed, which the regular expression engine finds fast
_FOREIGN = re.compile(rb"\n(?!(?:v|vn|vt|f|l|p|o|g|s|usemtl|mtllib)[ \t\r\n]|#|\r?\n|\Z)(\S*)")
_NUMBERS_ONLY = b"0123456789+-.eE \t\r\n"
_INDICES_ONLY = b"0123456789/ \t\r\n"
_UNUSUAL_BREAK = re.compile(rb"\\[ \t]*\r?\n|[\x00\x0b\x0c]|\r(?!\n)")


class _File:
    """One file of a snapshot, for error messages."""

    def __init__(self, snapshot: Snapshot, name: str):
        self.snapshot, self.name = snapshot, name
        self.raw = snapshot.files[name]

    @cached_property
    def data(self) -> bytes:
        """The text with every line beginning after a line feed, without indentation."""
        return re.sub(rb"\n[ \t]+", b"\n", b"\n" + self.raw + b"\n")

    def refuse(self, what: str, hint: str) -> NoReturn:
        self.snapshot.refuse(self.name, what, hint)

    def check_text(self) -> None:
        breaks = np.flatnonzero(np.frombuffer(self.data, np.uint8) == ord("\n"))
        if len(breaks) > MAX_LINES:
            self.refuse(f"{len(breaks)} lines are more than the {MAX_LINES} allowed", "simplify it")
        if len(breaks) > 1 and np.diff(breaks).max() > MAX_LINE_BYTES:
            self.refuse(f"a line is longer than {MAX_LINE_BYTES} bytes", "export it again as text")
        if _UNUSUAL_BREAK.search(self.data):
            self.refuse("is not text, or has line continuations or other unusual breaks", "export it again as text")

    def lines(self, key: bytes) -> list[bytes]:
        """What follows `key` on each of its lines."""
        return re.findall(rb"\n" + key + rb"[ \t]+([^\r\n]*)", self.data)

    def values(self, key: bytes) -> list[str]:
        """What follows `key` on its lines, without repetition."""
        found = dict.fromkeys(self.lines(re.escape(key)))
        return [value.strip().decode("utf-8", "backslashreplace") for value in found]

    def libraries(self) -> list[str]:
        """The material libraries that a mesh names."""
        return [self.snapshot.reference(self.name, target, MAX_MATERIAL_BYTES) for target in self.values(b"mtllib")]


def check_meshes(snapshot: Snapshot, meshes: tuple[str, ...], textures: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """Check meshes and all that they refer to; errors name the file and the hint.

    Returns:
        Vertices by mesh, (n, 3), mesh units.
    """
    vertices, pictures = dict[str, np.ndarray](), dict.fromkeys(textures)
    # also those that no mesh names: a loader that misses a library may try the one beside the mesh
    materials = dict.fromkeys(name for name in snapshot.files if name.lower().endswith(".mtl"))
    for name in meshes:
        vertices[name], libraries = _check_obj(_File(snapshot, name))
        materials.update(dict.fromkeys(libraries))
    total = sum(map(len, vertices.values()))
    if total > MAX_OBJECT_VERTICES:
        what = f"{total} vertices are more than the {MAX_OBJECT_VERTICES} allowed"
        raise BusybotError(f"{snapshot.folder}: {what}", "simplify the meshes")
    for name in materials:
        pictures.update(dict.fromkeys(_check_mtl(_File(snapshot, name))))
    for name in pictures:
        _check_texture(_File(snapshot, name))
    return vertices


def material_files(snapshot: Snapshot, meshes: tuple[str, ...]) -> set[str]:
    """The material libraries and textures that these meshes, already checked, refer to."""
    libraries = {library for name in meshes for library in _File(snapshot, name).libraries()}
    return libraries.union(*(_check_mtl(_File(snapshot, name)) for name in libraries))


def _check_obj(file: _File) -> tuple[np.ndarray, list[str]]:
    """The vertices and the material libraries."""
    file.snapshot.require(file.name, MAX_MESH_BYTES, "simplify the mesh")
    file.check_text()
    foreign = _FOREIGN.search(file.data)
    if foreign:
        file.refuse(f"has the statement {foreign[1][:40]!r}", "export it again as a plain polygon mesh")
    vertices = _check_vertices(file)
    _check_elements(file, len(vertices))
    return vertices, file.libraries()


def _check_vertices(file: _File) -> np.ndarray:
    lines = file.lines(b"v")
    if len(lines) > MAX_VERTICES:
        file.refuse(f"{len(lines)} vertices are more than the {MAX_VERTICES} allowed", "simplify the mesh")
    values = _numbers(b"\n".join(lines))
    others = [_numbers(b"\n".join(file.lines(key))) for key in (b"vt", b"vn")]
    plain = all(other is not None for other in others)
    # three coordinates, perhaps a weight or a colour, and on every line the same: else rows would slip
    widths = {len(line.split()) for line in lines}
    if values is None or not plain or len(widths) > 1 or not widths <= {3, 4, 6, 7}:
        file.refuse("a vertex, normal or texture coordinate is not a list of numbers", "export the mesh again")
    for array in (values, *others):
        if array is not None and array.size and not np.abs(array).max() <= MAX_COORDINATE:
            file.refuse(f"a coordinate is not finite or above {MAX_COORDINATE:g}", "export the mesh again")
    return values.reshape(len(lines), -1)[:, :3] if lines else values.reshape(0, 3)


def _numbers(text: bytes) -> np.ndarray | None:
    """White-space separated plain numbers; None if something else is among them."""
    if text.translate(None, _NUMBERS_ONLY):
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            values = np.fromstring(text.decode("ascii"), dtype=np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            return None
    return values if values.size == len(text.split()) else None


def _check_elements(file: _File, vertices: int) -> None:
    counts = (vertices, len(file.lines(b"vt")), len(file.lines(b"vn")))
    total = 0
    for key in (b"f", b"l", b"p"):
        text = b"\n".join(file.lines(key))
        corners = len(text.split())
        total += corners
        if total > MAX_CORNERS:
            file.refuse(f"{total} face corners are more than the {MAX_CORNERS} allowed", "simplify the mesh")
        if key == b"f" and not corners:
            file.refuse("has no faces", "remove the mesh from the URDF")
        if corners:
            _check_indices(file, _indices(text, corners), counts)


def _check_indices(file: _File, indices: np.ndarray | None, counts: tuple[int, int, int]) -> None:
    if indices is None:
        file.refuse("a face has something else than positive indices, all of one form", "export the mesh again")
    for column, count, what in zip(indices.T, counts, ("vertex", "vt", "vn"), strict=False):
        least = 1 if what == "vertex" else 0  # 0 stands for an index left out, as in 1//2
        if column.min() < least or column.max() > count:
            file.refuse(f"a face names {what} {column.max()} of {count}", "export the mesh again")


def _indices(text: bytes, corners: int) -> np.ndarray | None:
    """Face corners as (corners, 1 to 3): vertex, texture coordinate, normal. None for any other form."""
    if text.translate(None, _INDICES_ONLY) or re.search(rb"/\d*/\d*/|/0", text):
        return None
    slashes = text.count(b"/")
    if slashes not in (0, corners, 2 * corners) or (slashes == corners and re.search(rb"/\d*/", text)):
        return None
    values = _numbers(text.replace(b"//", b" 0 ").replace(b"/", b" "))
    per_corner = 1 + slashes // corners
    if values is None or values.size != corners * per_corner or values.max() > MAX_CORNERS:
        return None
    return values.reshape(corners, per_corner).astype(np.int64)


def _check_mtl(file: _File) -> list[str]:
    """The textures that the materials name."""
    file.check_text()
    textures: list[str] = []
    keys = sorted(set(_KEY.findall(file.data)) - {b"newmtl"})
    if len(keys) > MAX_KEYS:
        file.refuse(f"has {len(keys)} kinds of statements", "keep to colours, shininess and textures")
    for key in keys:
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
            with Image.open(io.BytesIO(file.raw), formats=("PNG", "JPEG")) as picture:
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
