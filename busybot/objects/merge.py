"""Puts the objects of several libraries into a new one."""

from collections.abc import Sequence
from pathlib import Path

from busybot.common.atomic_io import (
    make_folder,
    refuse_taken,
    remove_abandoned,
    rename,
    unfinished,
    write_json,
    write_new,
)
from busybot.common.errors import BusybotError
from busybot.objects.library import LISTS, MAX_OBJECTS, SPLIT_FILE, Library
from busybot.objects.partnet.folder_snapshot import read_snapshot


def merge_libraries(libraries: Sequence[Library], out: Path) -> None:
    """Copy all objects into a new folder; it is there whole or not at all. An object that several have is taken once.

    Raises:
        BusybotError: the folder has something in it, or two libraries have different objects, splits or weights under
            one name.
    """
    place, owners = out.absolute(), _owners(libraries)
    refuse_taken(place)
    make_folder(place.parent)
    remove_abandoned(place.parent, place.name)
    splits: dict[str, dict[str, list[str]]] = {}
    with unfinished(place.parent, place.name) as made:
        for key, owner in owners.items():
            for name, data in read_snapshot(owner.folder / key).files.items():
                write_new(made / key / name, data, made)
            category, instance = key.split("/")
            lists = splits.setdefault(category, {"train": [], "test": []})
            for split, weight in _listed(owner, key).items():
                lists.setdefault(LISTS[split], []).extend([instance] * weight)
        write_json(made / SPLIT_FILE, {"Reason": splits})
        rename(made, place)


def _owners(libraries: Sequence[Library]) -> dict[str, Library]:
    """The library that each object is taken from, by key."""
    owners: dict[str, Library] = {}
    for library in libraries:
        for key, model in library.objects.items():
            first = owners.setdefault(key, library)
            same = first.objects[key].sha256 == model.sha256
            if not same or _listed(first, key) != _listed(library, key):
                what = "differs" if not same else "has another split or weight"
                hint = "give one of them another folder name and InstanceId, or leave it out"
                raise BusybotError(f"{key} {what} in {first.folder} and {library.folder}", hint)
    if len(owners) > MAX_OBJECTS:
        raise BusybotError(f"{len(owners)} objects are more than the {MAX_OBJECTS} allowed", "merge fewer libraries")
    return dict(sorted(owners.items()))


def _listed(library: Library, key: str) -> dict[str, int]:
    """How often the object stands in each split."""
    return {split: int(weights[key]) for split, weights in library.splits.items() if key in weights}
