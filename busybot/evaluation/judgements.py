"""A log of every judging on the test sets of datasets/worlds, so that everybody sees how often they were used.

In a checkout of the repository each evaluation of boards of a frozen test set leaves a file in `datasets/judgements`:
who was judged, by a hash of the model's files, on how many of the set's boards, recorded by whom and before which
camera, and the main figures. It is one small file a judging, so that nothing that git tracks is changed, and two
branches never conflict. docs/results/judgements.md is made from them. Elsewhere there is no log.
"""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from busybot.common.atomic_io import read_json, write_json
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset

ROOT = Path(__file__).resolve().parents[2]
SETS, LOG = Path("datasets", "worlds"), Path("datasets", "judgements")
"""Within the repository: cards of the sets, and the log."""
DIGITS = 16
"""Of a board's hash are on a card."""
VALIDATION = "validation"
"""Is no test set: constants and models are chosen on it."""
FIGURES = (
    *("edge_p", "edge_r", "parent_f1", "link_parent_f1", "mechanism_accuracy", "pred_a", "what_if", "ece_uncertain"),
    *("rewired_found", "rewired_placed", "wrong_early_stops", "success", "precision", "recall"),
)
"""What an entry repeats of a result, as far as it is there."""


def log_judgement(dataset: Dataset, boards: Iterable[int], who: str, result: Mapping[str, Any]) -> str | None:
    """Enter a judging, if the boards are of a test set.

    Args:
        boards: numbers of those that were judged.
        who: name of the model, or of what else was judged.
        result: stamped; its `hashes.models` tell which files were judged.

    Returns:
        the name of the entry's file; None if there is nothing to enter, or the log cannot be written.
    """
    found = judged_sets(dataset, boards)
    if not found:
        return None
    models = result["hashes"]["models"]
    now = datetime.now(UTC)
    entry = {
        "when": now.strftime("%Y-%m-%dT%H:%M:%SZ"),
        "kind": result["kind"],
        "who": who,
        "model": hashlib.sha256(json.dumps([who, models], sort_keys=True).encode()).hexdigest(),
        "models": models,
        "sets": found,
        "board_hash": dataset.hashes().board,
        "recordings": _recordings(dataset),
        "seed": result.get("seed"),
        "commit": result.get("commit"),
        "versions": result.get("versions"),
        "figures": {name: result[name] for name in FIGURES if name in result},
    }
    told = hashlib.sha256(json.dumps(entry, sort_keys=True).encode()).hexdigest()
    name = f"{now.strftime('%Y%m%dT%H%M%S%fZ')}-{told[:8]}.json"
    try:
        write_json(ROOT / LOG / name, entry, ROOT)
    except (BusybotError, OSError):  # a checkout that may only be read
        return None
    return name


def _recordings(dataset: Dataset) -> dict[str, Any] | None:
    """Who recorded them, and what their camera does that a clean one does not; None where nothing is recorded."""
    collect = dataset.info.collect
    if collect is None:
        return None
    camera = collect.group("render").get("camera")
    unclean = {name: value for name, value in camera.items() if value} if isinstance(camera, dict) else {}
    return {"policy": collect.policy, "content_hash": dataset.hashes().content, "camera": unclean}


def judged_sets(dataset: Dataset, boards: Iterable[int]) -> dict[str, dict[str, int]]:
    """How many of these boards are of which test set, by the set and by the name of its objects."""
    folder = ROOT / SETS
    if not (ROOT / ".git").exists() or not folder.is_dir():
        return {}
    wanted, found = set(boards), dict[str, Counter[str]]()
    cards: dict[str, dict[str, tuple[str, str]]] = {}
    for board in dataset.each_board():
        if board.index in wanted:
            if board.world not in cards:
                cards[board.world] = _digests(folder / f"{board.world}.json")
            place = cards[board.world].get(board.model_copy(update={"task": None}).digest()[:DIGITS])
            if place is not None:
                found.setdefault(place[0], Counter())[place[1]] += 1
    return {name: dict(counted) for name, counted in found.items()}


def _digests(card: Path) -> dict[str, tuple[str, str]]:
    """Set and objects of each board of a world's test sets, by the beginning of its hash."""
    if not card.is_file():
        return {}
    told = read_json(card)
    return {
        digest[:DIGITS]: (f"{told['world']}/{name}", objects)
        for objects, sets in told["objects"].items()
        for name, one in sets.items()
        if name != VALIDATION
        for digest in one["board_digests"].split()
    }
