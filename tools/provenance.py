"""Which committed results do not tell by what code they were made.

New ones must: a result names the commit of the program that wrote it, without changes that nobody else has, and rows of
one file either all name theirs or none does. `OLDER` lists the others; it may only become shorter.
"""

import json
from collections.abc import Iterator
from typing import Any

from busybot.common.errors import BusybotError
from tools import tables

OLDER = frozenset(
    {
        *("bounds", "decision_time"),
        *("interact-procedural", "kills-collect"),
        *("kills-freeze-repair", "kills-train", "laptop/metrics", "laptop/tables/stages", "laptop/tables/table1"),
        *("laptop/tables/table2", "laptop/tables/table3", "memory"),
        *("paper_interact", "plan-procedural", "policy_constants", "reason-procedural"),
        "reason_robustness",
        *("worlds-procedural", "worlds-real"),
    }
)
"""Made before commits were recorded, or with changes that were not committed."""
NO_COMMIT, CHANGED, SOME_ROWS = "names no commit", "changes were not committed", "some rows name no commit"
EXPLAINED = {
    NO_COMMIT: "made before results named their commit",
    CHANGED: "made by a commit with changes that were not committed",
    SOME_ROWS: "some of their rows name no commit",
}


def part() -> str:
    """A list of the results whose code is not known, for people.

    Raises:
        BusybotError: one is not in `OLDER`, or one that is there does not belong there any more.
    """
    found = unknown()
    if fresh := {name: why for name, why in found.items() if name not in OLDER}:
        what = "; ".join(f"{name}: {why}" for name, why in fresh.items())
        raise BusybotError(f"benchmarks/results: {what}", "commit first, then make the result, in a clean checkout")
    if done := OLDER - found.keys():
        raise BusybotError(f"{', '.join(sorted(done))}: of a known commit now", "take it out of tools/provenance.py")
    lines = []
    for why, words in EXPLAINED.items():
        names = [f"`{name}`" for name, one in sorted(found.items()) if one == why]
        lines += [f"- {words} ({len(names)}): {', '.join(names)}"] if names else []
    return "\n".join(lines)


def unknown() -> dict[str, str]:
    """Why it is not known what code made a result, by the file's name; those of which it is known are left out."""
    found = {}
    for file in sorted(tables.RESULTS.rglob("*.json")):
        if why := _fault(json.loads(file.read_text(encoding="utf-8"))):
            found[file.relative_to(tables.RESULTS).with_suffix("").as_posix()] = why
    return found


def _fault(told: dict[str, Any]) -> str | None:
    commit, rows = told.get("commit"), told.get("rows")
    if commit is None:
        return NO_COMMIT
    if str(commit).endswith("-dirty"):
        return CHANGED
    named = [set(_commits(row)) for row in rows.values()] if isinstance(rows, dict) else []
    return SOME_ROWS if any(named) and not all(one and None not in one for one in named) else None


def _commits(value: Any) -> Iterator[str | None]:
    """All that stands under `commit` in a JSON value."""
    if isinstance(value, dict):
        for key, one in value.items():
            if key == "commit":
                yield one
            else:
                yield from _commits(one)
    elif isinstance(value, list):
        for one in value:
            yield from _commits(one)
