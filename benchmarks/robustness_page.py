"""The table of robustness as Markdown, from the result of `benchmarks/reason_robustness.py` into a page with a place.

    python -m benchmarks.robustness_page benchmarks/results/reason_robustness.json docs/reason.md

The place is between `<!-- robustness -->` and `<!-- end of robustness -->`.
"""

from typing import Any

from benchmarks.disturb import RECORDED
from benchmarks.disturbances import DISTURBANCES
from benchmarks.pages import put, write_page
from busybot.view.robustness_figure import strength_words

BASELINES = ("lookup", "lookup at best", "count", "count at best")
TITLES = {"undisturbed": "undisturbed", "png": "PNG instead of JPEG"}


def table(result: dict[str, Any]) -> str:
    """Percent: Edge-P / Edge-R, and Pred-A behind a comma of those that predict; "-" for who does not see it."""
    trained = list(result["models"])
    columns = [*trained, *BASELINES]
    lines = ["| | | " + " | ".join(f"`{name}`" if name in trained else name for name in columns) + " | known |"]
    lines.append("|---" * (len(columns) + 3) + "|")
    for name in TITLES | DISTURBANCES:
        for row in result["rows"].get(name, []):
            cells = [_cell(row["models"].get(column)) for column in columns]
            title = TITLES[name] if name in TITLES else DISTURBANCES[name].title
            known = f"{100 * row['known']:.1f}"
            lines.append("| " + " | ".join([title, strength(result, name, row), *cells, known]) + " |")
    return "\n".join(lines)


def strength(result: dict[str, Any], name: str, row: dict[str, Any]) -> str:
    """With its unit: "20 %", "5 pixels", "quality 40"; for what has none how many boards there are."""
    if name not in DISTURBANCES:
        return f"{row['boards']} boards"
    if name == "jpeg":
        return f"quality {RECORDED - row['strength']:g}"
    return strength_words(result, name, row["strength"])


def _cell(scores: dict[str, Any] | None) -> str:
    if scores is None:
        return "-"
    told = " / ".join("-" if scores[key] is None else f"{100 * scores[key]:.1f}" for key in ("edge_p", "edge_r"))
    return told if scores["pred_a"] is None else f"{told}, {100 * scores['pred_a']:.1f}"


def what(result: dict[str, Any]) -> str:
    """A line for each disturbance: exactly what is done."""
    done = [name for name in DISTURBANCES if name in result["rows"]]
    return "\n".join(f"- *{DISTURBANCES[name].title}*: {result['disturbances'][name]['what']}." for name in done)


def page(text: str, result: dict[str, Any]) -> str:
    """The page with the table in its place."""
    return put(text, "robustness", f"{table(result)}\n\n{what(result)}")


if __name__ == "__main__":
    write_page(__doc__, page)
