"""Tables beside Table 3 as Markdown, from their result files into docs/plan.md, which has places for them.

python -m benchmarks.plan_pages benchmarks/results/plan-procedural.json docs/plan.md
python -m benchmarks.plan_pages benchmarks/results/decision_time.json docs/plan.md
"""

from typing import Any

from benchmarks.pages import head, put, write_page
from benchmarks.table3 import KINDS
from benchmarks.table3_page import row_line
from busybot.view.protocol import PLANNING


def page(text: str, result: dict[str, Any]) -> str:
    """The page with the result's table in its place."""
    if "decisions" in result:
        return put(text, "decision-time", times(result))
    return put(text, "plan-procedural", procedural(result))


def procedural(result: dict[str, Any]) -> str:
    """Percent, of every agent that was run."""
    rows = [row for row in PLANNING.rows if row.name in result["agents"]]
    return "\n".join([*head(PLANNING), *(row_line(row, result["agents"]) for row in rows)])


def times(result: dict[str, Any]) -> str:
    """Milliseconds of every agent: the mean, and what 95 % of its decisions stay below; the gate is for the mean."""
    gate, agents = result["gate_ms"], result["decisions"]
    lines = [f"| CPU-ms for each decision | 1-1 | 1-many | at most {gate:g} |", "|---|---|---|---|"]
    for row in PLANNING.rows:
        if row.name in agents:
            told = [agents[row.name][kind] for kind in KINDS]
            within = all(timing["cpu_ms"] is None or timing["cpu_ms"] <= gate for timing in told)
            lines.append(f"| {row.words} | {' | '.join(map(_time, told))} | {'yes' if within else 'no'} |")
    return "\n".join(lines)


def _time(timing: dict[str, Any]) -> str:
    if timing["cpu_ms"] is None:
        return "-"
    return f"{timing['cpu_ms']:.1f} (95 %: {timing['cpu_ms_p95']:.1f}; model {_model(timing):.1f})"


def _model(timing: dict[str, Any]) -> float:
    """Of the mean, the networks of the interaction model."""
    return float(timing["cpu_ms"] - timing["cpu_ms_without_model"])


if __name__ == "__main__":
    write_page(__doc__, page)
