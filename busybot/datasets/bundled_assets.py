"""The objects of a dataset: where they are found, and which of them a frozen dataset carries itself.

A generator of objects changes with the project, so the hashes in `dataset.json` would lead nowhere in a year. A frozen
dataset therefore carries its objects where their licence allows: all that its boards were drawn from, also those that
were never drawn, because without them the boards could not be made again.
"""

import contextlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

from pydantic import ValidationError

from busybot.boards.config import SPLITS
from busybot.boards.generate import GENERATOR_VERSION
from busybot.boards.scenes import SCENES
from busybot.common.atomic_io import inside, write_atomically
from busybot.common.errors import BusybotError, UsageError
from busybot.common.frozen_model import first_fault
from busybot.datasets.create import drawn_again
from busybot.datasets.dataset import INFO_FILE, OBJECTS_FOLDER, Dataset
from busybot.datasets.manifest import AssetEntry, is_frozen, is_plain_path
from busybot.objects.library import LISTS, OTHER, SPLIT_FILE, Library
from busybot.objects.license import Licence, licences
from busybot.objects.model import ObjectModel
from busybot.objects.partnet.folder_snapshot import read_snapshot
from busybot.objects.resolve import find, load_and_remember, mismatch


def library_of(dataset: Dataset, assets: str | None = None) -> Library:
    """The library with the dataset's objects: the named one, else the carried one, else what `resolve.find` finds.

    Raises:
        BusybotError: it is not found, or one of the objects differs from the recorded hash.
    """
    place, recorded = dataset.path / OBJECTS_FOLDER, dataset.info.assets
    if assets is None and dataset.info.generator.imported:
        what = f"{dataset.path}: it was imported; nobody knows what its objects are made of, nor their states"
        raise BusybotError(what, "what needs a simulator cannot be done with it")
    # the split file is written last: without it, an interrupted freeze has left some of the objects behind
    carried = place.is_symlink() or (place / SPLIT_FILE).exists() or (place.is_dir() and is_frozen(dataset.path))
    if assets is not None or not carried:
        if assets is None and recorded.source == "procedural" and recorded.sha256:
            with contextlib.suppress(BusybotError):  # an earlier version made them: they may lie elsewhere
                return find("procedural", recorded.sha256)
        return find(assets, recorded.sha256)
    library = load_and_remember(inside(dataset.path, OBJECTS_FOLDER))
    problem = mismatch(library, recorded.sha256)
    if problem:
        raise BusybotError(problem, "fetch the dataset again, or name a library that holds its objects: --assets DIR")
    return replace(library, name=recorded.name)


def library_of_file(episode: Path, assets: str | None = None) -> Library:
    """The objects of the dataset in which an episode's file lies; of a lone file the named or the procedural ones."""
    folder = episode.absolute().parent.parent
    if episode.absolute().parent.name == "episodes" and (folder / INFO_FILE).is_file():
        return library_of(Dataset.open(folder), assets)
    return find(assets)


@dataclass(frozen=True)
class Assets:
    """What freezing does with the objects.

    Attributes:
        entries: for the manifest.
        boards_again: whether the recorded configuration gives the dataset's boards again with this library.
        files: carried files with their bytes, by path relative to the dataset.
        left_out: licences that forbid carrying; empty if the objects are carried or nobody asked.
    """

    entries: dict[str, AssetEntry]
    files: dict[str, bytes]
    boards_again: bool = False
    left_out: tuple[str, ...] = ()


def check_licence(stated: str | None) -> None:
    """Refuse as a licence what a manifest cannot tell.

    Raises:
        UsageError: naming the option that states it.
    """
    if stated is None:
        return
    try:
        AssetEntry(sha256="0" * 64, licence=stated, carried=False)
    except ValidationError as error:
        what = f"--licence {stated[:40]!r}: {first_fault(error).removeprefix('licence: ')}"
        raise UsageError(what, "give an SPDX identifier, as CC-BY-4.0") from None


def plan_assets(dataset: Dataset, library: Library | None, carry: bool, stated: str | None) -> Assets:
    """Decide which objects the frozen dataset carries: none if one may not be copied.

    They are all from which the boards were drawn, if the library still gives these boards, else those on the boards.

    Args:
        library: None where the objects are not at hand; the manifest then knows their hashes alone.
        stated: licence of objects that the owner made; see `licences`.
    """
    recorded = dataset.info.assets.sha256
    if library is None:
        name = Licence(stated or "unknown", False).name
        return Assets({key: AssetEntry(sha256=sha, licence=name, carried=False) for key, sha in recorded.items()}, {})
    problem = mismatch(library, recorded)
    if problem:
        raise BusybotError(problem, "name the library with which the dataset was made: --assets DIR")
    again = _gives_boards(dataset, library)
    pool = _pool(dataset, library, again)
    known = licences(pool.values(), stated)
    refused = sorted({licence.name for licence in known.values() if not licence.copies})
    carried = carry and not refused
    listed = pool if carried else {key: pool[key] for key in recorded}
    entries = {
        key: AssetEntry(sha256=model.sha256, licence=known[key].name, carried=carried) for key, model in listed.items()
    }
    return Assets(entries, _files(pool, library) if carried else {}, again, tuple(refused) if carry else ())


def _gives_boards(dataset: Dataset, library: Library) -> bool:
    if dataset.info.generator.version != GENERATOR_VERSION:
        return False
    again = drawn_again(dataset.info.generator, library)
    for board in chain(dataset.each_board(), [None]):
        try:
            if next(again, None) != board:
                return False
        except BusybotError:
            return False
    return True


def _pool(dataset: Dataset, library: Library, whole: bool) -> dict[str, ObjectModel]:
    """The objects that stand on the boards, and if the whole pool is asked for, all that could have."""
    weights: Mapping[str, float] = library.splits.get(SPLITS.get(dataset.info.split, ""), {}) if whole else {}
    scene = dataset.info.generator.config.get("world") in tuple(SCENES)
    others = library.splits.get(OTHER, {}) if whole and scene else {}
    return {key: library.get(key) for key in sorted({*weights, *others, *dataset.info.assets.sha256})}


def _files(pool: dict[str, ObjectModel], library: Library) -> dict[str, bytes]:
    files: dict[str, bytes] = {}
    for key, model in pool.items():
        snapshot = read_snapshot(model.folder)
        if snapshot.sha256 != model.sha256:
            raise BusybotError(f"{model.folder}: changed while it was read", "try again when nothing writes to it")
        for name, data in snapshot.files.items():
            place = f"{OBJECTS_FOLDER}/{key}/{name}"
            if not is_plain_path(place):  # a manifest that lists it could never be read
                what = f"{model.folder}: a file is called {name[:80]!r}, which no manifest can tell"
                raise BusybotError(what, "rename it without backslashes and control characters, or give --no-objects")
            files[place] = data
    lists: dict[str, dict[str, list[str]]] = {}
    for split, name in LISTS.items():
        for key, weight in library.splits.get(split, {}).items():
            category, instance = key.split("/")
            if key in pool:
                own = lists.setdefault(category, {"train": [], "test": []})
                own.setdefault(name, []).extend([instance] * int(weight))
    files[f"{OBJECTS_FOLDER}/{SPLIT_FILE}"] = (json.dumps({"Reason": lists}, indent=2, sort_keys=True) + "\n").encode()
    return files


def write_carried(dataset: Path, assets: Assets) -> None:
    """Write the carried files that are not there yet."""
    for name, data in assets.files.items():
        place = inside(dataset, name)
        if not place.is_file() or place.read_bytes() != data:
            write_atomically(place, data, dataset)
