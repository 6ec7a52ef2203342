"""Freezing: a finished dataset gets a manifest and a card, and becomes read-only.

Everything is written before the manifest, and the manifest appears whole or not at all: a dataset that was being frozen
when the process was killed is either not frozen, or frozen and perhaps not yet read-only. Freezing it again continues.
"""

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from busybot import __version__
from busybot.common.atomic_io import LOCK_FILE, Scan, forbid_writing, remove, scan, write_atomically, write_json
from busybot.common.errors import BusybotError
from busybot.datasets.bundled_assets import OBJECTS_FOLDER, Assets, plan_assets, write_carried
from busybot.datasets.dataset import INFO_FILE, Dataset
from busybot.datasets.dataset_card import card
from busybot.datasets.info import collect_command
from busybot.datasets.manifest import (
    CARD_FILE,
    MANIFEST_FILE,
    Hashes,
    Manifest,
    Origin,
    file_entries,
    is_frozen,
    read_manifest,
)
from busybot.datasets.membership import is_partial
from busybot.datasets.repair import DAMAGED_FOLDER
from busybot.datasets.verify import verify
from busybot.episodes.schema import TABLES
from busybot.objects.library import Library

FREEZING_PACKAGES = ("pyarrow", "mcap", "opencv-python")


@dataclass(frozen=True)
class Frozen:
    """What freezing did.

    Attributes:
        left_out: licences because of which the objects are not carried.
        new: False if the dataset was frozen already.
    """

    manifest: Manifest
    left_out: tuple[str, ...] = ()
    new: bool = True


def freeze(
    path: Path,
    library: Library | None,
    carry: bool = True,
    licence: str | None = None,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Frozen:
    """Freeze a dataset; of a frozen one only the read-only marks are made complete.

    Args:
        library: with the dataset's objects; None if they are not at hand.
        carry: put copies of the objects into the dataset, if all their licences allow it.
        licence: of objects that the user made, an SPDX identifier.
        progress: of the verification: episodes done and all.

    Raises:
        BusybotError: episodes are missing, something is wrong with the dataset or does not belong to it, a link is in
            it, or another process writes into it.
    """
    dataset = Dataset.open(path)
    if is_frozen(path):
        manifest = read_manifest(path)
        _finish(path)
        return Frozen(manifest, new=False)
    with dataset.locked():
        refuse_unfinished(dataset)
        dataset.remove_leftovers()
        assets = plan_assets(dataset, library, carry, licence)
        _refuse_strangers(dataset, assets)
        dataset.write_tables()
        write_carried(path, assets)
        report = verify(path, workers, progress)
        if not report.ok:
            first = report.problems[0]
            what = f"{path}: {len(report.problems)} problems, first {first.file}: {first.what}"
            raise BusybotError(what, f"`busybot dataset repair {path}`, then `busybot dataset verify {path}`")
        manifest = _write_manifest(dataset, assets, workers)
        _finish(path)
    return Frozen(manifest, assets.left_out)


def refuse_unfinished(dataset: Dataset) -> None:
    """A dataset can be frozen when every board has an episode."""
    done, boards = len(dataset.finished()), dataset.info.boards
    if done < boards or dataset.info.collect is None or not boards:
        what = f"{dataset.path}: the dataset is not finished: {done} of {boards} boards have an episode"
        raise BusybotError(what, collect_command(dataset.path, dataset.info))


def _refuse_strangers(dataset: Dataset, assets: Assets) -> None:
    found = _scan(dataset.path)
    known = {INFO_FILE, LOCK_FILE, CARD_FILE, *assets.files}
    folders = ("boards", "episodes", *(f"tables/{name}" for name in TABLES))  # `verify` looks at the names in these
    strangers = [name for name in found.files if name not in known and name.rpartition("/")[0] not in folders]
    strangers += [name for name in found.files if name.rpartition("/")[2].startswith(".") and name not in known]
    if not strangers:
        return
    first = strangers[0].split("/")[0]
    hint = {
        DAMAGED_FOLDER: "move the folder `damaged`, which `repair` left, out of the dataset",
        OBJECTS_FOLDER: "remove the folder `objects`; freezing makes it again if the licences allow it",
    }.get(first, "move what does not belong to the dataset out of it")
    raise BusybotError(f"{dataset.path / strangers[0]}: not part of a dataset, {len(strangers)} such files", hint)


def _scan(path: Path) -> Scan:
    found = scan(path)
    if found.others:
        what = f"{path / found.others[0]}: neither a file nor a folder but a link or device"
        raise BusybotError(what, "put a copy of the file in its place, or remove it")
    return found


def _write_manifest(dataset: Dataset, assets: Assets, workers: int) -> Manifest:
    path, info = dataset.path, dataset.info
    assert info.collect is not None
    table = dataset.episodes_table()
    rows = table.select(["episode", "steps", "renderer", "versions", "settings"]).to_pylist()
    hashes = dataset.hashes(table)
    manifest = Manifest(
        schema_version=info.schema_version,
        name=info.name,
        split=info.split,
        boards=info.boards,
        steps=sum(row["steps"] for row in rows),
        hashes=Hashes(board=hashes.board, trace=hashes.trace, content=hashes.content),
        board_seed=info.seed,
        policy_seed=info.collect.seed,
        generator=info.generator,
        collect=info.collect,
        origins=[
            Origin(renderer=json.loads(renderer), versions=json.loads(versions), episodes=count)
            for (renderer, versions), count in Counter((r["renderer"], r["versions"]) for r in rows).most_common()
        ],
        partial=[row["episode"] for row in rows if is_partial(json.loads(row["settings"]))],
        boards_again=assets.boards_again,
        assets=assets.entries,
        frozen_with={"busybot": __version__, **{name: version(name) for name in FREEZING_PACKAGES}},
        files={},
    )
    _write_card(path, card(manifest))
    names = [name for name in _scan(path).files if name != LOCK_FILE]
    manifest = manifest.model_copy(update={"files": file_entries(path, names, workers)})
    write_json(path / MANIFEST_FILE, manifest.model_dump(mode="json"))
    return manifest


def _write_card(path: Path, text: str) -> None:
    file = path / CARD_FILE
    data = text.encode()
    if file.exists() and file.read_bytes() != data:
        raise BusybotError(f"{file}: it is there and not the card that freezing writes", "move or remove it")
    write_atomically(file, data)


def _finish(path: Path) -> None:
    """Remove the lock, which a frozen dataset needs no more, and take away all write permissions, the folder's last."""
    remove(path / LOCK_FILE)
    files = [path / name for name in _scan(path).files]
    folders = sorted({parent for file in files for parent in file.parents if parent.is_relative_to(path)})
    for place in [*files, *reversed(folders)]:
        forbid_writing(place, path)
