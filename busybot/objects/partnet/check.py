"""Checks every object of a library and lists its faults, however many are bad.

Of a bad object everything is told that can be found separately: each field of the annotation, the first fault of the
URDF, each mesh. Bad is also an object that can be read, but of which nobody would ever see anything move.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from pydantic import ValidationError

from busybot.common.errors import BusybotError
from busybot.objects.importing.annotation_edits import Choices
from busybot.objects.importing.auto_annotation import decide
from busybot.objects.importing.raw import is_raw, read_raw
from busybot.objects.library import SPLIT_FILE, load_as, object_folders, read_split_file, read_splits
from busybot.objects.model import CATEGORIES, ObjectModel
from busybot.objects.partnet.annotation import FILE_NAME, annotation_faults, annotation_values, equal_values
from busybot.objects.partnet.folder_snapshot import read_snapshot
from busybot.objects.partnet.loader import load_object
from busybot.objects.partnet.meshes import check_meshes
from busybot.objects.partnet.reach import out_of_reach
from busybot.objects.partnet.urdf import parse_urdf

_IMPORT = "busybot assets import {} --out LIBRARY"


@dataclass(frozen=True)
class Finding:
    """A verdict on one object, or on the library's split file: `problem` is None when nothing is wrong.

    A bad object has a finding for each of its problems. `question` is what its import doubted and nobody answered.
    """

    name: str
    problem: str | None = None
    hint: str | None = None
    question: str | None = None

    @property
    def ok(self) -> bool:
        return self.problem is None


def check_objects(path: Path) -> list[Finding]:
    """Read a library, a single object's folder, or a folder of raw objects, object by object.

    Raises:
        BusybotError: `path` is none of these.
    """
    if (path / FILE_NAME).exists() or (path / "mobility.urdf").exists():
        return _verdict(path.absolute().name, None, path)
    raw = _raw_beside(path)
    folders = object_folders(path) if not raw or any((path / category).is_dir() for category in CATEGORIES) else {}
    findings = [finding for key, folder in folders.items() for finding in _verdict(key, key, folder)]
    findings += [finding for folder in raw for finding in _verdict(folder.name, None, folder)]
    try:
        read_splits(path, {key: folder for key, folder in folders.items() if not is_raw(folder)})
        listed = set(read_split_file(path / SPLIT_FILE)) if (path / SPLIT_FILE).exists() else set()
    except BusybotError as error:
        return [*findings, Finding(SPLIT_FILE, error.what, error.hint)]
    findings += [
        Finding(key, f"{path / SPLIT_FILE}: lists it, but there is no such folder", "add the folder or drop the id")
        for key in sorted(listed - set(folders))
    ]
    return findings


def _raw_beside(path: Path) -> list[Path]:
    """Raw objects that lie directly in the folder, where a library has its categories."""
    if not path.is_dir():
        return []
    return [entry for entry in sorted(path.iterdir()) if not entry.is_symlink() and entry.is_dir() and is_raw(entry)]


def _verdict(name: str, key: str | None, folder: Path) -> list[Finding]:
    try:
        if is_raw(folder):
            read_raw(folder)
            return [Finding(name, f"{folder}: is raw: it has no {FILE_NAME}", _IMPORT.format(quote(str(folder))))]
        model = load_object(folder) if key is None else load_as(key, folder)
    except BusybotError as error:
        others = {fault.what: fault for fault in _faults(folder) if fault.what != error.what}
        return [Finding(name, fault.what, fault.hint) for fault in (error, *others.values())]
    idle = [Finding(name, f"{folder / FILE_NAME}: {what}", hint) for what, hint in _idle(model)]
    return idle or _questions(name, folder, model) or [Finding(name)]


def _idle(model: ObjectModel) -> Iterator[tuple[str, str]]:
    """Why nothing would ever be seen to move of an object that can be read, each with what to do."""
    if model.effect is not None:
        for name, values in (("States", model.effect.single), ("Steps", model.effect.multi)):
            if alike := equal_values(name, values or ()):
                again = "`busybot assets import --replace` does so with what version 0.1 imported"
                yield f"Effect: {alike}", f"give each another value; {again}"
    if model.role != "trigger":
        return
    snapshot = read_snapshot(model.folder)
    urdf = parse_urdf(snapshot)
    meshes, joints = check_meshes(snapshot, urdf.meshes), {joint.name: joint for joint in urdf.joints}
    for link in model.trigger_links:
        found = out_of_reach(urdf, meshes, joints[link.joint], link.states, model.scale)
        if found is not None:
            what, scale = found
            yield f"Scale: {what}", f"make Scale {scale} or less, or give {link.joint} less travel in mobility.urdf"
    if not model.directions:
        hint = "name the directions in which its links yield, as docs/extending/add-an-object.md has it"
        yield "Direction: names none, so that strict mode refuses every action on this trigger", hint


def _questions(name: str, folder: Path, model: ObjectModel) -> list[Finding]:
    """What the rules doubted when they annotated the object, if it still is as they chose."""
    value = annotation_values(read_snapshot(folder.absolute()))
    told = value.get("Import")
    overrides = told.get("overrides") if isinstance(told, dict) else None
    if not isinstance(overrides, list) or "orientation" in overrides:
        return []
    links = {link.name: link.kind for link in model.trigger_links}
    try:
        given = Choices.model_validate({"category": model.category, "scale": model.scale, "links": links or None})
        decision = decide(read_raw(folder), given)
    except (ValidationError, BusybotError):  # a Door that is a trigger, files that a board does not read: no import's
        return []
    if decision.choices.orientation != tuple(value["Orientation"]):
        return []
    hint = "answer it in the file of `busybot assets import RAW --review`, and import with --overrides and --replace"
    return [Finding(name, question=question, hint=hint) for question in decision.questions]


def _faults(folder: Path) -> Iterator[BusybotError]:
    """What can be found wrong with a folder's parts one by one."""
    try:
        snapshot = read_snapshot(folder.absolute())
    except BusybotError:
        return
    if is_raw(folder):
        yield BusybotError(
            f"{folder}: is raw: it has no {FILE_NAME}", f"when it is sound, {_IMPORT.format(quote(str(folder)))}"
        )
    else:
        yield from annotation_faults(snapshot)
    try:
        meshes = parse_urdf(snapshot).meshes
    except BusybotError as error:
        yield error
        return
    for mesh in meshes:
        try:
            check_meshes(snapshot, (mesh,))
        except BusybotError as error:
            yield error
