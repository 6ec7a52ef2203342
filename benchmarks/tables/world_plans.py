"""Planning where causes are hard: who reaches a goal in every world, by the commands that a user types.

    python -m benchmarks.tables.world_plans --model MODEL --work FOLDER --assets DIR
        --out benchmarks/results/world-plans.json [--boards 40] [--only gates,time] [--learned bc=FOLDER ppo=FOLDER]
        [--seeds FOLDER FOLDER]
    python -m benchmarks.tables.world_plans --only lock-1-to-4,lock-5-to-8 --model MODEL --work FOLDER --assets DIR
        --out benchmarks/results/lock-plans.json
    python -m benchmarks.tables.world_plans --only lock-1-to-4,lock-5-to-8 --model MODEL --work FOLDER --assets DIR
        --history curious --policy FOLDER --out benchmarks/results/lock-plans-curious.json

For each world boards of the training split with a task (seed 829, which nothing was trained on) are made, the scripted
policy records 30 actions on each (an oracle of contacts), and agents play from the start, at most eight steps
(`--actions`; all tasks can be done in eight):
`mechanism` with MODEL, a trained model of that variant; `search`, the paper's three agents, `random`, `noop` and
`oracle` with what ships with busybot. No test split is looked at. Every command resumes, so this one does. Learned
agents (`--learned`) play where they can practise: in `gates` and `lock`, whose boards show what their links say.

Who records may be another policy (`--history`): `learned`, or `curious`, which asks MODEL what would tell most, each
with the interaction model of `--policy`. What is behind locks that nobody opened, no agent knows; more recorded actions
(`--steps`) open more.

All agents are compared with `mechanism`, task by task (`compared`). Trainings of the same variant from other seeds
(`--seeds`) play the same tasks with the same histories, and stand by themselves.

Asked for by name, boards of `lock` have so many locks behind each other: five and more take boards of more links.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.runner import (
    as_typed,
    assets_name,
    busybot,
    chosen,
    finish,
    generating,
    one_of,
    option,
    parser,
    settings,
    told_rows,
)
from benchmarks.tables.table3 import folders_of, training
from busybot.boards.task import MAX_STEPS
from busybot.boards.worlds import WORLDS
from busybot.common.atomic_io import read_json
from busybot.common.errors import UsageError
from busybot.common.rng import generator
from busybot.evaluation.folder import BOARDS, judged_lines
from busybot.plan.metrics import JudgedTask, summarise
from busybot.reason.models.registry import DEFAULT_REASONER
from busybot.training.model_cards import file_hashes, find_folder

KIND, SEED, STEPS = "world-plans", 829, 30
POLICY = "policy"
"""What a result calls the interaction model of whoever recorded."""
LOCKS = {
    "lock-1-to-4": settings("depth=[1,4]"),
    "lock-5-to-8": settings("depth=[5,8]", "links=[9,12]"),
}
"""How boards of `lock` are drawn beside its own way."""
NAMES = (*WORLDS, *LOCKS)
AGENTS = ("search", "relation", "predictive", "busybot", "random", "noop", "oracle")
PRACTISED = ("gates", "lock", "lock-1-to-4")
"""Where agents can practise: see `busybot.plan.learning.board_graph`; with more locks there are more objects than they
see."""
DETAILS = (
    "success", "micro", "micro_intervals", "solved", "solved_interval", "steps", "steps_over_shortest", "step_success",
    "failures_by_cause",
)  # fmt: skip


def commands(name: str, options: argparse.Namespace) -> list[tuple[str, ...]]:
    """That make the tasks of a world, or of one of `LOCKS`, record their histories and let agents play."""
    longer = "" if options.steps == STEPS else f"-{options.steps}"
    tasks, assets = options.work / f"{name}-{options.history}{longer}", ("--assets", options.assets)
    seeing = ("--policy", options.history, *option("--model", options.policy))
    seeing += ("--reasoner", str(options.model)) if options.history == "curious" else ()
    drawn = generating(tasks, "train", options.boards, SEED, options.assets)
    more = () if options.actions == MAX_STEPS else settings(f"steps={options.actions}")
    playing = ("eval", "plan", str(tasks), "--policy-model", "procedural", *more, *assets)
    played = f"{tasks}-{options.actions}-actions" if more else str(tasks)
    players: list[tuple[str, str, tuple[str, ...]]] = [
        ("mechanism", "mechanism", ("--reasoner", str(options.model))),
        ("others", ",".join(AGENTS), ("--reasoner", DEFAULT_REASONER)),
    ]
    players += [("learned", ",".join(options.learned), ())] if options.learned and name in PRACTISED else []
    return [
        (*drawn, "--world", "lock" if name in LOCKS else name, "--tasks", "reach", *LOCKS.get(name, ())),
        ("collect", str(tasks), *seeing, "--steps", str(options.steps), "--seed", str(SEED), *assets),
        *((*playing, "--agents", agents, *reasoner, "--out", f"{played}-{who}") for who, agents, reasoner in players),
    ]


def measured(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The result file's content after every world."""
    options.work.mkdir(parents=True, exist_ok=True)
    rows = told_rows(options.out, KIND)
    told_before = read_json(options.out) if options.out.exists() else {}
    assets, typed = assets_name(options.assets), list(told_before.get("commands", []))
    if told_before and _way(told_before, assets) != (options.history, options.steps, options.actions, assets):
        what = "it has other histories, other numbers of actions, or other objects"
        raise UsageError(f"{options.out}: {what}", "name another file")
    names = {str(options.work): "WORK", str(options.model): "MODEL", str(options.assets): "ASSETS"}
    names |= {options.policy: "POLICY"} if options.policy else {}
    names |= {str(seed): seed.name.upper() for seed in options.seeds}
    names |= {str(folder): name.upper() for name, folder in folders_of(options.learned).items()}
    for world in chosen(options.only, NAMES) if options.only else WORLDS:
        asked = commands(world, options)
        others = seeded(asked[2], options.seeds)
        words = [as_typed(command, names) for command in (*asked, *others.values())]
        typed = [one for one in typed if one not in words] + words
        told = [busybot(*command) for command in asked][2:]
        played = {name: row for one in told for name, row in one["agents"].items()}
        learned = {name: folder for name, folder in folders_of(options.learned).items() if name in played}
        rows[world] = {
            "tasks": options.boards,
            "least_steps": told[0]["least_steps"],
            "agents": {name: _reached(row) for name, row in played.items()},
            "training": {name: _training(folder) for name, folder in learned.items()},
            "compared": compared([Path(command[-1]) for command in asked[2:]], list(played), world),
            "seeds": {name: _reached(busybot(*command)["agents"]["mechanism"]) for name, command in others.items()},
            **{key: _grouped([one[key] for one in told]) for key in ("by_locks", "by_unmoved")},
        }
        yield {
            "assets": assets,
            "history": options.history,
            "steps": options.steps,
            "actions": options.actions,
            "commands": typed,
            "rows": {one: rows[one] for one in NAMES if one in rows},
        }


