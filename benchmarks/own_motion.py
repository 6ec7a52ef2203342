"""How many pixels a trigger's own motion changes, without any responder (Table 1, row "w/o responder").

    python benchmarks/own_motion.py [--assets DIR] [--boards 100] --out benchmarks/results/own-motion.json

The scripted policy moves the links of training and novel boards whose responders show nothing. For each reward
threshold: the share of true changes that exceed it, and the triggers whose median change does.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pandas as pd

DELTAS = (100, 500, 1000)
SPLITS = ("train", "novel-object")
STEPS = 20


def busybot(*arguments: str) -> str:
    """Run a command; returns it as a user types it."""
    subprocess.run([sys.executable, "-m", "busybot", *arguments], check=True, stdout=subprocess.DEVNULL)
    return "busybot " + " ".join(arguments)


def moved(out: Path, split: str, arguments: argparse.Namespace) -> tuple[pd.DataFrame, list[str]]:
    """Every step that moved a link: the trigger and the changed pixels."""
    make = ("generate", str(out), "--split", split, "--boards", str(arguments.boards), "--group-size", "1")
    commands = [
        busybot(*make, "--seed", str(arguments.seed), "--assets", arguments.assets),
        busybot("collect", str(out), "--policy", "scripted", "--steps", str(STEPS), "--set", "responders=false"),
    ]
    steps, objects = (pd.read_parquet(out / "tables" / name) for name in ("steps", "objects"))
    first = objects[objects["frame"] == 0]
    named = first.assign(trigger=first["category"].astype(str) + "/" + first["instance"].astype(str))
    keys = ["episode", "object"]
    done = steps[steps["success"]].merge(named[[*keys, "trigger"]], left_on=["episode", "acted_object"], right_on=keys)
    lines = [line.replace(str(out), "DATA").replace(arguments.assets, "ASSETS") for line in commands]
    return done[["trigger", "changed_pixels"]], lines


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
    result: dict[str, Any] = {"seed": arguments.seed, "commands": {}, "splits": {}}
    with tempfile.TemporaryDirectory() as temporary:
        for split in SPLITS:
            changes, result["commands"][split] = moved(Path(temporary) / split, split, arguments)
            result["splits"][split] = summary(changes)
    arguments.out.write_text(json.dumps(result, indent=1) + "\n")
    print(json.dumps(result["splits"], indent=1))


if __name__ == "__main__":
    main()
