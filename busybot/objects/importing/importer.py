"""Raw PartNet-Mobility objects become a library: annotated by rules and overrides, copied, put in a split.

An object's folder is built beside its place and renamed into it. The split file names the object before its folder
appears, and under a former category until that folder is gone: at any moment the library can be read, though without an
object that is just being replaced. Imports into one library take turns, object by object. The same import again changes
nothing.
"""

import json
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from busybot.common.atomic_io import (
    in_turn,
    inside,
    make_folder,
    read_json,
    remove_abandoned,
    rename,
    unfinished,
    write_json,
    write_new,
)
from busybot.common.errors import BusybotError
from busybot.objects.importing.annotation_edits import Choices, Overrides
from busybot.objects.importing.auto_annotation import RULES_VERSION, AutoAnnotation, decide, moving_links
from busybot.objects.importing.raw import RawObject, read_raw
from busybot.objects.library import LISTS, MAX_OBJECTS, OTHER, SPLIT_FILE, read_split_file
from busybot.objects.model import CATEGORIES, ObjectModel, Split, catalogue
from busybot.objects.partnet.annotation import FILE_NAME
from busybot.objects.partnet.folder_snapshot import Snapshot, read_snapshot
from busybot.objects.partnet.loader import parse_object
from busybot.objects.partnet.urdf import FILE_NAME as URDF

MAX_SPLIT_BYTES = 1 << 20
_WORK = "import"


@dataclass(frozen=True)
class ImportOutcome:
    """What became of one raw folder.

    Attributes:
        name: the folder's name.
        key: the object's name in the library; None when it cannot be used or was left out.
        choices: how it is annotated; None when it cannot be used.
        notes: why the rules decided so.
        questions: what they doubt.
        split: where it was put; None when nothing was written.
        done: `imported`, `unchanged`, `proposed`, `left out` or `refused`.
        problem, hint: why it is refused.
    """

    name: str
    done: str
    key: str | None = None
    choices: Choices | None = None
    notes: tuple[str, ...] = ()
    questions: tuple[str, ...] = ()
    split: str | None = None
    problem: str | None = None
    hint: str | None = None


def raw_folders(paths: Sequence[Path]) -> list[Path]:
    """Raw objects' folders: each path is one, or holds some.

    Raises:
        BusybotError: a path is neither, or two folders have the same name.
    """
    found = [folder for path in paths for folder in _expand(path)]
    names = [folder.name for folder in found]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise BusybotError(f"{twice}: two folders have this name, which is the object's id", "import one of them")
    if len(found) > MAX_OBJECTS:
        raise BusybotError(f"{len(found)} objects are more than the {MAX_OBJECTS} allowed", "import them in parts")
    return found


def _expand(path: Path) -> list[Path]:
    folder = path.absolute()
    if not folder.is_dir():
        raise BusybotError(f"{path}: not a folder", "name a raw object's folder, or a folder of them")
    if (folder / URDF).exists():
        return [folder]
    found = [entry for entry in sorted(folder.iterdir()) if not entry.is_symlink() and (entry / URDF).is_file()]
    if not found:
        hint = "name a raw object's folder, or a folder of them"
        raise BusybotError(f"{path}: holds no {URDF}, nor do its folders", hint)
    return found


def import_objects(
    folders: Sequence[Path],
    out: Path | None,
    overrides: Overrides | None = None,
    split: Split | None = None,
    replace: bool = False,
) -> Iterator[ImportOutcome]:
    """Annotate raw folders one after the other and put them into a library.

    Args:
        out: the library's folder, made when absent. None only proposes.
        overrides: what a reviewer decided.
        split: where the objects go. None: the paper's objects to the paper's split, others to `train`.
        replace: whether an object that the library has with other content is replaced.

    Yields:
        An outcome for each folder; what cannot be used is refused with its reason and does not stop the others.

    Raises:
        BusybotError: the library cannot be written, or its split file is damaged.
    """
    if out is not None:
        _check_library(out)
        with in_turn(out) if out.is_dir() else nullcontext():
            remove_abandoned(out, _WORK, lambda left: _tidy(out, left))
    for folder in folders:
        try:
            yield _import(folder, out, overrides or Overrides(None, {}, {}), split, replace)
        except BusybotError as error:
            yield ImportOutcome(folder.name, "refused", problem=error.what, hint=error.hint)


