"""Our rows of Tables 1 to 3 beside the paper's, in short, for the README.

    python -m benchmarks.overview benchmarks/results README.md

The place is between `<!-- overview -->` and `<!-- end of overview -->`. The table shows the worst of all training
seeds, because a mean hides it.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.pages import put
from busybot.view.protocol import INTERACTION, NOVEL, PLANNING, REASONING, TABLES, Table


@dataclass(frozen=True)
class Line:
    """A line of the overview: which of our rows, and which of their numbers."""

    words: str
    table: Table
    rows: tuple[str, ...]
    key: str


FREE, STRICT = (tuple(f"{mode}-{seed}" for seed in range(3)) for mode in ("free", "strict"))
LINES = (
    Line("actions that move something", INTERACTION, FREE, "precision"),
    Line("links found", INTERACTION, FREE, "recall"),
    Line("actions that move something, *strict*", INTERACTION, STRICT, "precision"),
    Line("links found, *strict*", INTERACTION, STRICT, "recall"),
    Line("relations: precision", REASONING, ("event",), "edge_p"),
    Line("relations: recall", REASONING, ("event",), "edge_r"),
    Line("predicted steps, all responders right", REASONING, ("event",), "pred_a"),
    Line("goals reached, one-to-one", PLANNING, ("search",), "one-to-one"),
    Line("goals reached, one-to-many", PLANNING, ("search",), "one-to-many"),
)


def least(told: dict[str, Any], split: str, key: str) -> float | None:
    """The worst of a row's seeds; None if it was not judged on the split."""
    judged = told.get("splits", told).get(split)
    if judged is None:
        return None
    if "least" in judged:  # Table 2
        return float(judged["least"][key])
    return float(min(judged[key]["seeds"]) if isinstance(judged.get(key), dict) else judged[key])  # Table 3, 1


def cells(line: Line, told: dict[str, Any], split: str) -> list[str]:
    """Ours, the paper's and the gate; a gate that is missed is bold."""
    known = [told[name] for name in line.rows if name in told]
    values = [value for row in known if (value := least(row, split, line.key)) is not None]
    row = next(row for row in line.table.rows if row.name == line.rows[0])
    assert row.paper is not None and row.gate is not None
    paper = line.table.at(line.table.paper[row.paper], split, line.key)
    gate = line.table.at(line.table.gates[row.gate], split, line.key)
    ours = f"{100 * min(values):.1f}" if values else "missing"
    missed = values and gate is not None and 100 * min(values) < gate
    return [f"**{ours}**" if missed else ours, f"{paper:g}", f"{gate:g}"]


def table(results: dict[int, dict[str, Any]]) -> str:
    """Markdown; results by the number of their table."""
    lines = [
        "| percent | " + " | ".join(f"{words} | paper | gate" for words in NOVEL.values()) + " |",
        "|---" * 7 + "|",
    ]
    for line in LINES:
        told = results[line.table.number]["rows"]
        values = [cell for split in NOVEL for cell in cells(line, told, split)]
        lines.append(f"| {line.words} | {' | '.join(values)} |")
    return "\n".join(lines)


def page(text: str, folder: Path) -> str:
    """The page with the table in its place, from the folder of the results."""
    files = {one.number: folder / f"table{one.number}.json" for one in TABLES}
    return put(text, "overview", table({number: json.loads(file.read_text()) for number, file in files.items()}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path)
    parser.add_argument("page", type=Path)
    arguments = parser.parse_args()
    arguments.page.write_text(page(arguments.page.read_text(), arguments.results))


if __name__ == "__main__":
    main()
