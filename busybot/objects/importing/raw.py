"""A raw PartNet-Mobility folder, as downloaded: URDF, meshes and what the dataset says of them. No annotation yet.

What is read, besides `mobility.urdf` and its meshes:

| file | what of it | when it is absent |
|---|---|---|
| `meta.json` | `model_cat`, the category | the paper's catalogue, by the folder's name; else unknown |
| `semantics.txt` | per line `link joint-kind name` | the links have no names |
| `mobility_v2.json` | names of the parts of each link (`id` 0 is `link_0`) | the links have no parts |
| `bounding_box.json` | `min` and `max`, compared with the meshes | nothing is compared |

Frame: the root joint of a PartNet-Mobility URDF turns the model so that z is up and -x the front.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from busybot.common.errors import BusybotError
from busybot.objects.model import catalogue
from busybot.objects.partnet.annotation import FILE_NAME as ANNOTATION
from busybot.objects.partnet.folder_snapshot import Snapshot, read_snapshot
from busybot.objects.partnet.meshes import check_meshes, material_files
from busybot.objects.partnet.urdf import FILE_NAME as URDF
from busybot.objects.partnet.urdf import Urdf, bounds, link_vertices, parse_urdf

DESCRIPTIONS = ("semantics.txt", "mobility_v2.json", "bounding_box.json", "meta.json")
MAX_BYTES = 1 << 20
MAX_PARTS = 10_000
BOX_TOLERANCE = 0.1
"""Share by which `bounding_box.json` may differ from the meshes without a note."""
IDENTITY = (1.0, 0.0, 0.0, 0.0)
_INSTANCE = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,63}")
_CATEGORY = re.compile(r"[A-Za-z0-9_-]{1,64}")
_WORD = re.compile(r"[^\x00-\x1f\x7f]{1,64}")
_HINT = "download the object again, or remove the file: the rules do without it"


@dataclass(frozen=True, eq=False)
class RawObject:
    """What the rules of `objects.importing.auto_annotation` work on.

    Attributes:
        snapshot: the folder's files.
        meshes: vertices by mesh file, (n, 3).
        category: PartNet-Mobility's category (`StorageFurniture`), None when unknown.
        source: where the category comes from.
        names: by link, what the dataset calls it (`toggle_button`); links without a name are absent.
        parts: by link, the names of its parts.
        notes: what a reviewer should know.
    """

    snapshot: Snapshot
    urdf: Urdf
    meshes: dict[str, np.ndarray]
    category: str | None
    source: str
    names: dict[str, str]
    parts: dict[str, tuple[str, ...]]
    notes: tuple[str, ...]

    @property
    def folder(self) -> Path:
        return self.snapshot.folder

    @property
    def instance(self) -> str:
        """The object's id: the folder's name."""
        return self.folder.name

    def files(self) -> dict[str, bytes]:
        """What a library needs of the folder: URDF, descriptions, meshes, materials, textures."""
        wanted = {URDF, *DESCRIPTIONS, *self.urdf.meshes, *self.urdf.textures}
        wanted |= material_files(self.snapshot, self.urdf.meshes)
        return {name: data for name, data in self.snapshot.files.items() if name in wanted}


def is_raw(folder: Path) -> bool:
    """Whether the folder has a URDF but no annotation."""
    return (folder / URDF).is_file() and not (folder / ANNOTATION).exists()


def read_raw(folder: Path) -> RawObject:
    """Read a raw folder; it may itself be reached through a link, nothing in it may be one.

    Raises:
        BusybotError: a file is missing, malformed, monstrous or leads out of the folder; names file and hint.
    """
    snapshot = read_snapshot(folder.absolute())
    if not _INSTANCE.fullmatch(snapshot.folder.name):
        hint = "rename it: letters, digits, '_', '.', '-', at most 64"
        raise BusybotError(f"{folder}: the folder's name cannot be an id", hint)
    urdf = parse_urdf(snapshot)
    meshes = check_meshes(snapshot, urdf.meshes, urdf.textures)
    vertices = link_vertices(urdf, meshes, IDENTITY, {})
    if not vertices:
        raise BusybotError(f"{folder / URDF}: shows nothing", "download the object again")
    category, source = _category(snapshot)
    low, high = bounds(vertices)
    names, parts = _names(snapshot, urdf), _parts(snapshot)
    return RawObject(snapshot, urdf, meshes, category, source, names, parts, _compare_box(snapshot, high - low))


def _text(snapshot: Snapshot, name: str) -> str | None:
    if name not in snapshot.files:
        return None
    try:
        return snapshot.require(name, MAX_BYTES, _HINT).decode()
    except UnicodeDecodeError:
        snapshot.refuse(name, "is not UTF-8 text", _HINT)


def _json(snapshot: Snapshot, name: str) -> Any:
    text = _text(snapshot, name)
    return None if text is None else snapshot.parse_json(name, text, _HINT)


def _category(snapshot: Snapshot) -> tuple[str | None, str]:
    meta = _json(snapshot, "meta.json")
    if meta is not None:
        found = meta.get("model_cat") if isinstance(meta, dict) else None
        if not isinstance(found, str) or not _CATEGORY.fullmatch(found):
            snapshot.refuse("meta.json", "has no category in `model_cat`", _HINT)
        return found, "meta.json"
    known = {entry.category for entry in catalogue().values() if entry.instance == snapshot.folder.name}
    return (known.pop(), "the paper's catalogue") if len(known) == 1 else (None, "nothing names it")


def _names(snapshot: Snapshot, urdf: Urdf) -> dict[str, str]:
    names: dict[str, str] = {}
    for number, line in enumerate((_text(snapshot, "semantics.txt") or "").splitlines(), 1):
        words = line.split(maxsplit=2)
        if not words:
            continue
        if len(words) != 3 or any(not _WORD.fullmatch(word) for word in words):
            snapshot.refuse("semantics.txt", f"line {number} is not of the form `link joint-kind name`", _HINT)
        if words[0] not in urdf.visuals:
            snapshot.refuse("semantics.txt", f"line {number} names {words[0]!r}, which the URDF does not have", _HINT)
        names[words[0]] = words[2]
    return names


def _parts(snapshot: Snapshot) -> dict[str, tuple[str, ...]]:
    links = _json(snapshot, "mobility_v2.json")
    if links is None:
        return {}
    if not isinstance(links, list) or not all(isinstance(link, dict) for link in links):
        snapshot.refuse("mobility_v2.json", "is not a list of links", _HINT)
    parts: dict[str, tuple[str, ...]] = {}
    for number, link in enumerate(links):
        if not isinstance(link.get("id"), int):
            snapshot.refuse("mobility_v2.json", f"entry {number} has no id", _HINT)
        parts[f"link_{link['id']}"] = tuple(dict.fromkeys(_part_names(snapshot, link.get("parts"))))
    return parts


def _part_names(snapshot: Snapshot, parts: Any) -> Iterator[str]:
    """Names of parts and of the parts within them, breadth first."""
    waiting, seen = [parts], 0
    while waiting:
        group = waiting.pop(0) or []
        if not isinstance(group, list) or not all(isinstance(part, dict) for part in group):
            snapshot.refuse("mobility_v2.json", "has parts that are not a list of parts", _HINT)
        seen += len(group)
        if seen > MAX_PARTS:
            snapshot.refuse("mobility_v2.json", f"a link has more than {MAX_PARTS} parts", _HINT)
        for part in group:
            if isinstance(part.get("name"), str) and _WORD.fullmatch(part["name"]):
                yield part["name"]
            waiting.append(part.get("children"))


def _compare_box(snapshot: Snapshot, size: np.ndarray) -> tuple[str, ...]:
    """A note when `bounding_box.json` and the meshes disagree; the rules use the meshes."""
    value = _json(snapshot, "bounding_box.json")
    if value is None:
        return ()
    try:
        box = np.array([value["min"], value["max"]], dtype=np.float64)
        right = box.shape == (2, 3) and bool(np.isfinite(box).all())
    except (TypeError, ValueError, KeyError, IndexError, OverflowError):
        right = False
    if not right:
        snapshot.refuse("bounding_box.json", "has no `min` and `max` of three numbers each", _HINT)
    # PartNet's axes are those of the URDF in another order
    told, found = np.sort(box[1] - box[0]), np.sort(size)
    if np.abs(told - found).max() <= BOX_TOLERANCE * found.max():
        return ()
    return (f"bounding_box.json says {told.round(3).tolist()}, the meshes measure {found.round(3).tolist()}",)