def _check_library(out: Path) -> None:
    for folder in (out, *(out / category for category in CATEGORIES)):
        if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
            raise BusybotError(f"{folder}: is a link or a file", "name a library's folder, or one to make")
    if (out / URDF).exists():
        raise BusybotError(f"{out}: is an object's folder, not a library's", "name another folder")
    _read_splits(out)


def _import(folder: Path, out: Path | None, overrides: Overrides, split: Split | None, replace: bool) -> ImportOutcome:
    given = overrides.choices.get(folder.name, Choices())
    if not given.use:
        return ImportOutcome(folder.name, "left out")
    if (folder / FILE_NAME).exists():
        raise BusybotError(f"{folder}: is annotated already", "copy it into the library, or remove its annotation")
    raw = read_raw(folder)
    if folder.name in overrides.choices:
        overrides.check_names(folder.name, [moving.link for moving in moving_links(raw)], raw.urdf)
    decision = decide(raw, given)
    annotated, model = annotate(raw, decision, given)
    told = (model.key, decision.choices, decision.notes, decision.questions)
    if out is None:
        return ImportOutcome(folder.name, "proposed", *told)
    with in_turn(out):
        new, chosen = _place(annotated, out, model, replace, split)
    return ImportOutcome(folder.name, "imported" if new else "unchanged", *told, chosen)


def annotate(raw: RawObject, decision: AutoAnnotation, given: Choices | None = None) -> tuple[Snapshot, ObjectModel]:
    """The annotated folder in memory, and the object that it is.

    Raises:
        BusybotError: the annotated object is not one that `load_object` would read.
    """
    text = json.dumps(_annotation(raw, decision, given or Choices()), indent=1, sort_keys=True) + "\n"
    snapshot = Snapshot(raw.folder, dict(sorted((raw.files() | {FILE_NAME: text.encode()}).items())))
    return snapshot, parse_object(snapshot)


def _annotation(raw: RawObject, decision: AutoAnnotation, given: Choices) -> dict[str, Any]:
    """`object_meta_info.json`. Beyond the authors' fields, `Import` says what decided."""
    choices = decision.choices
    assert choices.category is not None and choices.scale is not None and choices.orientation is not None
    joints = {joint.child: (number, joint) for number, joint in enumerate(raw.urdf.joints)}
    links = choices.links or {}
    return {
        "Category": choices.category,
        "InstanceId": raw.instance,
        "Scale": choices.scale,
        "Movable_link": {
            link: {
                "link_id": link,
                "link_name": raw.names.get(link, ""),
                "joint_type": "slider" if joints[link][1].type == "prismatic" else "hinge",
            }
            for link in links
        },
        "Orientation": list(choices.orientation),
        "MinBBox": [round(value, 6) for value in decision.low],
        "MaxBBox": [round(value, 6) for value in decision.high],
        "Offset_z": round(-choices.scale * decision.low[2], 6),
        "Direction": [list(direction) for direction in choices.directions] if choices.directions else None,
        "Effect": _effect(raw, choices),
        "Cause": [
            {
                "JointId": joints[link][0],
                "IsSmallCause": int(kind == "two-state"),
                "IsLargeCause": int(kind == "multi-direction"),
            }
            for link, kind in links.items()
        ],
        "Import": {
            "category": raw.category,
            "rules": RULES_VERSION,
            "overrides": sorted(name for name in given.model_fields_set if name != "use"),
        },
    }


def _effect(raw: RawObject, choices: Choices) -> list[dict[str, Any]]:
    effect = choices.effect
    if effect is None:
        return []
    numbers = {joint.name: number for number, joint in enumerate(raw.urdf.joints)}
    painted = next((number for number, joint in enumerate(raw.urdf.joints) if joint.child == effect.link), None)
    alpha = [1.0] if effect.type == "color" else []
    return [
        {
            "Type": "link" if effect.type == "color" else "joint",
            "JointId": [numbers[joint] for joint in effect.joints] or None,
            "LinkId": painted,
            "IsSingleEffect": int(effect.states is not None),
            "IsMultiEffect": int(effect.steps is not None),
            "States": [[*value, *alpha] for value in effect.states] if effect.states else None,
            "Steps": [[*value, *alpha] for value in effect.steps] if effect.steps else None,
        }
    ]


