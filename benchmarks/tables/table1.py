"""Table 1 of the protocol: all interaction policies, trained and judged by the commands that a user types.

    python -m benchmarks.tables.table1 --assets DIR --work FOLDER --out benchmarks/results/table1.json [--rows a,b]

Every command resumes, so this one does: run it again with the same FOLDER after any interruption. A row appears in the
result as soon as both novel splits are judged. All rows propose ten actions on each of the same boards; every trained
row had the same number of boards, actions and iterations. Boards have an appearance each (`--group-size 1`). Time and
memory of a training are noted if nothing interrupted it. A row whose folder in FOLDER is a model already, as
`benchmarks.gpu.unpack` leaves one, is judged as it is. Rows are compared with the one whose model they judge
otherwise, or with `free-0`, board by board (`compared`), if that stands in the result, which tells of it what happened
on each board (`by_board`): rows may be made one after the other on several machines.
"""

import argparse
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from benchmarks import runner
from busybot.common.config import build
from busybot.common.errors import BusybotError, UsageError
from busybot.common.process_pool import machine
from busybot.common.rng import generator
from busybot.evaluation.folder import OTHER_CODE
from busybot.evaluation.results import commit, of_this_code, read_result
from busybot.evaluation.statistics import compare_boards
from busybot.interact.policy.config import AffordanceInfo
from busybot.interact.policy.policy_factory import DEFAULT_MODEL
from busybot.interact.training.config import PaperConfig, TrainConfig
from busybot.sim.scene.real_camera import REAL
from busybot.training.model_cards import INFO_FILE, read_info

SPLITS = ("novel-config", "novel-object")
JUDGE_SEED = 707
KEYS = (
    *("precision", "recall", "recall_objects", "precision_exploring", "off_axis_share", "precision_reward"),
    *("reward_agreement", "boards", "intervals", "object_intervals", "by_step"),
    *("failures_by_cause", "failures_by_object", "missed_links"),
)


@dataclass(frozen=True)
class Table1Row:
    """One policy.

    Attributes:
        train: options of `busybot train interact`; None for a row that trains nothing of its own.
        seed: of the training.
        judge: options of `busybot eval interact`.
        model: a built-in policy, a model that ships, or the row whose model is judged.
        against: the row that it is compared with.
    """

    train: tuple[str, ...] | None = ()
    seed: int = 0
    judge: tuple[str, ...] = ()
    model: str | None = None
    against: str = "free-0"


def _delta(pixels: int) -> Table1Row:
    options = runner.settings("responders=false", f"interaction.delta={pixels}")
    return Table1Row(options, judge=options)


PAPER, WITHOUT = ("--variant", "paper"), runner.settings("responders=false")
JOINTS, STRICT = runner.settings("interaction.reward=joints"), ("--strict",)
REAL_CAMERA = runner.settings(*(f"render.camera.{term}={strength}" for term, strength in REAL.items()))

