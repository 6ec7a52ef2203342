"""The constants of the learned policy, one varied at a time, on training objects that the model has not seen.

    python -m benchmarks.policy_constants --assets DIR --work FOLDER --out benchmarks/results/policy_constants.json
    python -m benchmarks.interact_pages benchmarks/results/policy_constants.json docs/interact.md

Of the training objects some are held out: a copy of the library calls them novel and has no real novel object at all. A
strict model is trained on the others and judged, under the veto, on boards of those that were held out, where it makes
the mistakes that the constants are for. What differs without the veto is varied without it, there and on new boards of
the objects that the model knows. Run it again with the same FOLDER after an interruption: it goes on.
"""

import argparse
import json
import shutil
import sys
from pathlib import Path
from typing import Any

from benchmarks.commands import busybot, chosen, write_result
from busybot.interact.policy_config import STRICT_POLICY, PolicyConfig
from busybot.workers import machine

SEED = 78
OBJECTS, MODEL = "objects", "model"
HELD_OUT = {
    "Switch": ("100849", "100906", "100934", "100976", "100979", "100981", "102812", "102836"),
    "Lamp": ("13491",),
    "Door": ("8903", "8994"),
}
"""One of two sliders, one of two levers that are annotated as buttons, six drawn switches, a drawn lamp, two doors."""
VALUES: dict[str, tuple[float, ...]] = {
    "explore": (0.2, 0.5),
    "caution": (0.0, 3.0),
    "insist": (0.05, 0.5),
    "temperature": (1.0, 2.0, 5.0),
    "component_penalty": (0.3, 2.0),
    "failure_penalty": (0.3, 1.4),
    "failure_sigma": (3.0, 12.0),
    "dense_weight": (0.5, 1.0),
    "opening": (3, 9),
    "same_link": (0.1, 0.5),
    "peak_radius": (2, 6),
    "effect": (75, 400),
    "responder_penalty": (0.0, 1.0),
    "trigger_bonus": (1.2,),
}
"""Values beside the default."""
BEFORE = {
    "explore": 0.35,
    "insist": 0.35,
    "caution": 0,
    "temperature": 1,
    "after_failure": "null",
    "dense_weight": 0.5,
    "trigger_bonus": 0,
}
"""What was there before doubt on new objects was: one row varies them together."""
KEYS = ("precision", "recall", "precision_exploring", "intervals", "failures_by_object", "missed_links")
TRAIN = ("--strict",)
FREE_SPLITS = ("novel-object", "novel-config")
"""Held-out objects, and those that the model knows."""


def held_out_library(assets: Path, folder: Path) -> Path:
    """A copy in which the held-out objects are the novel ones; made once."""
    if folder.exists():
        return folder
    split = json.loads((assets / "data.json").read_text())
    changed: dict[str, dict[str, list[str]]] = {}
    for category, lists in split["Reason"].items():
        held = HELD_OUT.get(category, tuple(lists["train"]))  # the only toy is on both sides
        kept = [name for name in lists["train"] if name not in held] or list(held)
        changed[category] = {"train": kept, "test": list(held)}
    unfinished = folder.with_name(folder.name + ".part")
    shutil.rmtree(unfinished, ignore_errors=True)
    for category, lists in changed.items():
        for name in {*lists["train"], *lists["test"]}:
            shutil.copytree(assets / category / name, unfinished / category / name)
    (unfinished / "data.json").write_text(json.dumps({"Interact": split["Interact"], "Reason": changed}))
    unfinished.rename(folder)
    return folder


def settings(values: dict[str, Any]) -> list[str]:
    """Options that set constants of the learned policy."""
    return [word for name, value in values.items() for word in ("--set", f"learned.{name}={value}")]


def judge(work: Path, boards: int, part: str, split: str, row: str, *options: str) -> tuple[dict[str, Any], ...]:
    """What came of one setting on one kind of boards, and which boards they were."""
    library, folder = str(work / OBJECTS), work / ("boards" if split == "novel-object" else f"boards-{split}")
    drawn = ("--split", split, "--boards", str(boards), "--seed", str(SEED), "--group-size", "1")
    busybot("generate", str(folder), *drawn, "--assets", library)  # refuses other boards there
    out = work / "-".join(["judged", *([] if part == "rows" else [part, split]), row])
    command = ("eval", "interact", str(folder), "--model", str(work / MODEL), "--assets", library, *options)
    values = busybot(*command, "--out", str(out))
    shares = f"P {100 * values['precision']:5.1f} R {100 * values['recall']:5.1f}"
    print(f"{part:5} {split:13} {row:24} {shares}", file=sys.stderr, flush=True)
    return {key: values[key] for key in KEYS}, {key: values["dataset"][key] for key in ("boards", "board_hash")}


def main() -> None:
    arguments = parsed()
    names, work = chosen(arguments.constants, VALUES), arguments.work
    work.mkdir(parents=True, exist_ok=True)
    library = str(held_out_library(arguments.assets, work / OBJECTS))
    config = ("--config", str(arguments.config)) if arguments.config else ()
    trained = busybot("train", "interact", "--out", str(work / MODEL), "--assets", library, *TRAIN, *config)["training"]
    known = json.loads(arguments.out.read_text()) if arguments.out.exists() else {"training": trained}
    if known["training"] != trained:
        raise SystemExit(f"{arguments.out} has rows of another model: name another file, or remove it")
    default = PolicyConfig().model_dump(include=set(VALUES))
    result: dict[str, Any] = {
        "assets": arguments.assets.name,
        "seed": SEED,
        "machine": machine(),
        "held_out": HELD_OUT,
        "default": default,
        "default_strict": {**default, **STRICT_POLICY},
        "training": trained,
        **{part: known.get(part, {}) for part in ("boards", "rows", "free")},
    }
    free = {name: default[name] for name in STRICT_POLICY}  # the model's card has the veto's
    varied: dict[str, dict[str, Any]] = {
        "defaults": {},
        "strict": STRICT_POLICY,
        **{f"{k}={v}": {k: v} for k, v in STRICT_POLICY.items()},
    }
    for row, values in varied.items():
        result["free"][row] = {}
        for split in FREE_SPLITS:
            options = tuple(settings({**free, **values}))
            judged = judge(work, arguments.boards, "free", split, row, *options)
            result["free"][row][split], result["boards"][split] = judged
        write_result(arguments.out, result)
    varied = {"defaults": {}, "before": BEFORE}
    varied |= {f"{name}={value}": {name: value} for name in names for value in VALUES[name]}
    for row, values in varied.items():
        options = ("--strict", *settings(values))
        result["rows"][row], _ = judge(work, arguments.boards, "rows", "novel-object", row, *options)
        write_result(arguments.out, result)


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", type=Path, required=True, help="folder of annotated objects")
    parser.add_argument("--work", type=Path, required=True, help="for library, model and boards; continued")
    parser.add_argument("--boards", type=int, default=60)
    parser.add_argument("--constants", default=",".join(VALUES))
    parser.add_argument("--config", type=Path, help="YAML file with parameters of the training")
    parser.add_argument("--out", type=Path, required=True)
    return parser.parse_args()


if __name__ == "__main__":
    main()
