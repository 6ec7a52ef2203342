"""Table 3 of the protocol: who reaches a goal picture, by the commands that a user types.

    python -m benchmarks.tables.table3 --policy-model MODEL --reasoner FOLDER FOLDER FOLDER --work FOLDER --out FILE
    python -m benchmarks.tables.table3 network --policy-model MODEL --reasoner NETWORK --work FOLDER --out FILE
    python -m benchmarks.tables.table3 learned --policy-model MODEL --learned bc=FOLDER bc-attention=FOLDER \\
        --work FOLDER --out FILE
    python -m benchmarks.tables.table3 procedural --work FOLDER --out benchmarks/results/plan-procedural.json

For each split and each kind of relations: tasks are generated, their histories recorded with the interaction model, and
agents play them. With the first reasoner every agent plays, with the others (trained with other seeds) only those that
are ours or the paper's whole system; learned baselines, which need no reasoner, play by themselves. Every command
resumes, so this one does; a cell appears as soon as it is judged.

Each agent is compared with the paper's whole system, with the same reasoner on the same tasks. `network` plays the
paper's agents with a reasoner of the paper's architecture. `learned` plays several trainings of learned baselines,
whose names begin with their agent's, on the same tasks. By default `procedural` takes what ships with busybot:
procedural objects, its policy, its model of relations. The results of these three name their rows
`agents`: a report's Table 3 is that of real objects and our own model.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.runner import as_typed, assets_name, busybot, finish, named, one_of, option, parser
from busybot.common.atomic_io import read_json
from busybot.common.errors import UsageError
from busybot.evaluation.folder import RESULT
from busybot.evaluation.results import read_result
from busybot.evaluation.statistics import widest
from busybot.interact.policy.policy_factory import DEFAULT_MODEL
from busybot.reason.models.registry import DEFAULT_REASONER
from busybot.training.model_cards import INFO_FILE

SEEDS = {"train": 701, "novel-config": 702, "novel-object": 703}
KINDS = ("one-to-one", "one-to-many")
OURS = ("busybot", "search")
"""The paper's whole system first: it is what all others are compared with, task by task."""
TRUTHS = ("search-true-relations", "search-true-contacts", "search-true-both")
AGENTS = (*OURS, "relation", "predictive", "random", "noop", "oracle", *TRUTHS)
SPLITS = ("novel-object", "novel-config", "train")
ORIGINS = ("dataset", "hashes", "provenance", "versions")
PROVENANCE = ("best_iteration", "boards", "boards_held_out", "data", "held_out", "seed", "versions")
DETAILS = (
    *("interval", "micro", "micro_intervals", "by_features", "solved", "steps", "steps_more", "step_success"),
    "failures_by_cause",
)
THEIRS = ("busybot", "relation", "predictive")
"""The paper's agents, which play with the paper's own network, too: its predictions are not nearly always right."""


def cell(
    split: str, kind: str, options: argparse.Namespace, typed: list[str], usual: tuple[str, ...] = AGENTS
) -> dict[str, Any]:
    """What every agent reached on one dataset of tasks: agent to success and details."""
    tasks = options.work / f"{split}-{kind}"
    assets, model = ("--assets", options.assets), options.policy_model
    seed = ("--seed", str(SEEDS[split]))
    make = ("--split", split, "--tasks", kind, "--boards", str(options.boards), *seed)
    commands = [
        ("generate", str(tasks), *make, *assets),
        ("collect", str(tasks), "--policy", "learned", "--model", model, *seed, *assets),
    ]
    players = [
        (str(number), ",".join(OURS if number else usual), option("--reasoner", reasoner))
        for number, reasoner in enumerate(options.reasoner)
    ]
    learned = folders_of(options.learned)
    players += [(name, f"{agent_of(name)}={folder}", ()) for name, folder in learned.items()]
    for who, agents, reasoner in players:
        out = ("--out", str(place(options, split, kind, who)))
        given = ("--agents", agents, *reasoner, "--policy-model", model, *assets)
        commands.append(("eval", "plan", str(tasks), *given, *out))
    typed += [as_typed(command, _places(options)) for command in commands]
    told = [busybot(*command) for command in commands][2:]
    reasoned, alone = told[: len(options.reasoner)], told[len(options.reasoner) :]
    names = [name for result in reasoned for name in result["agents"]]
    rows = {name: _across(name, reasoned) for name in dict.fromkeys(names)}
    return rows | {name: _across(agent_of(name), [one]) for name, one in zip(learned, alone, strict=True)}


def place(options: argparse.Namespace, split: str, kind: str, who: str = "0") -> Path:
    """Folder of an evaluation: with the reasoner of that number, or of the learned baseline of that name."""
    return Path(options.work / f"judged-{split}-{kind}-{who}")


def origin(options: argparse.Namespace, split: str, kind: str, who: str = "0") -> dict[str, Any]:
    """Which tasks, histories and models an evaluation was about, with what versions."""
    told = read_result(place(options, split, kind, who) / RESULT, "plan")
    return {key: told[key] for key in ORIGINS}


