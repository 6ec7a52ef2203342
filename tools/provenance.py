"""Which committed results do not tell by what code they were made, or of what.

New ones must: a result names the commit of the program that wrote it, without changes that nobody else has, and its
machine; all its rows are of one commit, and if they were trained by another one, on another machine, all by the same;
and it, or each of its rows, has hashes of the models, boards or recordings that it is about, unless its kind is about
none. `KNOWN` lists the others; it may only become shorter, unless more is asked. Results about weights that a later
training replaced are told, too: nobody can judge those again without training them.
"""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.runner import within
from busybot.common.errors import BusybotError
from busybot.evaluation.results import git
from busybot.training.model_cards import file_hashes
from tools import tables

HERE = Path(__file__).parent
MODELS = "busybot/pretrained/interact", "busybot/pretrained/reason", "benchmarks/models"
WEIGHTS = ".safetensors"
NO_COMMIT, CHANGED, SOME_ROWS = "names no commit", "changes were not committed", "some rows name no commit"
SEVERAL, NO_HASHES = "rows of several commits", "has no hashes of what it is about"
ABSENT = "its commit is not in this history"
NO_MACHINE = "names no machine"
EXPLAINED = {
    NO_COMMIT: "made before results named their commit",
    CHANGED: "made, or some of their rows, by a commit with changes that were not committed",
    SOME_ROWS: "some of their rows name no commit",
    ABSENT: "their commit, or that of some of their rows, is not in the history as it is today",
    SEVERAL: "their rows are of several commits, which they name",
    NO_MACHINE: "made before results of their kind named the machine",
    NO_HASHES: "without hashes of models, boards or recordings, which their commands make from their seeds",
}
KNOWN = {
    CHANGED: {
        *("laptop/tables/stages", "laptop/tables/table1", "laptop/tables/table2", "laptop/tables/table3"),
    },
    SEVERAL: {"hostile", "table1"},
    NO_MACHINE: {"same-results/before"},
}
"""Results that were there before that was asked of them."""
ABOUT_NOTHING = (
    "hostile",
    "message-passing",
    "opening",
    "paper-reason-speed",
    "reproduce",
    "s3",
    "scale",
    "streaming",
    "waiting",
)
"""Kinds that measure commands alone, or what is drawn at random."""
TRAINING = "training"
ROWS = ("rows", "kinds")
"""Where a result has its rows."""
DIGEST = re.compile(r'"[0-9a-f]{64}"')


def part() -> str:
    """A list of the results whose making is not wholly known, for people.

    Raises:
        BusybotError: one is not in `KNOWN`, or one that is there does not belong there any more.
    """
    found = faults()
    known = {name: why for why, names in KNOWN.items() for name in names}
    if fresh := {name: why for name, why in found.items() if known.get(name) != why}:
        what = "; ".join(f"{name}: {why}" for name, why in fresh.items())
        raise BusybotError(f"benchmarks/results: {what}", "commit first, then make the result, in a clean checkout")
    if done := known.keys() - found.keys():
        raise BusybotError(f"{', '.join(sorted(done))}: its making is known now", "take it out of tools/provenance.py")
    lines = []
    for why, words in EXPLAINED.items():
        names = [f"`{name}`" for name, one in sorted(found.items()) if one == why]
        lines += [f"- {words} ({len(names)}): {', '.join(names)}"] if names else []
    for of, names in _of_earlier_weights():
        models = ", ".join(f"`{name}`" for name in names)
        lines.append(f"- about weights of {models} before those that are here ({len(of)}): {', '.join(of)}")
    return "\n".join(lines)


def _of_earlier_weights() -> Iterator[tuple[tuple[str, ...], list[str]]]:
    """Results that are about other weights by the names of models of the repository, and these models."""
    folders = {path.name: path for place in MODELS for path in sorted((HERE.parent / place).iterdir()) if path.is_dir()}
    kept = {name: _weights(file_hashes(folder)) for name, folder in folders.items()}
    found: dict[str, list[str]] = {}
    for result, told in _results():
        for name in dict.fromkeys(name for name, of in _named(told) if of != kept.get(name, of)):
            found.setdefault(name, []).append(f"`{result}`")
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, results in sorted(found.items()):
        groups.setdefault(tuple(results), []).append(name)
    yield from groups.items()


