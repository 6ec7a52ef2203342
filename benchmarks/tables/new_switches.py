"""A test set that nobody has looked at: switches whose shapes a seed draws, acted on by models that were made before.

    python -m benchmarks.tables.new_switches --work FOLDER --out benchmarks/results/new-switches.json
    python -m benchmarks.tables.new_switches --models FOLDER FOLDER --work FOLDER
        --out benchmarks/results/new-switches-real.json

A library is made whose novel switches are `--drawn` ones of families that its seed draws; the generator was written
after the models that are judged, and looked at with other seeds. The shipped interaction policy acts ten times on each
board, free and strict, beside random actions and the oracle; and on boards of the novel switches of the default
library, whose failures were looked at while policies were made. Relations are found in recordings of the scripted
policy on the new ones. Both sets of boards are frozen (`datasets/worlds/paper.json`), so every judging is in the log.

Other interaction models (`--models`), free, are judged on the new switches alone, and nobody else is again.

Intervals are those over boards, and over switches and their boards. The command resumes; what was judged is not judged
again.
"""

import argparse
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks import runner
from benchmarks.tables.world_gates import digest_of, frozen
from busybot.common.errors import UsageError
from busybot.datasets.dataset import Dataset
from busybot.interact.metrics import JudgedBoard
from busybot.objects.procedural.switches.drawn import MOTIONS
from busybot.training.model_cards import file_hashes, find_folder

KIND, SEED, STEPS = "new-switches", 2026, 30
BOARD_SEED, BOARDS = frozen.SEED, frozen.BOARDS
"""Of the frozen sets."""
POLICIES = {
    "free": ("--model", "procedural"),
    "strict": ("--model", "procedural", "--strict"),
    "random": ("--model", "random"),
    "oracle": ("--model", "scripted"),
}
TRAINED = ("event", "mechanism")
REASONERS = (*TRAINED, "count")
SHARES = ("precision", "recall", "recall_objects")


def motions(boards: Sequence[JudgedBoard]) -> dict[str, list[int]]:
    """By how links move: how many were moved, of how many."""
    moved: dict[str, list[bool]] = defaultdict(list)
    for board in boards:
        found = board.moved()
        for number, link in enumerate(board.links):
            moved[motion_of(link.key)].append(number in found)
    return {name: [sum(one), len(one)] for name, one in sorted(moved.items())}


def motion_of(key: str) -> str:
    """How a drawn switch moves, by its number; of another one its family."""
    family, number = key.split("/")[1].rsplit("-", 1)
    return tuple(MOTIONS)[(int(number) - 1) % len(MOTIONS)] if family == "drawn" else family


def interacted(folder: Path, policy: tuple[str, ...], assets: str, out: Path) -> dict[str, Any]:
    """What came of a policy's actions on the boards of a dataset; it is named as the command takes it."""
    told = runner.busybot("eval", "interact", str(folder), *policy, "--assets", assets, "--out", str(out))
    lines = (out / "boards.jsonl").read_text().splitlines()
    boards = sorted(map(JudgedBoard.model_validate_json, lines), key=lambda one: one.board)
    assert len(boards) == told["boards"]
    return {
        **{key: told[key] for key in SHARES},
        "boards": told["boards"],
        "intervals": {key: told["intervals"][key] for key in SHARES},
        "switches": {"intervals": told["object_intervals"], "motions": motions(boards)},
        "failures_by_cause": told["failures_by_cause"],
        "missed_links": told["missed_links"],
    }


def related(
    folder: Path, boards: int, assets: str, work: Path, models: Mapping[str, dict[str, str]]
) -> Mapping[str, Any]:
    """Precision and recall of relations by each reasoner, after all actions of the scripted policy.

    Args:
        boards: so many the folder has; an earlier judging may be of fewer.
        models: hashes of the files of those that are trained.
    """
    runner.busybot("collect", str(folder), "--policy", "scripted", "--steps", str(STEPS), "--assets", assets)
    rows = {}
    for reasoner in REASONERS:
        out = work / f"reasoned-{reasoner}-{boards}-{digest_of(models.get(reasoner, {}))}.json"
        done = runner.earlier(out) or runner.busybot(
            "eval", "reason", str(folder), "--reasoner", reasoner, "--assets", assets, "--out", str(out)
        )  # fmt: skip
        rows[reasoner] = {key: done[key] for key in ("edge_p", "edge_r", "boards")}
        rows[reasoner]["intervals"] = {key: done["intervals"][key] for key in ("precision", "recall")}
    return rows


def measured(options: argparse.Namespace) -> dict[str, Any]:
    """The result's figures."""
    others = {Path(one).name: ("--model", one) for one in options.models}
    if len(others) < len(options.models) or others.keys() & POLICIES.keys():
        raise UsageError("models are told apart by the names of their folders", f"no two alike, none of {[*POLICIES]}")
    library = options.work / f"drawn-{options.seed}"
    if not library.exists():
        made = ("assets", "make", str(library), "--seed", str(options.seed), "--drawn", str(options.drawn))
        runner.busybot(*made)
    if (there := len(list(library.glob("Switch/drawn-*")))) != options.drawn:
        raise UsageError(f"{library}: it has {there} drawn switches, not {options.drawn}", "name another --work")
    rows: dict[str, Any] = {}
    data = {}
    for name, assets in (("new", str(library)), *(() if others else (("looked at", "procedural"),))):
        folder = options.work / name.replace(" ", "-")
        runner.busybot(*runner.generating(folder, "novel-object", options.boards, BOARD_SEED, assets))
        data[name] = {"board_hash": Dataset.open(folder).hashes().board}
        rows[name] = {
            policy: interacted(folder, words, assets, options.work / f"{folder.name}-{policy}")
            for policy, words in (others or POLICIES).items()
        }
    figures = {"drawn": options.drawn, "boards": options.boards, "rows": rows}
    if others:
        weights = {name: file_hashes(find_folder(words[1], "interact")) for name, words in others.items()}
        return runner.finish(KIND, options, figures, hashes={"models": weights, "data": data})
    models = {name: file_hashes(find_folder(name, "reason")) for name in TRAINED}
    relations = related(options.work / "new", options.boards, str(library), options.work, models)
    models["procedural"] = file_hashes(find_folder("procedural", "interact"))
    return runner.finish(KIND, options, {**figures, "relations": relations}, hashes={"models": models, "data": data})


def main(words: list[str] | None = None) -> None:
    options = runner.parser(__doc__, assets=False)
    options.add_argument("--work", type=Path, required=True, help="for objects, boards and results")
    options.add_argument("--drawn", type=int, default=60, help="switches")
    options.add_argument("--boards", type=int, default=BOARDS)
    options.add_argument("--seed", type=int, default=SEED, help="of switches")
    options.add_argument(
        "--models", nargs="*", default=[], help="interaction models to judge instead, by their folders"
    )
    arguments = options.parse_args(words)
    arguments.work.mkdir(parents=True, exist_ok=True)
    told = measured(arguments)
    for name, policies in told["rows"].items():
        for policy, one in policies.items():
            print(f"{name:10} {policy:8} P {100 * one['precision']:5.1f} R {100 * one['recall']:5.1f}")


if __name__ == "__main__":
    runner.one_of(main)
