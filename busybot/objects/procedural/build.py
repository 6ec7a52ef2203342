"""Making a library of procedural objects, and keeping the default one in the user's cache.

The cached library lies in a folder named by a hash over the generating code and the seed, so a new version of the code
never meets the objects of an old one. It is built beside its place and renamed into it: it is there whole or not at
all, and of two processes that build at once the second one's copy is dropped.
"""

import contextlib
import hashlib
from dataclasses import replace
from pathlib import Path

from busybot.common.atomic_io import make_folder, remove, remove_abandoned, rename, unfinished, write_json
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.objects import cache
from busybot.objects.library import SPLIT_FILE, Library
from busybot.objects.procedural.export import write_object
from busybot.objects.procedural.families import FAMILIES

DEFAULT_SEED = 0


def make_library(folder: Path, seed: int = DEFAULT_SEED) -> list[str]:
    """Make all procedural objects in a new or empty folder.

    Returns:
        The objects' keys.

    Raises:
        BusybotError: the folder has something in it, or cannot be written.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BusybotError(f"{folder}: is not an empty folder", "name a new folder, or remove what is in it")
    keys, splits = [], dict[str, dict[str, list[str]]]()
    try:
        for family in FAMILIES:
            lists = splits.setdefault(family.category, {"train": [], "test": []})
            for variant in range(family.count):
                instance = f"{family.name}-{variant + 1:02d}"
                rng = generator(seed, "procedural", variant, f"{family.category}/{family.name}")
                design = replace(family.make(variant, rng), name=f"{family.category}_{instance}")
                write_object(design, folder / family.category / instance)
                lists["train" if family.split == "train" else "test"] += [instance] * family.weight
                keys.append(f"{family.category}/{instance}")
        write_json(folder / SPLIT_FILE, {"Reason": splits})
    except OSError as error:
        raise BusybotError(f"{folder}: cannot be written: {error.strerror}", "choose another folder") from None
    return keys


def procedural_library() -> Library:
    """The procedural library from the user's cache, made there first if it is absent or damaged."""
    place = cache.cache_folder() / f"procedural-{_code_hash()}"
    if place.is_dir():
        try:
            return _named(Library.load(place))
        except BusybotError:
            with contextlib.suppress(OSError):
                remove(place)
    _build_into(place)
    return _named(Library.load(place))


def _named(library: Library) -> Library:
    return replace(library, name="procedural")


def _build_into(place: Path) -> None:
    try:
        make_folder(place.parent)
        remove_abandoned(place.parent, "procedural")
        with unfinished(place.parent, "procedural") as made:
            make_library(made)
            try:
                rename(made, place)
            except OSError:
                if not place.is_dir():  # nobody else was faster
                    raise
    except OSError as error:
        raise BusybotError(
            f"{place}: cannot be written: {error.strerror}", "set BUSYBOT_CACHE to a folder that can be written"
        ) from None


def _code_hash() -> str:
    """Names the library that this code makes from its seed."""
    digest = hashlib.sha256(str(DEFAULT_SEED).encode())
    folder = Path(__file__).parent
    for source in sorted(folder.rglob("*.py")):  # subfolders, too: a change anywhere makes the library anew
        digest.update(source.relative_to(folder).as_posix().encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()[:16]