def _weights(files: Any) -> dict[str, str]:
    """Of hashes of a model's files those that decide what it says; nothing of another value."""
    return {name: one for name, one in files.items() if name.endswith(WEIGHTS)} if isinstance(files, dict) else {}


def _named(value: Any) -> Iterator[tuple[str, dict[str, str]]]:
    """Names in a JSON value under which hashes of weights stand, there or as those of a model."""
    if isinstance(value, dict):
        for name, one in value.items():
            if weights := _weights(one) or (_weights(one.get("model")) if isinstance(one, dict) else {}):
                yield name, weights
            yield from _named(one)
    elif isinstance(value, list):
        for one in value:
            yield from _named(one)


def faults() -> dict[str, str]:
    """What is not known of a result's making, by the file's name; those of which all is known are left out."""
    found, history = {}, _history()
    for name, told in _results():
        if why := _fault(told, history):
            found[name] = why
    absent = dict.fromkeys(KNOWN.get(ABSENT, ()), ABSENT) if history is None else {}  # nobody can tell: as it was told
    return absent | found


def _results() -> Iterator[tuple[str, dict[str, Any]]]:
    """The name of each result's file, and its content."""
    for file in sorted(tables.RESULTS.rglob("*.json")):
        yield file.relative_to(tables.RESULTS).with_suffix("").as_posix(), json.loads(file.read_text(encoding="utf-8"))


def _history() -> set[str] | None:
    """All commits that led to this one; None where git does not know them all, as in a shallow clone."""
    whole = git(HERE, "rev-parse", "--is-shallow-repository") == "false"
    return set((git(HERE, "rev-list", "HEAD") or "").split()) if whole else None


def _fault(told: dict[str, Any], history: set[str] | None) -> str | None:
    commit, made = told.get("commit"), told.get("made", {})
    if commit is None:
        return NO_COMMIT
    if not told.get("machine"):
        return NO_MACHINE
    if any(str(one).endswith("-dirty") for one in (commit, *(part["commit"] for part in made.values()))):
        return CHANGED
    if history is not None and not {one for one, _ in _commits(told)} - {None} <= history:
        return ABSENT
    given: Any = next((told[name] for name in ROWS if told.get(name)), {})
    rows = given if isinstance(given, dict) else {str(place): row for place, row in enumerate(given)}
    told_of = {name: list(_commits(row)) for name, row in rows.items()}
    trained = {commit for found in told_of.values() for commit, training in found if training}
    named = {
        name: {commit for commit, training in found if not training} | _made(made, name)
        for name, found in told_of.items()
    }
    if None in trained or (any(named.values()) and not all(one and None not in one for one in named.values())):
        return SOME_ROWS
    if len(trained) > 1 or len(set().union(*named.values())) > 1:
        return SEVERAL
    beside = {name: value for name, value in told.items() if name not in ROWS}
    hashed = _hashed(beside) or (bool(rows) and all(map(_hashed, rows.values())))
    return None if told["kind"] in ABOUT_NOTHING or hashed else NO_HASHES


def _hashed(value: Any) -> bool:
    """Whether a digest stands somewhere; that of busybot's own code, which every result has, is of nothing else."""
    return DIGEST.search(json.dumps(_without_versions(value))) is not None


def _without_versions(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _without_versions(one) for name, one in value.items() if name != "versions"}
    return [_without_versions(one) for one in value] if isinstance(value, list) else value


def _made(made: dict[str, Any], row: str) -> set[str]:
    """The commits of a row and of its parts, as the file tells of what it got one after the other."""
    return {one["commit"] for place, one in made.items() if within(place, row)}


def _commits(value: Any, training: bool = False) -> Iterator[tuple[str | None, bool]]:
    """All that stands under `commit` in a JSON value, and whether that is said of a training."""
    if isinstance(value, dict):
        for key, one in value.items():
            if key == "commit":
                yield one, training
            else:
                yield from _commits(one, training or key == TRAINING)
    elif isinstance(value, list):
        for one in value:
            yield from _commits(one, training)
