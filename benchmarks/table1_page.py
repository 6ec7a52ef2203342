"""Table 1 as Markdown, from the result file of `benchmarks/table1.py` into a page that has a place for it.

    python -m benchmarks.table1_page benchmarks/results/table1.json docs/interact.md
    python -m benchmarks.table1_page benchmarks/results/further-boards.json docs/interact.md

The place is between `<!-- table1 -->` and `<!-- end of table1 -->`. A row that was not run is shown as missing. Rows
that were judged on other boards are put between `<!-- further-boards -->` and `<!-- end of further-boards -->`.
"""

from typing import Any

from benchmarks.pages import costs, head, paper_lines, put, with_interval, write_page
from benchmarks.table1 import JUDGE_SEED
from busybot.view.protocol import INTERACTION


def table(rows: dict[str, Any], missing: bool = True) -> str:
    """Percent with half the width of the 95 % interval over boards; also of rows that are missing, if wanted."""
    lines = head(INTERACTION)
    for row in INTERACTION.rows:
        if not missing and row.name not in rows:
            continue
        told = rows.get(row.name)
        lines.append(f"| {row.words} | " + " | ".join(_cell(told, *column) for column in INTERACTION.columns()) + " |")
    return "\n".join(lines)


def _cell(row: dict[str, Any] | None, split: str, key: str) -> str:
    if row is None or split not in row:
        return "missing" if row is None else "no reward"
    return with_interval(row[split], key)


def page(text: str, result: dict[str, Any]) -> str:
    """The page with the table in its place."""
    rows = result["rows"]
    if result["judge_seed"] != JUDGE_SEED:
        return put(text, "further-boards", table(rows, missing=False))
    trained = [row["training"] for row in rows.values() if row["training"]]
    lines = [table(rows), *paper_lines(INTERACTION), "", costs(trained, result["machine"])]
    return put(text, "table1", "\n".join(lines))


if __name__ == "__main__":
    write_page(__doc__, page)