def _places(options: argparse.Namespace) -> dict[str, str]:
    """Names for folders of this machine; what ships with busybot has one that everybody knows."""
    named = {options.assets: "ASSETS", options.policy_model: "POLICY"}
    named |= {str(folder): f"REASONER-{seed}" for seed, folder in enumerate(options.reasoner)}
    named |= {str(folder): name.upper() for name, folder in folders_of(options.learned).items()}
    return {str(options.work): "WORK"} | {where: name for where, name in named.items() if Path(where).is_dir()}


def folders_of(learned: list[str]) -> dict[str, Path]:
    """Folders of the learned baselines' trainings, by their names, of words like `bc=FOLDER`; faults as of `named`."""
    return {name: Path(folder) for name, folder in named(learned, "--learned").items()}


def agent_of(name: str) -> str:
    """What a learned baseline is played as: `bc-attention` is another training of `bc`."""
    return name.partition("-")[0]


def training(folder: Path) -> dict[str, Any]:
    """What a learned baseline was trained on, for how long, and how good it was on held-out boards."""
    told = read_json(folder / "model" / INFO_FILE)["training"]
    return {**read_json(folder / "budget.json"), **{key: told[key] for key in PROVENANCE}}


def _across(agent: str, told: list[dict[str, Any]]) -> dict[str, Any]:
    """Mean success over seeds, each seed's beside it, the widest interval over objects, the first one's details."""
    judged = [result for result in told if agent in result["agents"]]
    rows = [result["agents"][agent] for result in judged]
    values = [row["success"] for row in rows]
    details = {key: rows[0][key] for key in DETAILS}
    details["object_interval"] = widest(row["object_interval"] for row in rows)
    return {"success": sum(values) / len(values), "seeds": values, **details, "timing": judged[0]["timing"][agent]}


def measured(options: argparse.Namespace, agents: tuple[str, ...] = AGENTS) -> Iterator[dict[str, Any]]:
    """The result file's content after every kind of every split."""
    options.work.mkdir(parents=True, exist_ok=True)
    rows: dict[str, Any] = {}
    typed: list[str] = []
    origins: dict[str, Any] = {}
    compared: dict[str, Any] = {}
    for split in SPLITS:
        for kind in KINDS:
            for agent, scores in cell(split, kind, options, typed, agents).items():
                rows.setdefault(agent, {"splits": {}})["splits"].setdefault(split, {})[kind] = scores
                print(f"{split:13} {kind:12} {agent:24} {100 * scores['success']:5.1f}", flush=True)
            if options.reasoner:
                origins[f"{split}, {kind}"] = origin(options, split, kind)
                compared[f"{split}, {kind}"] = against(options, split, kind)
            for name, folder in folders_of(options.learned).items():
                origins[f"{split}, {kind}, {name}"] = origin(options, split, kind, name)
                rows[name]["training"] = [training(folder)]
            about = {"assets": assets_name(options.assets), "tasks": options.boards, "commands": typed}
            yield {**about, "origins": origins, "compared": compared, "rows": rows}


def parsed(words: list[str], **given: Any) -> argparse.Namespace:
    """Options of the command line; what is given counts unless an option says otherwise."""
    made = parser(__doc__)
    made.add_argument("--policy-model", required="policy_model" not in given)
    made.add_argument("--reasoner", nargs="+", required="reasoner" not in given, help="one for each seed")
    made.add_argument("--learned", nargs="*", default=[], help="learned baselines, as bc=FOLDER, bc-again=FOLDER")
    made.add_argument("--boards", type=int, default=50, help="tasks in each cell")
    made.add_argument("--work", type=Path, required=True)
    made.set_defaults(**given)
    return made.parse_args(words)


def main(words: list[str]) -> None:
    options = parsed(words)
    for result in measured(options):
        finish("table3", options, result)


def procedural(words: list[str]) -> None:
    options = parsed(words, policy_model=DEFAULT_MODEL, reasoner=[DEFAULT_REASONER])
    for result in measured(options):
        finish("plan-procedural", options, {"agents": result.pop("rows"), **result})


def learned(words: list[str]) -> None:
    options = parsed(words, reasoner=[])
    if options.reasoner or not options.learned:
        raise UsageError("learned baselines play, and nobody else", "name them with --learned, and no --reasoner")
    for result in measured(options):
        finish("plan-learned", options, {"agents": result.pop("rows"), **result})


def network(words: list[str]) -> None:
    options = parsed(words)
    if len(options.reasoner) > 1 or options.learned:
        raise UsageError("one network plays, and nobody else", "name one --reasoner and no --learned")
    for result in measured(options, THEIRS):
        finish("plan-network", options, {"agents": result.pop("rows"), **result})


def against(options: argparse.Namespace, split: str, kind: str) -> dict[str, Any]:
    """Each agent against the whole system, on the same tasks with the first reasoner: its success less the system's."""
    return dict(read_result(place(options, split, kind) / RESULT, "plan")["compared"])


if __name__ == "__main__":
    one_of(main, learned=learned, network=network, procedural=procedural)