ROWS = {
    **{f"free-{seed}": Table1Row(seed=seed) for seed in range(5)},
    **{f"strict-{seed}": Table1Row(STRICT, seed, STRICT) for seed in range(3)},
    "oracle": Table1Row(JOINTS, judge=JOINTS),
    "rgb": Table1Row(runner.settings("inputs=rgb")),
    "greedy": Table1Row(None, judge=("--mode", "greedy"), model="free-0"),
    "ucb": Table1Row(None, judge=("--mode", "ucb"), model="free-0"),
    "random": Table1Row(None, model="random"),
    "shipped": Table1Row(None, model=DEFAULT_MODEL),
    "free-0-delta-1000": Table1Row(None, judge=runner.settings("interaction.delta=1000"), model="free-0"),
    **{f"without-responders-{pixels}": _delta(pixels) for pixels in (100, 500, 1000)},
    "paper": Table1Row(PAPER),
    "paper-greedy": Table1Row(None, judge=("--mode", "greedy"), model="paper", against="paper"),
    "paper-oracle": Table1Row((*PAPER, *JOINTS), judge=JOINTS, against="paper"),
    "paper-rgb": Table1Row((*PAPER, *runner.settings("inputs=rgb")), against="paper"),
    "paper-without-responders": Table1Row((*PAPER, *WITHOUT), judge=WITHOUT, against="paper"),
    "real-camera": Table1Row(REAL_CAMERA, judge=REAL_CAMERA),
    "real-camera-oracle": Table1Row((*JOINTS, *REAL_CAMERA), judge=(*JOINTS, *REAL_CAMERA), against="real-camera"),
    "real-camera-clean": Table1Row(None, judge=REAL_CAMERA, model="free-0", against="real-camera"),
}
REFERENCES = frozenset(row.against for row in ROWS.values())
"""Rows that others are compared with."""
OTHER_CAMERA = ("real-camera", "real-camera-oracle", "real-camera-clean")
"""No rows of Table 1: whether the reward of pictures is as good as the true one, where it can be wrong."""
ON_REQUEST = ("shipped", *(name for name in ROWS if name.startswith("paper")), *OTHER_CAMERA)
"""Rows that only `--rows` runs; those of the paper's networks take days on a CPU, and what ships knows procedural
objects alone."""
NOTHING_LEARNED = "no recorded action succeeded"
"""What training says where not a single action was rewarded: there is no model to judge."""


def run(name: str, rows: dict[str, Any], arguments: argparse.Namespace) -> dict[str, Any]:
    """Train a row if it has a training, and judge it on both novel splits.

    Args:
        rows: those that are there, one of which it may be compared with.
    """
    row, work = ROWS[name], arguments.work
    commands: list[tuple[str, ...]] = []
    trained, places = None, {str(work): "WORK", arguments.assets: "ASSETS"}
    model = row.model if row.model in ("random", DEFAULT_MODEL) else str(work / (row.model or name))
    if row.train is not None and (Path(model) / INFO_FILE).exists():  # trained elsewhere, perhaps not to the end
        trained = {**_card_of(row, Path(model), arguments.config), "cost": None}
    elif row.train is not None:
        config = runner.option("--config", arguments.config)
        options = ("--assets", arguments.assets, "--seed", str(row.seed), *row.train, *config)
        commands.append(("train", "interact", "--out", model, *options))
        try:
            told = runner.train(Path(model), *commands[0])
        except BusybotError as error:
            if NOTHING_LEARNED not in str(error):
                raise
            told = {"commands": [runner.as_typed(commands[0], places)], "machine": machine(), "commit": commit()}
            return {**told, "training": None, "untrained": NOTHING_LEARNED}
        trained = {**told["training"], "cost": told["cost"]}
    judged, policy = {}, {}
    for split in SPLITS:
        folder = work / f"judge-{arguments.judge_seed}-{split}"
        out = arguments.work / f"judged-{arguments.judge_seed}-{name}-{split}"
        commands.append(runner.generating(folder, split, arguments.boards, arguments.judge_seed, arguments.assets))
        runner.busybot(*commands[-1])
        commands.append(("eval", "interact", str(folder), "--model", model, *row.judge))
        result = runner.busybot(*commands[-1], "--out", str(out), "--assets", arguments.assets)
        judged[split] = {key: result[key] for key in (*KEYS, "commit", "dataset", "versions")}
        judged[split]["compared"] = _compared(name, split, result, rows, arguments.judge_seed)
        if name in REFERENCES:
            judged[split]["by_board"] = result["by_board"]
        policy = judged_policy(result["provenance"])
    typed = [runner.as_typed(command, places) for command in commands]
    return {"commands": typed, "machine": machine(), "training": trained, "policy": policy, **judged}


