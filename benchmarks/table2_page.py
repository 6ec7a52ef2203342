"""Table 2 as Markdown, from the result file of `benchmarks/table2.py` into a page that has a place for it.

    python -m benchmarks.table2_page benchmarks/results/table2.json docs/reason.md

The place is between `<!-- table2 -->` and `<!-- end of table2 -->`. A row that was not run is shown as missing.
"""

from typing import Any

from benchmarks.pages import costs, put, write_page

SPLITS = ("validation", "novel-config", "novel-object")
KEYS = ("edge_p", "edge_r", "pred_a", "pred_a_successful")
HEADS = ("P", "R", "Pred-A", "successful")
PAPER = {
    "without inference": (None, None, 79.2, None, None, 36.2, None, None, 7.0),
    "without exploration": (55.6, 51.0, 89.6, 74.6, 3.1, 14.3, 75.1, 1.0, 11.6),
    "BusyBot": (95.8, 100.0, 88.1, 95.5, 99.7, 73.8, 85.0, 99.5, 31.0),
}
"""P, R, Pred-A on training boards, new configurations, new objects (the paper's Table 2)."""
ROWS = (
    ("event", "**`event`**"),
    ("event-300", "`event`, 300 boards"),
    ("event-100", "`event`, 100 boards"),
    ("event-20", "`event`, 20 boards"),
    ("event-without-exploration", "`event`, random actions"),
    ("lookup", "lookup of the nearest past contact"),
    ("count", "counting"),
    ("persistence", "nothing ever changes"),
    ("pc", "PC (causal-learn)"),
    ("pc-pairs", "PC, pairs only"),
    ("paper", "`paper`"),
    ("paper-without-inference", "`paper` without inference"),
    ("paper-without-exploration", "`paper`, random actions"),
)


def table(result: dict[str, Any]) -> str:
    """Percent: mean over seeds with the extremes behind it; bounds, and the paper's rows below."""
    heads = [f"{split}: {head}" for split in SPLITS for head in HEADS]
    lines = ["| | " + " | ".join(heads) + " |", "|---" * (1 + len(heads)) + "|"]
    for name, words in ROWS:
        row = result["rows"].get(name)
        lines.append(f"| {words} | " + " | ".join(_cell(row, split, key) for split in SPLITS for key in KEYS) + " |")
    lines.append("| bound | " + " | ".join(_bound(result, split, key) for split in SPLITS for key in KEYS) + " |")
    for name, values in PAPER.items():
        cells = [_number(value) for value in values]
        spaced = [cell for split in range(3) for cell in (*cells[3 * split : 3 * split + 3], "")]
        lines.append(f"| *the paper: {name}* | " + " | ".join(spaced) + " |")
    return "\n".join(lines)


def _cell(row: dict[str, Any] | None, split: str, key: str) -> str:
    if row is None or split not in row["splits"]:
        return "missing"
    judged = row["splits"][split]
    mean, least, most = (judged[what][key] for what in ("mean", "least", "most"))
    if mean is None:
        return "-"
    spread = "" if least == most else f" ({100 * least:.1f} to {100 * most:.1f})"
    return f"{100 * mean:.1f}{spread}"


def _bound(result: dict[str, Any], split: str, key: str) -> str:
    """What could be known on the boards of the first row that was judged there."""
    for name, _ in ROWS:
        judged = result["rows"].get(name, {"splits": {}})["splits"].get(split)
        if judged and "exploration" not in name:
            bounds = judged["seeds"][0]["bounds"]["not_knowing"]
            share = {"edge_r": judged["mean"]["edge_r_bound"], **bounds}.get(key)
            return _number(None if share is None else 100 * share)
    return ""


def _number(percent: float | None) -> str:
    return "" if percent is None else f"{percent:.1f}"


def page(text: str, result: dict[str, Any]) -> str:
    """The page with the table in its place."""
    trained = [told for row in result["rows"].values() for told in row["training"]]
    return put(text, "table2", f"{table(result)}\n\n{costs(trained, result['machine'])}".rstrip())


if __name__ == "__main__":
    write_page(__doc__, page)
