"""Table 2 of the protocol: who finds relations and predicts what follows, by the commands that a user types.

    python -m benchmarks.tables.table2 record --model MODEL --assets DIR --data FOLDER [--only train,random/train]
    python -m benchmarks.tables.table2 record --model MODEL --assets DIR --data FOLDER/few --most 60 --only SPLITS
    python -m benchmarks.tables.table2 --data FOLDER --work FOLDER --out benchmarks/results/table2.json [--rows a,b]

    python -m benchmarks.tables.table2 procedural --work FOLDER --out benchmarks/results/reason-procedural.json

`record` makes the recorded boards; `--model` is the interaction policy that acts on them (`busybot train interact`).
Beneath `random` lie recordings of the same boards without exploration. Every board has an appearance of its own: 300
tell more than 15.

Beneath `few` lie the first boards of those to judge on, for models that are slow: SPLITS are
`novel-object,novel-config,validation`, and the same behind `random/` for the row of the paper's model without
exploration.

`--data` holds recorded datasets: `train` (to train on), `validation` (training objects, other boards), `novel-config`
and `novel-object` (to judge on). The rows "without exploration" need the same beneath `random`, recorded with
`--policy random`. What is not there is not judged.

`procedural` judges what ships with busybot: its policy acts on boards of procedural objects, its model of relations
reads the recordings.

Every command resumes, so this one does: run it again with the same `--work` after any interruption. A row appears in
the result as soon as it is judged. The default model has three trainings; their mean and extremes stand beside. The
first training of a row is compared with that of another one, board by board, if that was judged before (`compared`).
"""

import argparse
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from benchmarks import runner
from busybot.common.atomic_io import write_json
from busybot.common.process_pool import machine
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.evaluation.reference_tables import NOVEL
from busybot.evaluation.statistics import compare_boards
from busybot.reason.models.registry import DEFAULT_REASONER
from busybot.training.model_cards import file_hashes, find_folder

SPLITS = ("validation", "novel-config", "novel-object")
SCORES = (
    *("edge_p", "edge_r", "edge_acc", "edge_r_bound"),
    *("pred_a", "pred_a_successful", "pred_a_responder", "pred_a_changed", "pred_a_unchanged", "pred_a_bound"),
    *("ece", "brier"),
)
"""Of which mean and extremes over seeds are told."""
DETAILS = (
    *("boards", "predicted_steps", "failing", "bounds", "decoded", "decoder_accuracy", "persistence", "baselines"),
    *("calibration", "intervals", "object_intervals", "macro", "by_kind", "pred_by_kind", "pred_by_category"),
    *("by_images", "encoder", "dataset", "decoders", "hashes", "versions"),
)
STEPS = 30


@dataclass(frozen=True)
class RecordedSplit:
    """Boards of one split.

    Attributes:
        split: of `busybot generate`.
        seed: no two recordings share boards, except with and without exploration.
    """

    split: str
    boards: int
    seed: int


