"""A dataset in a few numbers, from its tables: no image is decoded unless tables are behind the episodes."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from busybot.boards.spec import PAPER
from busybot.common.errors import BusybotError
from busybot.common.remote import is_remote
from busybot.datasets.dataset import HASHED, Dataset
from busybot.datasets.info import collect_command
from busybot.datasets.manifest import is_frozen

_COLUMNS = [*HASHED, "steps", "bytes", "oracle", "images", "truth", "successes"]


def summarise(path: Path) -> dict[str, Any]:
    """Counts, hashes and origin of the dataset; JSON values.

    `world` is null of imported boards, `links` (least and most number of trigger links) where any number was right;
    `episodes` counts finished ones, `bytes` their files, `success_share` is successes per proposed action (null where
    no truth was recorded), `images_per_episode` counts stored images. Of a dataset at an address the hashes are None:
    its recordings' checksums are not compared there.
    """
    dataset = Dataset.open(path)
    info, collect = dataset.info, dataset.info.collect
    rows = dataset.episodes_table(columns=_COLUMNS)
    collect = collect if rows.num_rows else None  # settings of an attempt that recorded nothing say nothing
    hashes = None if is_remote(path) else dataset.hashes(rows)
    known = rows.filter(rows["truth"])
    return {
        "name": info.name,
        "split": info.split,
        "seed": info.seed,
        "schema_version": info.schema_version,
        "frozen": is_frozen(path),
        "boards": info.boards,
        "tasks": info.tasks,
        "world": None if info.generator.imported else info.generator.config.get("world", PAPER),
        "links": info.generator.config.get("links"),
        "episodes": rows.num_rows,
        "steps": _total(rows["steps"]),
        "bytes": _total(rows["bytes"]),
        "board_hash": hashes and hashes.board,
        "trace_hash": hashes and hashes.trace,
        "content_hash": hashes and hashes.content,
        "policy": collect.policy if collect else None,
        "oracle_episodes": _total(rows["oracle"]),
        "steps_per_episode": collect.steps if collect else None,
        "images": collect.images if collect else None,
        "images_per_episode": round(_total(rows["images"]) / rows.num_rows, 2) if rows.num_rows else None,
        "strict": collect.strict if collect else None,
        "delta": collect.delta if collect else None,
        "success_share": _total(known["successes"]) / _total(known["steps"]) if _total(known["steps"]) else None,
        "assets": f"{info.assets.source}: {info.assets.name} ({len(info.assets.sha256)} objects)",
        "generator": info.generator.version,
    }


def nothing_moved(dataset: Dataset) -> bool:
    """Whether every recorded action is known to have moved no trigger link, so that nothing shows who controls what."""
    rows = dataset.episodes_table(columns=["steps", "truth", "successes"])
    return _total(rows["steps"]) > 0 and all(rows["truth"].to_pylist()) and not _total(rows["successes"])


def kept_to_judge(dataset: Dataset) -> str | None:
    """What is lost where a model is trained on the dataset: its split is one that models are judged on. Else None."""
    split = dataset.info.split
    if not split.startswith("novel-"):
        return None
    return f"{dataset.path}: its boards are of the split {split}; the model cannot be judged on that split honestly"


def origin_of(dataset: Dataset) -> dict[str, Any]:
    """What a training on the dataset depends on, wherever it lies; JSON values.

    Raises:
        BusybotError: nothing is recorded in it.
    """
    episodes = len(dataset.finished())
    if not episodes:
        raise BusybotError(f"{dataset.path}: no board has an episode", collect_command(dataset.path, dataset.info))
    hashes = dataset.hashes()
    return {
        "name": dataset.info.name,
        "split": dataset.info.split,
        "seed": dataset.info.seed,
        "assets": dataset.info.assets.name,
        "drawing": _drawing(dataset),
        "episodes": episodes,
        "board_hash": hashes.board,
        "content_hash": hashes.content,
    }


def _drawing(dataset: Dataset) -> str | None:
    """SHA-256 of all that boards were drawn by but their number, and of the first one: a dataset that grows keeps its
    boards, and the first names objects of its library. None of imported ones, which nobody drew."""
    info = dataset.info
    if info.generator.imported:
        return None
    config = {key: value for key, value in info.generator.config.items() if key != "boards"}
    told = [info.seed, info.split, info.assets.name, info.generator.version, config, dataset.board(0).digest()]
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def _total(column: Any) -> int:
    return int(pc.sum(column).as_py() or 0)
