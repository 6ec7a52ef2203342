"""How many pixels a trigger's own motion changes, without any responder (Table 1, row "w/o responder").

    python -m benchmarks.own_motion [--assets DIR] [--boards 100] --out benchmarks/results/own-motion.json

The scripted policy moves the links of training and novel boards whose responders show nothing. For each reward
threshold: the share of true changes that exceed it, and the triggers whose median change does.
"""

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.commands import as_typed, busybot, write_result
from busybot.workers import machine

DELTAS = (100, 500, 1000)
SPLITS = ("train", "novel-object")
STEPS = 20


def moved(out: Path, split: str, arguments: argparse.Namespace) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Every step that moved a link: the trigger and the changed pixels; and how they were recorded."""
    boards = ("--split", split, "--boards", str(arguments.boards), "--group-size", "1", "--seed", str(arguments.seed))
    commands = (
        ("generate", str(out), *boards, "--assets", arguments.assets),
        ("collect", str(out), "--policy", "scripted", "--steps", str(STEPS), "--set", "responders=false"),
    )
    for command in commands:
        busybot(*command)
    info = busybot("dataset", "info", str(out))
    places = {str(out): "DATA", arguments.assets: "ASSETS"}
    origin = {
        "commands": [as_typed(command, places) for command in commands],
        **{key: info[key] for key in ("board_hash", "content_hash")},
    }
    steps, objects = (pd.read_parquet(out / "tables" / name) for name in ("steps", "objects"))
    first = objects[objects["frame"] == 0]
    named = first.assign(trigger=first["category"].astype(str) + "/" + first["instance"].astype(str))
    keys = ["episode", "object"]
    done = steps[steps["success"]].merge(named[[*keys, "trigger"]], left_on=["episode", "acted_object"], right_on=keys)
    return done[["trigger", "changed_pixels"]], origin


def summary(changes: pd.DataFrame) -> dict[str, Any]:
    """Quantiles over steps, and what exceeds each threshold."""
    pixels = changes["changed_pixels"]
    medians = changes.groupby("trigger")["changed_pixels"].median()
    return {
        "steps": len(changes),
        "triggers": len(medians),
        "pixels": {
            name: float(pixels.quantile(share)) for name, share in (("median", 0.5), ("95 %", 0.95), ("most", 1))
        },
        "exceeding": {
            str(delta): {
                "share_of_steps": round(float((pixels > delta).mean()), 4),
                "triggers": sorted(medians[medians > delta].index),
            }
            for delta in DELTAS
        },
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", default="procedural")
    parser.add_argument("--boards", type=int, default=100)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    assets = "procedural" if arguments.assets == "procedural" else Path(arguments.assets).name
    result: dict[str, Any] = {"assets": assets, "seed": arguments.seed, "machine": machine(), "splits": {}}
    with tempfile.TemporaryDirectory() as temporary:
        for split in SPLITS:
            changes, origin = moved(Path(temporary) / split, split, arguments)
            result["splits"][split] = summary(changes) | origin
    write_result(arguments.out, result)
    print(json.dumps(result["splits"], indent=1))


if __name__ == "__main__":
    main()
