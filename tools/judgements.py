"""The page of judgings: how often each test set of the worlds was used, from the log that evaluations write."""

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


def test_sets(root: Path = ROOT) -> str:
    """A line for each model on each set: how often it was judged there, when, and what came out the last time."""
    entries = [read_json(file) for file in sorted((root / LOG).glob("*.json"))]
    found: dict[tuple[str, ...], list[tuple[dict[str, Any], int]]] = {}
    for entry in entries:
        for name, counted in entry["sets"].items():
            camera = ", a real camera" if (entry.get("recordings") or {}).get("camera") else ""
            for objects, boards in counted.items():
                key = (name, f"{objects}{camera}", entry["kind"], entry["who"], entry["model"][:8])
                found.setdefault(key, []).append((entry, boards))
    if not found:
        return NONE
    lines = []
    for (name, objects, kind, who, model), told in sorted(found.items()):
        days = [entry["when"][:10] for entry, _ in told]
        last = told[-1][0]["figures"]
        figures = [f"{words} {share(last[key])}" for key, words in SHOWN.items() if last.get(key) is not None]
        boards = ", ".join(str(count) for count in sorted({count for _, count in told}))
        when = days[0] if days[0] == days[-1] else f"{days[0]} to {days[-1]}"
        cells = (objects, f"{kind}: {who}", f"`{model}`", str(len(told)), boards, when, ", ".join(figures) or "-")
        lines.append((f"`{name}`", cells))
    heads = ("objects", "judged", "model", "times", "boards", "when", "the last time, percent")
    return markdown([plain_grid(heads, lines, "set")])
