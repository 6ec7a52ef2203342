"""The paper's pipeline from five seeds: each one's policy records, its reasoner learns from that, its agents plan.

    python -m benchmarks.tables.whole_pipeline --assets DIR --work FOLDER --out benchmarks/results/whole-pipeline.json
        [--policies benchmarks/models/lean-free-0 ...] [--seeds 0,1] [--boards 150] [--judged 100] [--tasks 30]

In Tables 2 and 3 the seeds of reasoners and agents share the recordings of one policy. Here nothing that is learned is
shared: seed N has the N-th policy, boards of its own to train on, on which that policy acts, the `event` model that is
trained on them, and the histories of that policy on the boards that it is judged on. These, and the tasks, are the same
for all seeds: the first boards of Table 2's novel sets, and the first of Table 3's tasks.

Every command resumes, so this one does: run it again with the same FOLDER after any interruption. A seed appears in the
result as soon as it is judged; with `--seeds` others are left as they are there, so another machine can go on.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks import runner
from benchmarks.tables.table2 import EVENT, JUDGED, SCORES, RecordedSplit, answered, recording
from benchmarks.tables.table3 import KINDS, OURS, cell, origin
from busybot.evaluation.reference_tables import NOVEL
from busybot.training.model_cards import file_hashes

POLICIES = tuple(f"benchmarks/models/lean-free-{seed}" for seed in range(5))
FIRST_SEED = 611
"""Of the boards that the first seed is trained on; no table has these."""


def run(seed: int, policy: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Record, train and judge with everything that is this seed's own."""
    work, assets = arguments.work / str(seed), arguments.assets
    work.mkdir(parents=True, exist_ok=True)
    places = {str(work): "WORK", policy: "POLICY", assets: "ASSETS"}
    commands: list[tuple[str, ...]] = []

    def recorded(name: str, one: RecordedSplit) -> Path:
        commands.extend(recording(work / name, one, one.boards, assets, ("learned", "--model", policy)))
        for command in commands[-2:]:
            runner.busybot(*command)
        return work / name

    own = RecordedSplit("train", arguments.boards, FIRST_SEED + seed)
    train, model = recorded("train", own), work / "event"
    commands.append(("train", "reason", *EVENT, "--data", str(train), "--out", str(model), "--seed", str(seed)))
    told = runner.train(model, *commands[-1])
    relations = {}
    for split in NOVEL:
        folder = recorded(split, replace(JUDGED[split], boards=arguments.judged))
        commands.append(
            ("eval", "reason", str(folder), "--reasoner", str(model), "--decoders", str(train), "--assets", assets)
        )
        relations[split] = answered(commands[-1], work / f"{split}.json", folder)["result"]
    typed = [runner.as_typed(command, places) for command in commands]
    plans = _planned(policy, model, work / "plans", arguments, typed)
    return {
        "commands": typed,
        "policy": {"model_sha256": file_hashes(Path(policy))},
        "training": {key: value for key, value in told.items() if key not in ("out", "model")},
        "relations": relations,
        **plans,
    }


def _planned(policy: str, model: Path, work: Path, arguments: argparse.Namespace, typed: list[str]) -> dict[str, Any]:
    """What agents of this seed reach, by split and kind of relations, and which tasks and histories these were."""
    given = {"work": work, "assets": arguments.assets, "boards": arguments.tasks, "learned": []}
    options = argparse.Namespace(**given, policy_model=policy, reasoner=[model])
    work.mkdir(exist_ok=True)
    plans: dict[str, dict[str, Any]] = {}
    origins = {}
    for split in NOVEL:
        for kind in KINDS:
            plans.setdefault(split, {})[kind] = cell(split, kind, options, typed, OURS)
            origins[f"{split}, {kind}"] = origin(options, split, kind)
    return {"plans": plans, "origins": origins}


def main(words: list[str]) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--work", type=Path, required=True, help="for recordings and models; continued if it exists")
    options.add_argument("--policies", nargs="+", default=list(POLICIES), help="trained policies, one for each seed")
    options.add_argument("--seeds", help="numbers of policies, comma-separated; all by default")
    options.add_argument("--boards", type=int, default=150, help="to train a reasoner on")
    options.add_argument("--judged", type=int, default=100, help="boards of each novel split to judge it on")
    options.add_argument("--tasks", type=int, default=30, help="in each cell of plans")
    arguments = options.parse_args(words)
    about = {"assets": runner.assets_name(arguments.assets)}
    result: dict[str, Any] = {**about, "rows": runner.told_rows(arguments.out, "whole-pipeline", **about)}
    every = [str(number) for number in range(len(arguments.policies))]
    for seed in map(int, runner.chosen(arguments.seeds or ",".join(every), every)):
        row = result["rows"][str(seed)] = run(seed, arguments.policies[seed], arguments)
        runner.finish("whole-pipeline", arguments, result, seed=FIRST_SEED)  # rows have hashes and seeds of their own
        for split, scores in row["relations"].items():
            told = " ".join(f"{key} {100 * (scores[key] or 0):5.1f}" for key in SCORES[:2])
            print(f"seed {seed} {split:13} {told}", flush=True)


if __name__ == "__main__":
    runner.one_of(main)
