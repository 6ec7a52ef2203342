"""Counts the pixels that change when a link moves: with responders, and by the trigger's own motion alone.

    python -m benchmarks.studies.changed_pixels --assets DIR [--boards 100] --out FILE

The scripted policy moves the links of training and novel boards, once as they are and once while their responders
show nothing (Table 1, row "w/o responder"). For each reward threshold: the share of the moves that exceed it, the
triggers of which some move does, and those of which most do.
"""

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.runner import as_typed, assets_name, busybot, finish, parser

DELTAS = (100, 500, 1000)
SPLITS = ("train", "novel-object")
SHOWN = {"with": (), "without": ("--set", "responders=false")}
STEPS = 20


def measured(folder: Path, split: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """The moves on boards of a split, with and without responders; folders are named as the commands are told."""
    boards = ("--split", split, "--boards", str(arguments.boards), "--group-size", "1", "--seed", str(arguments.seed))
    told: dict[str, Any] = {}
    for name, options in SHOWN.items():
        data = folder / f"{split}-{name}"
        commands = (
            ("generate", str(data), *boards, "--assets", arguments.assets),
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


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--boards", type=int, default=100)
    options.add_argument("--seed", type=int, default=7)
    arguments = options.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        splits = {split: measured(Path(temporary), split, arguments) for split in SPLITS}
    named = {f"{split}, {name} responders": one for split, told in splits.items() for name, one in told.items()}
    hashes = {name: {key: one[key] for key in ("board_hash", "content_hash")} for name, one in named.items()}
    figures = {"assets": assets_name(arguments.assets), "splits": splits}
    finish("changed-pixels", arguments, figures, hashes={"data": hashes})
    print(json.dumps(splits, indent=1))


if __name__ == "__main__":
    main()