def _card_of(row: Table1Row, model: Path, config: Path | None) -> dict[str, Any]:
    """What the card of a model that was trained elsewhere says of its training.

    Args:
        config: YAML file with parameters of every training.

    Raises:
        BusybotError: it is no training of this row.
    """
    info = read_info(model, AffordanceInfo)
    words = row.train or ()
    kind: type[PaperConfig] | type[TrainConfig] = PaperConfig if words[:2] == PAPER else TrainConfig
    settings = [value for option, value in pairwise(words) if option == "--set"]
    asked = build(kind, config, settings, {"interaction.strict": True if STRICT[0] in words else None})
    told = asked.model_dump(mode="json", include={"inputs", "responders", "interaction", "render"})
    known = info.training.get("config", {})
    differing = [name for name, value in told.items() if not _alike(known.get(name), value)]
    if (info.variant, info.training.get("seed")) != (asked.variant, row.seed) or differing:
        what = f"it was trained otherwise than this row is ({', '.join(differing) or 'variant or seed'})"
        raise BusybotError(f"{model}: {what}", "name another --work")
    return info.training


def _alike(known: Any, asked: Any) -> bool:
    """Whether a card says the same, as far as it says anything: some are older than a parameter."""
    if isinstance(known, dict) and isinstance(asked, dict):
        return all(_alike(known[name], value) for name, value in asked.items() if name in known)
    return bool(known == asked)


def _compared(name: str, split: str, result: dict[str, Any], rows: dict[str, Any], seed: int) -> dict[str, Any] | None:
    """A row against another one on the same boards (`compare_boards`); None if that is not there.

    Raises:
        UsageError: another version of busybot judged that one.
    """
    against = ROWS[name].against
    known = rows.get(against, {}).get(split) if against != name else None
    if known is None or "by_board" not in known:
        return None
    if not of_this_code(known):
        raise UsageError(f"{against}, {split}: {OTHER_CODE}", f"name another --out, or judge {against} first")
    rng = generator(seed, split, 0, f"table1/{name}")
    return {"against": against, **compare_boards(known["by_board"], result["by_board"], rng)}


def judged_policy(provenance: dict[str, Any]) -> dict[str, Any]:
    """What was judged: hashes of the model's files, and the policy's constants; its table lies in the model's card."""
    constants = {key: value for key, value in provenance.get("policy", {}).items() if key != "after_failure"}
    return {"model_sha256": provenance["model"].get("sha256"), "constants": constants}


def main(words: list[str] | None = None) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--work", type=Path, required=True, help="for models and results; continued if it exists")
    usual = ",".join(name for name in ROWS if name not in ON_REQUEST)
    options.add_argument("--rows", default=usual, help=f"which rows, in this order; {', '.join(ON_REQUEST)} on request")
    options.add_argument("--boards", type=int, default=200, help="per split")
    options.add_argument("--judge-seed", type=int, default=JUDGE_SEED, help="of the boards that rows are judged on")
    options.add_argument("--config", type=Path, help="YAML file with parameters of every training")
    arguments = options.parse_args(words)
    about = {"assets": runner.assets_name(arguments.assets), "judge_seed": arguments.judge_seed}
    before = read_result(arguments.out, "table1") if arguments.out.exists() else {**about, "rows": {}}
    if any(before.get(name) != value for name, value in about.items()):
        what = "its rows are of other objects, or judged on other boards"
        raise UsageError(f"{arguments.out}: {what}", "name another file")
    result: dict[str, Any] = {**about, "rows": dict(before["rows"])}
    names = runner.chosen(arguments.rows, ROWS)
    for name in names:
        result["rows"][name] = run(name, result["rows"], arguments)
        runner.finish("table1", arguments, result, seed=arguments.judge_seed)  # rows have hashes and seeds of their own
        for split in SPLITS:
            row = result["rows"][name].get(split, {"precision": 0.0, "recall": 0.0})
            print(f"{name:24} {split:13} P {100 * row['precision']:5.1f} R {100 * row['recall']:5.1f}", flush=True)


if __name__ == "__main__":
    runner.one_of(main)
