"""Many objects together: a folder `Category/instance/...` with the split that says who may train on what.

Splits and sampling weights come from `data.json` in the library's folder (section `Reason`: category -> `train` and
`test` lists, in which a repeated id weighs more, and `other`, which no split draws from), else from the packaged
catalogue of the paper's objects.
"""

import hashlib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from busybot.common.atomic_io import read_json
from busybot.common.errors import BusybotError
from busybot.objects.model import CATEGORIES, SPLITS, ObjectModel, catalogue
from busybot.objects.partnet.loader import load_object

SPLIT_FILE = "data.json"
OTHER = "other"
"""In place of a split: objects that only scenes have (`boards.scenes`)."""
LISTS = {"train": "train", "novel": "test", OTHER: OTHER}
"""Which list of `data.json` has the objects of a split."""
MAX_OBJECTS = 10_000
_HINT = "name a folder with Switch, Lamp, Door and Toy folders in it"
_SHAPE = '{"Reason": {"Switch": {"train": ["100366"], "test": []}}}'


@dataclass(frozen=True)
class Library:
    """Objects and their splits.

    Attributes:
        name: `procedural`, or the folder's name.
        folder: where it lies.
        objects: by key (`Category/instance`), sorted.
        splits: for `train` and `novel`, and `other` if there are any, the sampling weight by key.
    """

    name: str
    folder: Path
    objects: dict[str, ObjectModel]
    splits: dict[str, dict[str, float]]

    @staticmethod
    def load(path: Path, known: dict[str, ObjectModel] | None = None) -> "Library":
        """Read a library; an unreadable object, or one that no split knows, is refused by name.

        Args:
            known: objects that need not be parsed again, see `load_object`.
        """
        folders = object_folders(path)
        objects = {key: load_as(key, folder, known) for key, folder in folders.items()}
        return Library(path.resolve().name, path, objects, read_splits(path, objects))

    @property
    def sha256(self) -> str:
        """Hash over the objects' keys and hashes."""
        lines = "".join(f"{key} {sha256}\n" for key, sha256 in self.hashes().items())
        return hashlib.sha256(lines.encode()).hexdigest()

    def hashes(self) -> dict[str, str]:
        """sha256 by key."""
        return {key: model.sha256 for key, model in self.objects.items()}

    def get(self, key: str) -> ObjectModel:
        """The object, or a `BusybotError` that names it."""
        if key not in self.objects:
            raise BusybotError(f"{self.folder}: has no object {key!r}", "`busybot assets list` shows what there is")
        return self.objects[key]

    def weights(self, split: str, category: str) -> list[tuple[str, float]]:
        """Keys of a category in a split (`train` or `novel`) with their sampling weights, sorted by key."""
        if split not in self.splits:
            raise BusybotError(f"no split {split!r}", f"use one of {', '.join(self.splits)}")
        return [(key, weight) for key, weight in self.splits[split].items() if key.split("/")[0] == category]


def object_folders(path: Path) -> dict[str, Path]:
    """Object folders by key. Links, and files where folders belong, are refused; what lies beside is ignored."""
    if not path.is_dir():
        raise BusybotError(f"{path}: not a folder", _HINT)
    found = {}
    for category in sorted(CATEGORIES):
        place = path / category
        entries = [place, *sorted(place.iterdir())] if place.is_dir() else [place]
        for entry in entries:
            if entry.is_symlink():
                raise BusybotError(f"{entry}: is a link; links in a library are not followed", "copy the folder itself")
            if entry.exists() and not entry.is_dir() and "." not in entry.name:  # else somebody's notes
                raise BusybotError(f"{entry}: not a folder, where one belongs", "remove it, or copy the objects again")
        found.update({f"{category}/{entry.name}": entry for entry in entries[1:] if entry.is_dir()})
    if not found:
        raise BusybotError(f"{path}: holds no objects", _HINT)
    if len(found) > MAX_OBJECTS:
        what = f"{len(found)} objects are more than the {MAX_OBJECTS} allowed"
        raise BusybotError(f"{path}: {what}", "divide the library")
    return found


def load_as(key: str, folder: Path, known: dict[str, ObjectModel] | None = None) -> ObjectModel:
    """Read the object that a library calls `key`; an annotation with another name is refused."""
    model = load_object(folder, known)
    if model.key != key:
        what = f"its annotation calls it {model.key}, its folder {key}"
        raise BusybotError(f"{folder}: {what}", "rename the folder or correct the file")
    return model


def read_splits(path: Path, keys: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Weights by split and key; keys that neither `data.json` nor the catalogue knows are refused."""
    listed = read_split_file(path / SPLIT_FILE) if (path / SPLIT_FILE).exists() else {}
    splits: dict[str, dict[str, float]] = {split: {} for split in SPLITS}
    unknown = []
    for key in sorted(keys):
        if key in listed:
            for split, weight in listed[key].items():
                splits.setdefault(split, {})[key] = float(weight)
        elif known := catalogue().get(key):
            splits[known.split][key] = float(known.weight)
        else:
            unknown.append(key)
    if unknown:
        named = f"{', '.join(unknown[:5])}{' and others' if len(unknown) > 5 else ''}"
        hint = f"list the ids in {path / SPLIT_FILE}, for example {_SHAPE}"
        raise BusybotError(f"{path}: neither {SPLIT_FILE} nor the catalogue puts {named} in a split", hint)
    return splits


def read_split_file(path: Path) -> dict[str, Counter[str]]:
    """How often each key stands in each split."""
    if path.is_symlink() or not path.is_file():
        raise BusybotError(f"{path}: not a regular file", "copy the file itself")
    hint = f"write it like {_SHAPE}"
    value = read_json(path, max_bytes=1 << 20)
    section = value.get("Reason") if isinstance(value, dict) else None
    if not isinstance(section, dict):
        raise BusybotError(f"{path}: has no section 'Reason'", hint)
    counts: dict[str, Counter[str]] = {}
    for category, lists in section.items():
        for split, name in LISTS.items():
            ids = lists.get(name, []) if isinstance(lists, dict) else None
            if not isinstance(ids, list) or not all(isinstance(instance, str) for instance in ids):
                raise BusybotError(f"{path}: Reason.{category}.{name} is not a list of ids", hint)
            for instance in ids:
                counts.setdefault(f"{category}/{instance}", Counter())[split] += 1
    return counts
