"""What a decision costs: processor time of every agent besides simulation and rendering.

    python -m benchmarks.decision_time --work FOLDER --out benchmarks/results/decision_time.json
    python -m benchmarks.plan_pages benchmarks/results/decision_time.json docs/plan.md

Tasks of unseen objects are made, recorded and played as for Table 3 (`benchmarks/table3.py`, whose options this has,
too), by default with procedural objects and the shipped models. Times are those that `busybot eval plan` measures
while it plays: from the picture to the answer, with what is learned from the outcome.
"""

from typing import Any

from benchmarks.commands import write_result
from benchmarks.table3 import KINDS, SEEDS, cell, parsed, place
from busybot.evaluation.folder import RESULT
from busybot.files import read_json
from busybot.interact.chooser import DEFAULT_MODEL
from busybot.reason.infer import DEFAULT_REASONER
from busybot.workers import machine

SPLIT = "novel-object"
GATE_MS = 50.0
"""Of a decision, on average."""
ORIGINS = ("dataset", "provenance", "versions")


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
        told = read_json(place(options, SPLIT, kind) / RESULT)
        origins[kind] = {key: told[key] for key in ORIGINS}
    about = {"machine": machine(), "seed": SEEDS[SPLIT], "tasks": options.boards, "gate_ms": GATE_MS}
    write_result(options.out, {**about, "commands": typed, "origins": origins, "decisions": agents})


if __name__ == "__main__":
    main()
