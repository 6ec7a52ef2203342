"""Planning with what ships with busybot: procedural objects, the policy `procedural`, the model of relations `event`.

    python -m benchmarks.plan_procedural --work FOLDER --out benchmarks/results/plan-procedural.json
    python -m benchmarks.plan_pages benchmarks/results/plan-procedural.json docs/plan.md

The same tasks, agents and commands as in Table 3, which `benchmarks/table3.py` measures with real objects. The result
names its rows `agents`: a report's Table 3 is that of real objects.
"""

from benchmarks.commands import write_result
from benchmarks.table3 import measured, parsed
from busybot.interact.chooser import DEFAULT_MODEL
from busybot.reason.infer import DEFAULT_REASONER

if __name__ == "__main__":
    options = parsed(__doc__, policy_model=DEFAULT_MODEL, reasoner=[DEFAULT_REASONER])
    for result in measured(options):
        write_result(options.out, {"agents": result.pop("rows"), **result})
