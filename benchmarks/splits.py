"""From objects to inferred relations on all three splits, by the commands that a user types.

    python benchmarks/splits.py --assets DIR --out benchmarks/results/splits.json [--boards 40] [--keep FOLDER]

Per split: boards are generated, collected with the scripted and with the random policy, verified, and counting infers
their relations from the first 23 images. The file holds the metrics with the commands, seed, hashes and machine.
`--group-size 1` gives every board its own appearance, so that 40 boards show 40 layouts.
"""

import argparse
import json
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from busybot.workers import machine

SPLITS = ("train", "novel-config", "novel-object")
POLICIES = ("scripted", "random")
METRICS = ("edge_p", "edge_r", "edge_acc", "edge_r_bound", "ece", "brier", "baselines")


def busybot(*arguments: str) -> dict[str, Any]:
    """Run a command with --json and return what it printed, with the command itself."""
    command = ["busybot", *arguments, "--json"]
    result = subprocess.run([sys.executable, "-m", *command], stdout=subprocess.PIPE, check=True, text=True)
    return {"command": " ".join(command), **json.loads(result.stdout)}


def run(split: str, policy: str, folder: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    """One row of the result."""
    out = str(folder / f"{split}-{policy}")
    options = ("--split", split, "--boards", str(arguments.boards), "--seed", str(arguments.seed), "--group-size", "1")
    commands = [busybot("generate", out, *options, "--assets", arguments.assets)]
    began = time.monotonic()
    commands.append(busybot("collect", out, "--policy", policy))
    seconds = time.monotonic() - began
    checked = busybot("dataset", "verify", out)
    info = busybot("dataset", "info", out)
    judged = busybot("eval", "reason", out, "--model", "count")
    commands += [checked, info, judged]
    return {
        "split": split,
        "policy": policy,
        "verified": checked["ok"],
        **{name: judged[name] for name in METRICS},
        **{name: info[name] for name in ("boards", "episodes", "steps", "bytes")},
        **{name: info[name] for name in ("board_hash", "trace_hash", "content_hash")},
        "success_share": info.get("success_share"),
        "collect_seconds": round(seconds, 1),
        "commands": [
            done["command"].replace(str(folder), "DATA").replace(arguments.assets, "ASSETS") for done in commands
        ],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", default="procedural")
    parser.add_argument("--boards", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the datasets; a temporary one by default")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        rows = [run(split, policy, folder, arguments) for policy in POLICIES for split in SPLITS]
    assets = "procedural" if arguments.assets == "procedural" else Path(arguments.assets).name
    on = {**machine(), "python": platform.python_version()}
    result = {"assets": assets, "seed": arguments.seed, "machine": on, "rows": rows}
    arguments.out.write_text(json.dumps(result, indent=2) + "\n")
    for row in rows:
        print(row["split"], row["policy"], row["edge_p"], row["edge_r"], row["edge_r_bound"], row["success_share"])


if __name__ == "__main__":
    main()