def _way(told: dict[str, Any], assets: str) -> tuple[str, int, int, str]:
    """Who recorded, how many actions, how many agents may take, and the objects; older results do not tell it."""
    return (
        told.get("history", "scripted"),
        told.get("steps", STEPS),
        told.get("actions", MAX_STEPS),
        told.get("assets", assets),
    )


def seeded(playing: tuple[str, ...], seeds: list[Path]) -> dict[str, tuple[str, ...]]:
    """The command by which `mechanism` plays, for each of the variant's other trainings, by its name."""
    place = playing.index("--reasoner") + 1
    return {
        seed.name: (*playing[:place], str(seed), *playing[place + 1 : -1], f"{playing[-1]}-{seed.name}")
        for seed in seeds
    }


def compared(evaluations: list[Path], agents: list[str], world: str) -> dict[str, Any]:
    """Each agent against the first one, on the same tasks, as within one evaluation."""
    first, *others = (dict(judged_lines(folder / BOARDS, JudgedTask)) for folder in evaluations)
    tasks = []
    for board, task in sorted(first.items()):
        rollouts = task.rollouts + tuple(one for other in others for one in other[board].rollouts)
        tasks.append(task.model_copy(update={"rollouts": rollouts}))
    rng = generator(SEED, world, 0, "world-plans/compared")
    return dict(summarise(tasks, agents, rng)["compared"])


def _reached(row: dict[str, Any]) -> dict[str, Any]:
    return {key: row[key] for key in DETAILS}


def _training(folder: Path) -> dict[str, Any]:
    """How an agent was trained, and which weights came of it."""
    return {**training(folder), "files": file_hashes(folder / "model")}


def _grouped(told: list[dict[str, dict[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Figures of groups of tasks, of all agents."""
    return {group: {name: share for one in told for name, share in one[group].items()} for group in told[0]}


def parsed(words: list[str] | None) -> argparse.Namespace:
    options = parser(__doc__)
    options.add_argument("--model", type=Path, required=True, help="trained model of the variant mechanism")
    options.add_argument("--work", type=Path, required=True, help="for tasks, histories and evaluations")
    options.add_argument("--only", help="names of worlds, comma-separated; all by default")
    options.add_argument(
        "--history", choices=("scripted", "learned", "curious"), default="scripted", help="who records"
    )
    options.add_argument("--policy", help="interaction model of whoever records; the shipped one by default")
    options.add_argument("--steps", type=int, default=STEPS, help="recorded actions on each board")
    options.add_argument("--actions", type=int, default=MAX_STEPS, help="that an agent may take at most")
    options.add_argument("--boards", type=int, default=40, help="tasks of each world")
    options.add_argument("--learned", nargs="*", default=[], help="learned agents, as bc=FOLDER")
    options.add_argument("--seeds", nargs="*", type=Path, default=[], help="the variant trained from other seeds")
    return options.parse_args(words)


def main(words: list[str] | None = None) -> None:
    arguments = parsed(words)
    hashes = {"models": models_of(arguments)}
    for result in measured(arguments):
        finish(KIND, arguments, result, hashes=hashes, seed=SEED)


def models_of(options: argparse.Namespace) -> dict[str, dict[str, str]]:
    """Hashes of the files of all models, with those that earlier worlds of the same file were played with.

    Raises:
        UsageError: two trainings have one name, or the file has worlds with another model.
    """
    folders = {"mechanism": options.model, **{seed.name: seed for seed in options.seeds}}
    if len(folders) <= len(options.seeds) or POLICY in folders:
        what = "two trainings have one name, or one is called policy"
        raise UsageError(what, "name each folder of a training otherwise")
    found = {name: file_hashes(find_folder(model, "reason")) for name, model in folders.items()}
    if options.policy:
        found[POLICY] = file_hashes(find_folder(options.policy, "interact"))
    earlier = read_json(options.out)["hashes"]["models"] if options.out and options.out.exists() else {}
    if others := [name for name, files in found.items() if earlier.get(name, files) != files]:
        raise UsageError(f"{options.out}: it has worlds with another {others[0]}", "name another file")
    return {**earlier, **found}


if __name__ == "__main__":
    one_of(main)
