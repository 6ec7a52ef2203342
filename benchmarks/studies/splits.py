"""From objects to inferred relations on all three splits, by the commands that a user types.

    python -m benchmarks.studies.splits --assets DIR --out benchmarks/results/splits.json [--boards 40] [--keep FOLDER]

Per split: boards are generated, collected with the scripted and with the random policy, verified, and counting infers
their relations from the first 23 images. The file holds the metrics with the commands, seed, hashes and machine.
`--group-size 1` gives every board its own appearance, so that 40 boards show 40 layouts.
"""

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks import runner
from benchmarks.runner import as_typed, assets_name

SPLITS = ("train", "novel-config", "novel-object")
POLICIES = ("scripted", "random")
HASHES = ("board_hash", "trace_hash", "content_hash")
METRICS = ("edge_p", "edge_r", "edge_acc", "edge_r_bound", "ece", "brier", "baselines")


def run(split: str, policy: str, folder: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    """One row of the result."""
    out = str(folder / f"{split}-{policy}")
    options = ("--split", split, "--boards", str(arguments.boards), "--seed", str(arguments.seed), "--group-size", "1")
    places = {str(folder): "DATA", arguments.assets: "ASSETS"}
    commands: list[str] = []

    def busybot(*command: str) -> dict[str, Any]:
        commands.append(as_typed(command, places))
        return runner.busybot(*command)

    busybot("generate", out, *options, "--assets", arguments.assets)
    began = time.monotonic()
    busybot("collect", out, "--policy", policy)
    seconds = time.monotonic() - began
    checked = busybot("dataset", "verify", out)
    info = busybot("dataset", "info", out)
    judged = busybot("eval", "reason", out, "--model", "count")
    return {
        "split": split,
        "policy": policy,
        "verified": checked["ok"],
        **{name: judged[name] for name in METRICS},
        **{name: info[name] for name in ("boards", "episodes", "steps", "bytes")},
        **{name: info[name] for name in HASHES},
        "success_share": info.get("success_share"),
        "collect_seconds": round(seconds, 1),
        "commands": commands,
    }


def main() -> None:
    options = runner.parser(__doc__)
    options.add_argument("--boards", type=int, default=40)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--keep", type=Path, help="folder for the datasets; a temporary one by default")
    arguments = options.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        rows = [run(split, policy, folder, arguments) for policy in POLICIES for split in SPLITS]
    hashes = {f"{row['split']}, {row['policy']}": {name: row[name] for name in HASHES} for row in rows}
    figures = {"assets": assets_name(arguments.assets), "rows": rows}
    runner.finish("splits", arguments, figures, hashes={"data": hashes})
    for row in rows:
        print(row["split"], row["policy"], row["edge_p"], row["edge_r"], row["edge_r_bound"], row["success_share"])


if __name__ == "__main__":
    main()
