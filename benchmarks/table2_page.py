"""Table 2 as Markdown, from the result file of `benchmarks/table2.py` into a page that has a place for it.

    python -m benchmarks.table2_page benchmarks/results/table2.json docs/reason.md

The place is between `<!-- table2 -->` and `<!-- end of table2 -->`. A row that was not run is shown as missing.
"""

from typing import Any

from benchmarks.pages import costs, head, paper_lines, put, write_page
from busybot.view.protocol import REASONING


def table(result: dict[str, Any]) -> str:
    """Percent: mean over seeds with the extremes behind it; bounds, and the paper's rows below."""
    lines, columns = head(REASONING), REASONING.columns()
    for row in REASONING.rows:
        told = result["rows"].get(row.name)
        lines.append(f"| {row.words} | " + " | ".join(_cell(told, *column) for column in columns) + " |")
    lines.append("| bound | " + " | ".join(_bound(result, *column) for column in columns) + " |")
    return "\n".join([*lines, *paper_lines(REASONING)])


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
    for row in REASONING.rows:
        judged = result["rows"].get(row.name, {"splits": {}})["splits"].get(split)
        if judged and "exploration" not in row.name:
            bounds = judged["seeds"][0]["bounds"]["not_knowing"]
            share = {"edge_r": judged["mean"]["edge_r_bound"], **bounds}.get(key)
            return "" if share is None else f"{100 * share:.1f}"
    return ""


def page(text: str, result: dict[str, Any]) -> str:
    """The page with the table in its place."""
    trained = result["rows"].get("event", {"training": []})["training"]
    return put(text, "table2", f"{table(result)}\n\n{costs(trained, result['machine'])}".rstrip())


if __name__ == "__main__":
    write_page(__doc__, page)
