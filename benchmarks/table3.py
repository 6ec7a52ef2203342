"""Table 3 of the protocol: who reaches a goal picture, by the commands that a user types.

    python -m benchmarks.table3 --policy-model MODEL --reasoner FOLDER FOLDER FOLDER --work FOLDER --out FILE

For each split and each kind of relations: tasks are generated, their histories recorded with the interaction model, and
agents play them. With the first reasoner every agent plays, with the others (trained with other seeds) only those that
are ours or the paper's whole system; learned baselines, which need no reasoner, play by themselves. Every command
resumes, so this one does; a cell appears as soon as it is judged.
"""

import argparse
from pathlib import Path
from typing import Any

from benchmarks.commands import as_typed, busybot, machine, write_result

SEEDS = {"train": 701, "novel-config": 702, "novel-object": 703}
KINDS = ("one-to-one", "one-to-many")
OURS = ("search", "busybot")
TRUTHS = ("search-true-relations", "search-true-contacts", "search-true-both")
AGENTS = (*OURS, "relation", "predictive", "random", "noop", "oracle", *TRUTHS)
DETAILS = ("interval", "micro", "by_features", "solved", "steps", "steps_more", "step_success", "failures_by_cause")


def cell(split: str, kind: str, options: argparse.Namespace, typed: list[str]) -> dict[str, Any]:
    """What every agent reached on one dataset of tasks: agent to success and details."""
    places = {str(options.work): "WORK", options.assets: "ASSETS", options.policy_model: "POLICY"}
    places |= {str(folder): f"REASONER-{seed}" for seed, folder in enumerate(options.reasoner)}
    tasks = options.work / f"{split}-{kind}"
    assets, model = ("--assets", options.assets), options.policy_model
    make = ("--split", split, "--tasks", kind, "--boards", str(options.boards), "--seed", str(SEEDS[split]))
    commands = [
        ("generate", str(tasks), *make, *assets),
        ("collect", str(tasks), "--policy", "learned", "--model", model, "--seed", str(SEEDS[split]), *assets),
    ]
    for seed, reasoner in enumerate(options.reasoner):
        agents = AGENTS if seed == 0 else OURS
        who = ("--agents", ",".join(agents), "--model", str(reasoner), "--policy-model", model)
        out = ("--out", str(options.work / f"judged-{split}-{kind}-{seed}"))
        commands.append(("eval", "plan", str(tasks), *who, *assets, *out))
    if options.learned:
        who = ("--agents", ",".join(options.learned), "--policy-model", model)
        out = ("--out", str(options.work / f"judged-{split}-{kind}-learned"))
        commands.append(("eval", "plan", str(tasks), *who, *assets, *out))
    typed += [as_typed(command, places) for command in commands]
    told = [busybot(*command) for command in commands][2:]
    names = [name for result in told for name in result["agents"]]
    return {name: _across(name, told) for name in dict.fromkeys(names)}


def _across(agent: str, told: list[dict[str, Any]]) -> dict[str, Any]:
    """Mean success over seeds, each seed's beside it, and the first one's details."""
    judged = [result for result in told if agent in result["agents"]]
    rows = [result["agents"][agent] for result in judged]
    values = [row["success"] for row in rows]
    details = {key: rows[0][key] for key in DETAILS}
    return {"success": sum(values) / len(values), "seeds": values, **details, "timing": judged[0]["timing"][agent]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy-model", required=True)
    parser.add_argument("--reasoner", nargs="+", required=True, help="one for each seed")
    parser.add_argument("--learned", nargs="*", default=[], help="learned baselines, as bc=FOLDER")
    parser.add_argument("--assets", default="procedural")
    parser.add_argument("--boards", type=int, default=50, help="tasks in each cell")
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    rows: dict[str, Any] = {}
    typed: list[str] = []
    for split in ("novel-object", "novel-config", "train"):
        for kind in KINDS:
            for agent, scores in cell(split, kind, options, typed).items():
                rows.setdefault(agent, {"splits": {}})["splits"].setdefault(split, {})[kind] = scores
                print(f"{split:13} {kind:12} {agent:24} {100 * scores['success']:5.1f}", flush=True)
            told = {"machine": machine(), "tasks": options.boards, "commands": typed, "rows": rows}
            write_result(options.out, told)


if __name__ == "__main__":
    main()
