"""Table 1 as Markdown, from the result file of `benchmarks/table1.py` into a page that has a place for it.

    python -m benchmarks.table1_page benchmarks/results/table1.json docs/interact.md

The place is between `<!-- table1 -->` and `<!-- end of table1 -->`. A row that was not run is shown as missing.
"""

from typing import Any

from benchmarks.pages import costs, put, write_page

SPLITS = ("novel-config", "novel-object")
KEYS = ("precision", "recall", "precision_exploring")
PAPER = {
    "oracle": (91.8, 82.4, 79.5, 90.2),
    "rgb": (62.3, 63.1, 9.5, 17.0),
    "without responders": (0.71, 0.65, 0.24, 0.49),
    "greedy": (94.2, 33.7, 81.9, 38.6),
    "ours": (90.1, 80.1, 82.6, 84.8),
}
"""Precision and recall on new configurations, then on new objects (the paper's Table 1)."""
ROWS = (
    ("free-0", "**ours**, free, seed 0"),
    ("free-1", "**ours**, free, seed 1"),
    ("free-2", "**ours**, free, seed 2"),
    ("strict-0", "**ours**, strict, seed 0"),
    ("strict-1", "**ours**, strict, seed 1"),
    ("strict-2", "**ours**, strict, seed 2"),
    ("oracle", "oracle: reward from joint states"),
    ("rgb", "RGB instead of depth"),
    ("without-responders-100", "without responders, threshold 100"),
    ("without-responders-500", "without responders, threshold 500"),
    ("without-responders-1000", "without responders, threshold 1000"),
    ("greedy", "without exploration: always the highest affordance"),
    ("ucb", "the paper's UCB bonus on our networks"),
    ("random", "random elevated pixels and directions"),
)


def table(result: dict[str, Any]) -> str:
    """Percent with half the width of the 95 % interval over boards; the paper's rows below."""
    heads = ("precision", "recall", "new links", "precision", "recall", "new links")
    lines = ["| | " + " | ".join(f"{split}: {head}" for split, head in _columns(heads)) + " |"]
    lines.append("|---" * (1 + len(heads)) + "|")
    for name, words in ROWS:
        row = result["rows"].get(name)
        cells = [_cell(row, split, key) for split in SPLITS for key in KEYS]
        lines.append(f"| {words} | " + " | ".join(cells) + " |")
    for name, values in PAPER.items():
        config_p, config_r, object_p, object_r = (f"{value:g}" for value in values)
        lines.append(f"| *the paper: {name}* | {config_p} | {config_r} | | {object_p} | {object_r} | |")
    return "\n".join(lines)


def _columns(heads: tuple[str, ...]) -> list[tuple[str, str]]:
    return [(SPLITS[number // len(KEYS)], head) for number, head in enumerate(heads)]


def _cell(row: dict[str, Any] | None, split: str, key: str) -> str:
    if row is None or split not in row:
        return "missing" if row is None else "no reward"
    judged = row[split]
    if judged[key] is None:
        return "-"
    low, high = judged["intervals"][key] or (judged[key], judged[key])
    return f"{100 * judged[key]:.1f} ± {50 * (high - low):.1f}"


def page(text: str, result: dict[str, Any]) -> str:
    """The page with the table in its place."""
    trained = [row["training"] for row in result["rows"].values() if row["training"]]
    return put(text, "table1", f"{table(result)}\n\n{costs(trained, result['machine'])}")


if __name__ == "__main__":
    write_page(__doc__, page)
