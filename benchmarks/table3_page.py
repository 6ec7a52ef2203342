"""Table 3 as Markdown, from the result file of `benchmarks/table3.py` into a page that has a place for it.

    python -m benchmarks.table3_page benchmarks/results/table3.json docs/plan.md

The place is between `<!-- table3 -->` and `<!-- end of table3 -->`. What was not run is shown as missing.
"""

from typing import Any

from benchmarks.pages import head, paper_lines, put, write_page
from busybot.view.protocol import PLANNING, Row


def table(result: dict[str, Any]) -> str:
    """Percent: mean over seeds with the extremes behind it; the paper's rows below."""
    lines = head(PLANNING)
    lines += [row_line(row, result["rows"]) for row in PLANNING.rows]
    return "\n".join([*lines, *paper_lines(PLANNING)])


def row_line(row: Row, rows: dict[str, Any]) -> str:
    """An agent's line; what was not run is missing."""
    told = rows.get(row.name, {"splits": {}})["splits"]
    cells = [_cell(told.get(split, {}).get(kind)) for split, kind in PLANNING.columns()]
    return f"| {row.words} | {' | '.join(cells)} |"


def _cell(judged: dict[str, Any] | None) -> str:
    if judged is None:
        return "missing"
    least, most = min(judged["seeds"]), max(judged["seeds"])
    spread = "" if least == most else f" ({100 * least:.1f} to {100 * most:.1f})"
    return f"{100 * judged['success']:.1f}{spread}"


def page(text: str, result: dict[str, Any]) -> str:
    """The page with the table in its place."""
    return put(text, "table3", table(result))


if __name__ == "__main__":
    write_page(__doc__, page)