def _place(snapshot: Snapshot, out: Path, model: ObjectModel, replace: bool, split: Split | None) -> tuple[bool, str]:
    """Write the object's folder under its final name, whole, and list it.

    Returns:
        Whether it was written (not when the library has the same already), and its split.
    """
    place = out / model.key
    present = [folder for category in CATEGORIES if (folder := out / category / model.instance).is_dir()]
    if present == [place] and _same(place, snapshot):
        return False, _list(out, model, split)
    if present and not replace:
        there = present[0].relative_to(out)
        raise BusybotError(f"{out}: has another {there} already", "import with --replace, or name another library")
    make_folder(out)
    with unfinished(out, _WORK) as temporary:
        made = temporary / "made" / model.key
        for name, data in snapshot.files.items():
            write_new(made / name, data, out)
        try:
            chosen = _list(out, model, split, {folder.parent.name for folder in present})
            for former in present:
                rename(former, temporary / "former" / former.relative_to(out), out)
            rename(made, place, out)
        finally:
            _tidy(out, temporary)
    return True, chosen


def _tidy(out: Path, work: Path) -> None:
    """After an import, whole or broken off: what it moved away, but did not replace, returns to the library.

    The split file then names the import's object where its folder is.
    """
    for kept in sorted((work / "former").glob("*/*")):
        if not any((out / category / kept.name).exists() for category in CATEGORIES):
            rename(inside(out, str(kept.relative_to(out))), out / kept.relative_to(work / "former"), out)
    for instance in {folder.name for part in ("made", "former") for folder in (work / part).glob("*/*")}:
        _unlist(out, instance)


def _same(place: Path, snapshot: Snapshot) -> bool:
    try:
        return read_snapshot(place).files == snapshot.files
    except BusybotError:
        return False


def _list(out: Path, model: ObjectModel, split: Split | None, kept: Collection[str] = ()) -> str:
    """Name the object in the split file; what the file says of it stays, unless `split` is given.

    Args:
        kept: other categories in whose lists it stays; from all others it is removed.
    """
    value, counts = _read_splits(out)
    listed = counts.get(model.key)
    known = catalogue().get(model.key)
    usual = known.split if known else "train"
    chosen: str = split or (next(iter(listed)) if listed else usual)
    for category in CATEGORIES:
        here = value["Reason"].setdefault(category, {})
        for name_of_split, name in LISTS.items():
            ids = here.get(name, []) if name_of_split == OTHER else here.setdefault(name, [])
            if category == model.category and name_of_split == chosen:
                if model.instance not in ids:
                    ids += [model.instance] * (known.weight if known else 1)
            elif category == model.category or category not in kept:
                ids[:] = [instance for instance in ids if instance != model.instance]
    write_json(out / SPLIT_FILE, value)
    return chosen


def _unlist(out: Path, instance: str) -> None:
    """Drop an object that has a folder from the lists of the categories that it has none in."""
    value, counts = _read_splits(out)
    homes = [category for category in CATEGORIES if (out / category / instance).is_dir()]
    left = [category for category in CATEGORIES if category not in homes and f"{category}/{instance}" in counts]
    if homes and left:
        for category in left:
            for name in LISTS.values():
                ids = value["Reason"][category].get(name, [])
                ids[:] = [other for other in ids if other != instance]
        write_json(out / SPLIT_FILE, value)


def _read_splits(out: Path) -> tuple[dict[str, Any], dict[str, Counter[str]]]:
    """The split file's content, and how often it lists each object in each split."""
    path = out / SPLIT_FILE
    if not path.exists() and not path.is_symlink():
        return {"Reason": {}}, {}
    counts = read_split_file(path)
    return read_json(path, MAX_SPLIT_BYTES), counts
