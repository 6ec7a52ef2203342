"""Tables from result files into pages that have a place for them."""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from busybot.view.protocol import Table
from busybot.view.report_sections import half_width, number


def put(text: str, name: str, content: str) -> str:
    """The page with the content between `<!-- NAME -->` and `<!-- end of NAME -->`."""
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    before, rest = text.split(begin)
    return f"{before}{begin}\n{content}\n{end}{rest.split(end)[1]}"


def head(table: Table) -> list[str]:
    """The first two lines of a table as Markdown."""
    heads = [f"{split}: {table.keys[key]}" for split, key in table.columns()]
    return ["| | " + " | ".join(heads) + " |", "|---" * (1 + len(heads)) + "|"]


def with_interval(judged: dict[str, Any], key: str) -> str:
    """A share as percent with half the width of its 95 % interval."""
    if judged[key] is None:
        return "-"
    low, high = judged["intervals"][key] or (judged[key], judged[key])
    return f"{number(100 * judged[key])} {half_width(100 * low, 100 * high)}"


def paper_lines(table: Table) -> list[str]:
    """The paper's rows as Markdown."""
    cells = {name: ["" if value is None else f"{value:g}" for value in row] for name, row in table.paper.items()}
    return [f"| *the paper: {name}* | {' | '.join(row)} |" for name, row in cells.items()]


def costs(training: list[dict[str, Any]], machine: dict[str, Any]) -> str:
    """A sentence on time and memory of the trainings that nothing interrupted; empty if there is none."""
    known = [told["cost"] for told in training if told["cost"]]
    if not known:
        return ""
    least, most = (f"{end(cost['seconds'] for cost in known) / 60:.0f}" for end in (min, max))
    return (
        f"From nothing to a trained model: {least if least == most else f'{least} to {most}'} minutes and at most "
        f"{max(cost['megabytes'] for cost in known) / 1000:.1f} GB of memory on {machine['cores']} cores "
        f"({len(known)} of {len(training)} trainings; what was interrupted is not timed)."
    )


def write_page(description: str | None, page: Callable[[str, dict[str, Any]], str]) -> None:
    """The command of a table: RESULT PAGE."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("result", type=Path)
    parser.add_argument("page", type=Path)
    arguments = parser.parse_args()
    arguments.page.write_text(page(arguments.page.read_text(), json.loads(arguments.result.read_text())))
