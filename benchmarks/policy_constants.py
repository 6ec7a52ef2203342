"""The constants of the learned policy, one varied at a time, on training objects that the model has not seen.

    python -m benchmarks.policy_constants --assets DIR --work FOLDER --out benchmarks/results/policy_constants.json
    python -m benchmarks.interact_pages benchmarks/results/policy_constants.json docs/interact.md

Of the training objects some are held out: a copy of the library calls them novel and has no real novel object at all. A
strict model is trained on the others and judged, under the veto, on boards of those that were held out, where it makes
the mistakes that the constants are for. Run it again with the same FOLDER after an interruption: it goes on.
"""

import argparse
import json
import shutil
import sys
from pathlib import Path
from typing import Any

from benchmarks.commands import busybot, chosen, told_rows, write_result
from busybot.interact.policy_config import STRICT_POLICY, PolicyConfig
from busybot.workers import machine

SEED = 78
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
BEFORE = (
    "explore=0.35",
    "insist=0.35",
    "caution=0",
    "temperature=1",
    "after_failure=null",
    "dense_weight=0.5",
    "trigger_bonus=0",
)
"""What was there before doubt on new objects was: one row varies them together."""
KEYS = ("precision", "recall", "precision_exploring", "intervals", "failures_by_object", "missed_links")
TRAIN = ("--strict",)


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", type=Path, required=True, help="folder of annotated objects")
    parser.add_argument("--work", type=Path, required=True, help="for library, model and boards; continued")
    parser.add_argument("--boards", type=int, default=60)
    parser.add_argument("--constants", default=",".join(VALUES))
    parser.add_argument("--config", type=Path, help="YAML file with parameters of the training")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    names = chosen(arguments.constants, VALUES)
    arguments.work.mkdir(parents=True, exist_ok=True)
    library = str(held_out_library(arguments.assets, arguments.work / "objects"))
    model, boards = str(arguments.work / "model"), arguments.work / "boards"
    config = ("--config", str(arguments.config)) if arguments.config else ()
    trained = busybot("train", "interact", "--out", model, "--assets", library, *TRAIN, *config)["training"]
    options = ("--split", "novel-object", "--boards", str(arguments.boards), "--seed", str(SEED))
    busybot("generate", str(boards), *options, "--group-size", "1", "--assets", library)  # refuses other boards there
    rows: dict[str, tuple[str, ...]] = {"defaults": (), "before": BEFORE}
    for name in names:
        rows |= {f"{name}={value}": (f"{name}={value}",) for value in VALUES[name]}
    result: dict[str, Any] = {
        "assets": arguments.assets.name,
        "seed": SEED,
        "machine": machine(),
        "held_out": HELD_OUT,
        "default": {**{name: getattr(PolicyConfig(), name) for name in VALUES}, **STRICT_POLICY},
        "training": trained,
    }
    if arguments.out.exists() and json.loads(arguments.out.read_text())["training"] != trained:
        parser.error(f"{arguments.out} has rows of another model: name another file, or remove it")
    result["rows"] = told_rows(arguments.out)
    for row, settings in rows.items():
        words = [word for setting in settings for word in ("--set", f"learned.{setting}")]
        judging = ("--model", model, "--assets", library, "--strict", *words)
        told = busybot("eval", "interact", str(boards), *judging, "--out", str(arguments.work / f"judged-{row}"))
        result |= {key: told["dataset"][key] for key in ("boards", "board_hash") if key in told["dataset"]}
        result["rows"][row] = {key: told[key] for key in KEYS}
        print(f"{row:24} P {100 * told['precision']:5.1f} R {100 * told['recall']:5.1f}", file=sys.stderr, flush=True)
        write_result(arguments.out, result)


if __name__ == "__main__":
    main()
