"""Planning with what ships with busybot: procedural objects, the policy `procedural`, the model of relations `event`.

    python -m benchmarks.tables.plan_procedural --work FOLDER --out benchmarks/results/plan-procedural.json

The same tasks, agents and commands as in Table 3, which `benchmarks/tables/table3.py` measures with real objects. The
result names its rows `agents`: a report's Table 3 is that of real objects.
"""

from benchmarks.runner import finish
from benchmarks.tables.table3 import measured, parsed
from busybot.interact.policy.policy_factory import DEFAULT_MODEL
from busybot.reason.models.registry import DEFAULT_REASONER

if __name__ == "__main__":
    options = parsed(__doc__, policy_model=DEFAULT_MODEL, reasoner=[DEFAULT_REASONER])
    for result in measured(options):
        finish("plan-procedural", options, {"agents": result.pop("rows"), **result})
