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
    return "\n".join([*lines, *paper_lines(PLANNING), *_trainings(result["rows"])])


def _trainings(rows: dict[str, Any]) -> list[str]:
    """What the learned agents were trained on and for how long."""
    return [f"\n`{name}`: {_training(told)}" for name, row in rows.items() for told in row.get("training", [])]


def _training(told: dict[str, Any]) -> str:
    held_out = f"{100 * told['held_out']['success']:.1f} % on {told['boards_held_out']} boards held out"
    return (
        f"{told['minutes']:.0f} of {told['minutes_allowed']:.0f} minutes, {told['iterations']:,} iterations on "
        f"{told['boards']} boards of training objects with {told['states_explored']:,} states, seed {told['seed']}; "
        f"{held_out}, at its best iteration, {told['best_iteration']:,}."
    )


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
