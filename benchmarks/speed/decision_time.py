"""Measures the processor time of every agent's decision besides simulation and rendering.

    python -m benchmarks.speed.decision_time --work FOLDER --out benchmarks/results/decision_time.json

Tasks of unseen objects are made, recorded and played as for Table 3 (`benchmarks/tables/table3.py`, whose options this
has, too), by default with procedural objects and the shipped models. Times are those that `busybot eval plan` measures
while it plays: from the picture to the answer, with what is learned from the outcome.
"""

from typing import Any

from benchmarks.runner import finish
from benchmarks.tables.table3 import KINDS, SEEDS, cell, origin, parsed
from busybot.interact.policy.policy_factory import DEFAULT_MODEL
from busybot.reason.models.registry import DEFAULT_REASONER

SPLIT = "novel-object"
GATE_MS = 50.0
"""Of a decision, on average."""


def main() -> None:
    options = parsed(__doc__, policy_model=DEFAULT_MODEL, reasoner=[DEFAULT_REASONER], boards=10)
    options.work.mkdir(parents=True, exist_ok=True)
    typed: list[str] = []
    agents: dict[str, Any] = {}
    origins: dict[str, Any] = {}
    for kind in KINDS:
        for name, scores in cell(SPLIT, kind, options, typed).items():
            agents.setdefault(name, {})[kind] = scores["timing"]
            print(f"{kind:12} {name:24} {scores['timing']['cpu_ms'] or 0:6.1f} ms", flush=True)
        origins[kind] = origin(options, SPLIT, kind)
    figures = {"tasks": options.boards, "gate_ms": GATE_MS, "commands": typed, "origins": origins, "decisions": agents}
    finish("decision-time", options, figures, seed=SEEDS[SPLIT])  # every origin has hashes of its own


if __name__ == "__main__":
    main()