def recording(
    folder: Path, one: RecordedSplit, boards: int, assets: str, policy: tuple[str, ...]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The commands that draw so many boards of a split and act on them; procedural objects are found by themselves."""
    found = () if assets == "procedural" else ("--assets", assets)
    acting = ("--steps", str(STEPS), "--policy", *policy, "--seed", str(one.seed), *found)
    return runner.generating(folder, one.split, boards, one.seed, assets), ("collect", str(folder), *acting)


JUDGED = {
    "novel-object": RecordedSplit("novel-object", 300, 604),
    "novel-config": RecordedSplit("novel-config", 300, 603),
    "validation": RecordedSplit("train", 150, 602),
}
LEARNED = {**JUDGED, "train": RecordedSplit("train", 1000, 601)}
RANDOM = {name: replace(recording, boards=min(150, recording.boards)) for name, recording in JUDGED.items()}
RANDOM["train"] = replace(LEARNED["train"], boards=300)
"""The first of the same boards: without exploration there is little to find, and fewer boards tell it."""


@dataclass(frozen=True)
class Table2Row:
    """One reasoner.

    Attributes:
        model: of `busybot eval reason`; None for one that is trained.
        train: options of `busybot train reason`.
        judge: options of `busybot eval reason`.
        data: folder beneath `--data` with its datasets.
        judged: folder of `--data` that has this folder with what it is judged on; `few` is a smaller recording of the
            same boards.
        seeds: so many trainings; ours has three, what stands beside it one.
        against: the row that it is compared with.
    """

    model: str | None = None
    train: tuple[str, ...] = ()
    judge: tuple[str, ...] = ()
    data: str = ""
    judged: str = ""
    seeds: int = 1
    against: str = "event"


EVENT, PAPER = ("--variant", "event"), ("--variant", "paper", "--encoder", "resnet50keras")
"""ResNet-50's features as the paper has them, with the weights that a package index carries."""
SHORT = (
    *("epochs=12", "batch=16", "network.pairs=candidates", "bfloat16=true", "threads=1"),
    *("loop.held_out=0.05", "loop.judge=40"),
)
"""What an hour of a core can do of the paper's schedule, in batches a fourth as large, so that there are iterations
enough to learn something; the best weights on held-out boards are kept."""
SLOW = ("--no-what-if",)
"""How models are judged whose predictions take seconds: on fewer boards, and without questions this table has not."""
BOARDS = (20, 100, 300)
"""Smaller trainings of `event`, for the curve over their number of boards."""
ROWS = {
    "event": Table2Row(train=EVENT, seeds=3),
    "event-without-inference": Table2Row(train=(*EVENT, *runner.settings("net.inference=false"))),
    "event-without-exploration": Table2Row(train=EVENT, data="random"),
    **{f"event-{count}": Table2Row(train=(*EVENT, *runner.settings(f"loop.boards={count}"))) for count in BOARDS},
    "lookup": Table2Row("lookup"),
    "count": Table2Row("count"),
    "persistence": Table2Row("persistence"),
    "pc": Table2Row("pc"),
    "pc-pairs": Table2Row("pc", judge=runner.settings("condition=0"), judged="few"),
    "paper": Table2Row(train=PAPER, judge=SLOW, judged="few"),
    "paper-short": Table2Row(train=(*PAPER, *runner.settings(*SHORT)), judge=SLOW, judged="few"),
    "paper-short-without-inference": Table2Row(
        train=(*PAPER, *runner.settings(*SHORT, "inference=false")), judge=SLOW, judged="few", against="paper-short"
    ),
    "paper-without-inference": Table2Row(
        train=(*PAPER, *runner.settings("inference=false")), judge=SLOW, judged="few", against="paper"
    ),
    "paper-without-exploration": Table2Row(train=PAPER, judge=SLOW, data="random", judged="few", against="paper"),
}
"""By name. `pc` conditions on other variables, `pc-pairs` tests each pair by itself."""
WHOLE_SCHEDULE = ("paper", "paper-without-inference", "paper-without-exploration")
"""Rows of days; they are trained only if they are named."""


def run(name: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Train a row, with every seed, if it is trained, and judge it on what there is to judge on."""
    row, data = ROWS[name], arguments.data / ROWS[name].data
    places = {str(arguments.work): "WORK", str(arguments.data): "DATA", str(arguments.assets): "ASSETS"}
    trained: list[dict[str, Any]] = []
    commands: list[tuple[str, ...]] = []
    judged: dict[str, list[dict[str, Any]]] = {}
    compared: dict[str, dict[str, Any] | None] = {}
    decoders = data / "train" if row.model not in ("count", "pc") else None
    judging = (*row.judge, *runner.option("--decoders", decoders), *runner.option("--assets", arguments.assets))
    for seed in range(row.seeds):
        model = row.model or str(arguments.work / f"{name}-{seed}")
        if row.model is None:
            options = ("--data", str(data / "train"), "--out", model, "--seed", str(seed))
            commands.append(("train", "reason", *row.train, *options, *runner.option("--config", arguments.config)))
            told = runner.train(Path(model), *commands[-1])
            kept = {key: value for key, value in told.items() if key not in ("out", "model")}
            trained.append({**kept, "machine": told["training"].get("machine") or machine()})
        for split in SPLITS:
            if (dataset := arguments.data / row.judged / row.data / split).is_dir():
                commands.append(("eval", "reason", str(dataset), "--reasoner", model, *judging))
                answer = answered(commands[-1], _judged(arguments, name, seed, split), dataset)
                judged.setdefault(split, []).append(answer["result"])
                compared.setdefault(split, _compared(arguments, name, split, answer))
    return {
        "commands": [runner.as_typed(command, places) for command in commands],
        "training": trained,
        "splits": {
            split: {**across(results), "seeds": results, "compared": compared[split]}
            for split, results in judged.items()
        },
    }


def _judged(arguments: argparse.Namespace, name: str, seed: int, split: str) -> Path:
    """File of a judgement."""
    return Path(arguments.work / f"{name}-{seed}-{split}.json")


def _compared(arguments: argparse.Namespace, name: str, split: str, answer: dict[str, Any]) -> dict[str, Any] | None:
    """A row's first training against that of another one, on the boards that both were judged on (`compare_boards`),
    of which recordings begin with the same; None if that was not judged here."""
    against = ROWS[name].against
    known = _judged(arguments, against, 0, split)
    told = (runner.earlier(known) or {}).get("by_board") if against != name else None
    if told is None:
        return None
    rng = generator(JUDGED[split].seed, split, 0, f"table2/{name}")
    return {"against": against, **compare_boards(told, answer["by_board"], rng)}


def answered(command: tuple[str, ...], out: Path, dataset: Path) -> dict[str, Any]:
    """A judgement, or the one that an earlier run wrote by the same command on the same recordings, of the same weights
    with the same decoders: `result`, and its counts `by_board`."""
    known, recorded = runner.earlier(out), Dataset.open(dataset).hashes().content
    named = _named(command)
    before = () if known is None else (known["typed"], known.get("content_hash"), known.get("named"))
    if known is not None and before == (list(command), recorded, named):
        return known
    told = runner.busybot(*command)
    result = {key: told[key] for key in (*SCORES, *DETAILS)}
    answer = {
        "typed": command,
        "content_hash": recorded,
        "named": named,
        "versions": told["versions"],
        "result": result,
        "by_board": told["by_board"],
    }
    write_json(out, answer)
    return answer


def _named(command: tuple[str, ...]) -> dict[str, Any]:
    """Hashes of what lies in the folders of a command that a later training, or recording, may have put there."""
    given = {option: Path(value) for option, value in pairwise(command) if option in ("--reasoner", "--decoders")}
    found: dict[str, Any] = {}
    if (model := given["--reasoner"]).is_dir():  # what ships with busybot is part of the code
        found["reasoner"] = file_hashes(find_folder(model, "reason"))
    if "--decoders" in given and given["--decoders"].is_dir():
        found["decoders"] = Dataset.open(given["--decoders"]).hashes().content
    return found


def across(results: list[dict[str, Any]]) -> dict[str, dict[str, float | None]]:
    """Mean and extremes over seeds of every score; None where one of them is undefined."""
    told: dict[str, dict[str, float | None]] = {"mean": {}, "least": {}, "most": {}}
    for key in SCORES:
        values = [result[key] for result in results]
        known = None not in values
        told["mean"][key] = sum(values) / len(values) if known else None
        told["least"][key], told["most"][key] = (min(values), max(values)) if known else (None, None)
    return told


def record(words: list[str]) -> None:
    """Generate the boards and act on them; what is there is left alone."""
    options = runner.parser(__doc__, out=None)
    options.add_argument("--model", required=True)
    options.add_argument("--data", type=Path, required=True)
    options.add_argument("--only", help="names, comma-separated; all by default")
    options.add_argument("--most", type=int, default=10_000, help="boards per recording")
    arguments = options.parse_args(words)
    recordings = {**LEARNED, **{f"random/{name}": one for name, one in RANDOM.items()}}
    for name in runner.chosen(arguments.only, recordings) if arguments.only else recordings:
        one = recordings[name]
        policy = ("random",) if name.startswith("random/") else ("learned", "--model", arguments.model)
        boards = min(arguments.most, one.boards)
        for command in recording(arguments.data / name, one, boards, arguments.assets, policy):
            runner.busybot(*command)


def procedural(words: list[str]) -> None:
    options = runner.parser(__doc__, assets=False)
    options.add_argument("--work", type=Path, required=True, help="for recordings; continued if it exists")
    options.add_argument("--boards", type=int, default=120, help="of each novel split")
    arguments = options.parse_args(words)
    arguments.work.mkdir(parents=True, exist_ok=True)
    commands: list[tuple[str, ...]] = []
    splits = {}
    for split in NOVEL:
        folder = arguments.work / split
        commands += recording(folder, JUDGED[split], arguments.boards, "procedural", ("learned",))
        commands.append(("eval", "reason", str(folder), "--reasoner", DEFAULT_REASONER))
        *_, splits[split] = [runner.busybot(*command) for command in commands[-3:]]
    typed = [runner.as_typed(command, {str(arguments.work): "WORK"}) for command in commands]
    told = {split: {key: one[key] for key in (*SCORES, *DETAILS)} for split, one in splits.items()}
    runner.finish("reason-procedural", arguments, {"commands": typed, "splits": told})  # commands tell the seeds


def main(words: list[str]) -> None:
    options = runner.parser(__doc__, assets=False)
    options.add_argument("--data", type=Path, required=True, help="recorded datasets, see above")
    options.add_argument("--work", type=Path, required=True, help="for models and results; continued if it exists")
    options.add_argument("--assets", help="objects, if they are not found by their hashes")
    usual = ",".join(name for name in ROWS if name not in WHOLE_SCHEDULE)
    options.add_argument("--rows", default=usual, help="which rows, in this order")
    options.add_argument("--config", type=Path, help="YAML file with parameters of every training")
    arguments = options.parse_args(words)
    arguments.work.mkdir(parents=True, exist_ok=True)
    result: dict[str, Any] = {"rows": runner.told_rows(arguments.out, "table2")}
    for name in runner.chosen(arguments.rows, ROWS):
        result["rows"][name] = run(name, arguments)
        runner.finish("table2", arguments, result)  # every evaluation has hashes, seeds and versions of its own
        for split, scores in result["rows"][name]["splits"].items():
            told = " ".join(f"{key} {_percent(scores['mean'][key])}" for key in ("edge_p", "edge_r", "pred_a"))
            print(f"{name:26} {split:13} {told}", flush=True)


def _percent(share: float | None) -> str:
    return "    -" if share is None else f"{100 * share:5.1f}"


if __name__ == "__main__":
    runner.one_of(main, record=record, procedural=procedural)
