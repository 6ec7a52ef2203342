"""The page of judgings: how often each test set of the worlds was used, from the log that evaluations write."""

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from busybot.common.atomic_io import read_json
from busybot.evaluation.judgements import LOG
from busybot.view.report.page import markdown, plain_grid, share

ROOT = Path(__file__).resolve().parents[1]
NONE = "No test set has been judged yet."
SHOWN = {
    "parent_f1": "F1 of parents",
    "link_parent_f1": "F1 of links",
    "mechanism_accuracy": "mechanisms",
    "success": "success",
    "precision": "precision",
    "recall": "recall",
}
"""Figures that the page repeats."""
UNTOLD = "-"
AT_ONCE = timedelta(minutes=1)
"""Entries that follow each other within this were made by one command."""
_Judgings = list[tuple[dict[str, Any], int]]
"""Entries about one model on one set, with the number of boards, the oldest first."""


def test_sets(root: Path = ROOT) -> str:
    """A line for models that were judged on a set together: how often, and what came out the last time."""
    entries = [read_json(file) for file in sorted((root / LOG).glob("*.json"))]
    found: dict[tuple[str, ...], dict[str, _Judgings]] = {}
    for entry in sorted(entries, key=lambda entry: entry["when"]):
        recordings = entry.get("recordings") or {}
        acted = f"{recordings.get('policy') or UNTOLD}{', a real camera' if recordings.get('camera') else ''}"
        for name, counted in entry["sets"].items():
            for objects, boards in counted.items():
                place = (name, objects, f"{entry['kind']}: {entry['who']}", acted)
                found.setdefault(place, {}).setdefault(entry["model"][:8], []).append((entry, boards))
    if not found:
        return NONE
    lines = [
        (f"`{name}`", (objects, judged, acted, *_told(together)))
        for (name, objects, judged, acted), models in sorted(found.items())
        for together in _together(models)
    ]
    heads = ("objects", "judged", "acted", "models", "times each", "boards", "when", "the last time, percent")
    return markdown([plain_grid(heads, lines, "set")])


def _together(models: dict[str, _Judgings]) -> list[dict[str, _Judgings]]:
    """The models in groups of those that were judged by the same commands, on as many boards."""
    groups: dict[tuple[tuple[int, int], ...], dict[str, _Judgings]] = {}
    commands = _commands({entry["when"] for judgings in models.values() for entry, _ in judgings})
    for model, judgings in sorted(models.items()):
        groups.setdefault(tuple((commands[entry["when"]], boards) for entry, boards in judgings), {})[model] = judgings
    return [groups[told] for told in sorted(groups)]


def _commands(moments: set[str]) -> dict[str, int]:
    """By which of the commands, one after the other, an entry was made: one enters all of its models at its end."""
    found: dict[str, int] = {}
    number, before = 0, datetime.min.replace(tzinfo=UTC)
    for moment in sorted(moments):
        now = datetime.fromisoformat(moment)
        number += now - before > AT_ONCE
        found[moment], before = number, now
    return found


def _told(together: dict[str, _Judgings]) -> tuple[str, ...]:
    """The cells about models that were judged together."""
    judgings = next(iter(together.values()))
    days = [_day(entry) for entry, _ in judgings]
    boards = ", ".join(str(count) for count in sorted({count for _, count in judgings}))
    when = days[0] if days[0] == days[-1] else f"{days[0]} to {days[-1]}"
    last = [one[-1][0]["figures"] for one in together.values()]
    figures = [f"{words} {_extremes(known)}" for key, words in SHOWN.items() if (known := _known(last, key))]
    names = ", ".join(f"`{model}`" for model in together)
    return names, str(len(judgings)), boards, when, ", ".join(figures) or UNTOLD


def _day(entry: dict[str, Any]) -> str:
    return str(entry["when"][:10])


def _known(figures: list[dict[str, Any]], key: str) -> list[float]:
    return [one[key] for one in figures if one.get(key) is not None]


def _extremes(shares: list[float]) -> str:
    least, most = share(min(shares)), share(max(shares))
    return least if least == most else f"{least}-{most}"
