"""What happens on boards of each split, by the commands that a user types.

    python -m benchmarks.studies.splits --assets DIR --out benchmarks/results/splits.json [--boards 40] [--keep FOLDER]
    python -m benchmarks.studies.splits changed-pixels --assets DIR [--boards 100] --out FILE

Per split: boards are generated, collected with the scripted and with the random policy, verified, and counting infers
their relations from the first 23 images. The file holds the metrics with the commands, seed, hashes and machine.
`--group-size 1` gives every board its own appearance, so that 40 boards show 40 layouts.

`changed-pixels` counts the pixels that change when a link moves: with responders, and by the trigger's own motion
alone. The scripted policy moves the links of training and novel boards, once as they are and once while their
responders show nothing (Table 1, row "w/o responder"). For each reward threshold: the share of the moves that exceed
it, the triggers of which some move does, and those of which most do.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.runner import as_typed, assets_name, busybot, finish, generating, one_of, parser, settings

SPLITS = ("train", "novel-config", "novel-object")
POLICIES = ("scripted", "random")
HASHES = ("board_hash", "trace_hash", "content_hash")
DELTAS = (100, 500, 1000)
SHOWN = {"with": (), "without": settings("responders=false")}
STEPS = 20
METRICS = ("edge_p", "edge_r", "edge_acc", "edge_r_bound", "ece", "brier", "baselines")


def run(split: str, policy: str, folder: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    out = folder / f"{split}-{policy}"
    commands = (
        generating(out, split, arguments.boards, arguments.seed, arguments.assets),
        ("collect", str(out), "--policy", policy),
        ("dataset", "verify", str(out)),
        ("dataset", "info", str(out)),
        ("eval", "reason", str(out), "--reasoner", "count"),
    )
    told, seconds = [], []
    for command in commands:
        began = time.monotonic()
        told.append(busybot(*command))
        seconds.append(time.monotonic() - began)
    _, _, checked, info, judged = told
    places = {str(folder): "DATA", arguments.assets: "ASSETS"}
    return {
        "split": split,
        "policy": policy,
        "verified": checked["ok"],
        **{name: judged[name] for name in METRICS},
        **{name: info[name] for name in ("boards", "episodes", "steps", "bytes", *HASHES)},
        "success_share": info.get("success_share"),
        "collect_seconds": round(seconds[1], 1),
        "commands": [as_typed(command, places) for command in commands],
    }


def main(words: list[str]) -> None:
    options = parser(__doc__)
    options.add_argument("--boards", type=int, default=40)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--keep", type=Path, help="folder for the datasets; a temporary one by default")
    arguments = options.parse_args(words)
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        rows = [run(split, policy, folder, arguments) for policy in POLICIES for split in SPLITS]
    hashes = {f"{row['split']}, {row['policy']}": {name: row[name] for name in HASHES} for row in rows}
    finish("splits", arguments, {"assets": assets_name(arguments.assets), "rows": rows}, hashes={"data": hashes})
    for row in rows:
        print(row["split"], row["policy"], row["edge_p"], row["edge_r"], row["edge_r_bound"], row["success_share"])


def measured(folder: Path, split: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """The moves on boards of a split, with and without responders; folders are named as the commands are told."""
    told: dict[str, Any] = {}
    for name, options in SHOWN.items():
        data = folder / f"{split}-{name}"
        commands = (
            generating(data, split, arguments.boards, arguments.seed, arguments.assets),
            ("collect", str(data), "--policy", "scripted", "--steps", str(STEPS), *options),
        )
        for command in commands:
            busybot(*command)
        info = busybot("dataset", "info", str(data))
        places = {str(data): "DATA", arguments.assets: "ASSETS"}
        told[name] = {
            "commands": [as_typed(command, places) for command in commands],
            **{key: info[key] for key in ("board_hash", "content_hash")},
            **summary(moves(data)),
        }
    return told


def moves(data: Path) -> pd.DataFrame:
    """Every step that moved a link: the trigger and the changed pixels."""
    steps, objects = (pd.read_parquet(data / "tables" / name) for name in ("steps", "objects"))
    first = objects[objects["frame"] == 0]
    named = first.assign(trigger=first["category"].astype(str) + "/" + first["instance"].astype(str))
    keys = ["episode", "object"]
    done = steps[steps["success"]].merge(named[[*keys, "trigger"]], left_on=["episode", "acted_object"], right_on=keys)
    return done[["trigger", "changed_pixels"]]


def summary(done: pd.DataFrame) -> dict[str, Any]:
    """Quantiles over moves, and what exceeds each threshold."""
    pixels, of_trigger = done["changed_pixels"], done.groupby("trigger")["changed_pixels"]
    least, median, most = of_trigger.min(), of_trigger.median(), of_trigger.max()
    return {
        "moves": len(done),
        "pixels": {"least": int(pixels.min()), "median": float(pixels.median()), "most": int(pixels.max())},
        "triggers": {
            name: {"least": int(least[name]), "median": float(median[name]), "most": int(most[name])}
            for name in most.index
        },
        "exceeding": {
            str(delta): {
                "share_of_moves": round(float((pixels > delta).mean()), 4),
                "ever": sorted(most[most > delta].index),
                "mostly": sorted(median[median > delta].index),
            }
            for delta in DELTAS
        },
    }


def changed_pixels(words: list[str]) -> None:
    options = parser(__doc__)
    options.add_argument("--boards", type=int, default=100)
    options.add_argument("--seed", type=int, default=7)
    arguments = options.parse_args(words)
    with tempfile.TemporaryDirectory() as temporary:
        splits = {split: measured(Path(temporary), split, arguments) for split in ("train", "novel-object")}
    named = {f"{split}, {name} responders": one for split, told in splits.items() for name, one in told.items()}
    hashes = {name: {key: one[key] for key in ("board_hash", "content_hash")} for name, one in named.items()}
    figures = {"assets": assets_name(arguments.assets), "splits": splits}
    finish("changed-pixels", arguments, figures, hashes={"data": hashes})
    print(json.dumps(splits, indent=1))


if __name__ == "__main__":
    one_of(main, changed_pixels=changed_pixels)
