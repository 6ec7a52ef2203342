"""Table 1 as Markdown, from the result file of `benchmarks/table1.py` into a page that has a place for it.

    python -m benchmarks.table1_page benchmarks/results/table1.json docs/interact.md

The place is between `<!-- table1 -->` and `<!-- end of table1 -->`. A row that was not run is shown as missing.
"""

from typing import Any

from benchmarks.pages import costs, head, paper_lines, put, with_interval, write_page
from busybot.view.protocol import INTERACTION


def table(result: dict[str, Any]) -> str:
    """Percent with half the width of the 95 % interval over boards; the paper's rows below."""
    lines = head(INTERACTION)
    for row in INTERACTION.rows:
        told = result["rows"].get(row.name)
        lines.append(f"| {row.words} | " + " | ".join(_cell(told, *column) for column in INTERACTION.columns()) + " |")
    return "\n".join([*lines, *paper_lines(INTERACTION)])


def _cell(row: dict[str, Any] | None, split: str, key: str) -> str:
    if row is None or split not in row:
        return "missing" if row is None else "no reward"
    return with_interval(row[split], key)


def page(text: str, result: dict[str, Any]) -> str:
    """The page with the table in its place."""
    trained = [row["training"] for row in result["rows"].values() if row["training"]]
    return put(text, "table1", f"{table(result)}\n\n{costs(trained, result['machine'])}")


if __name__ == "__main__":
    write_page(__doc__, page)
