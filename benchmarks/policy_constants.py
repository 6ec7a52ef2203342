"""The constants of the learned policy, one varied at a time on boards of training objects.

    python benchmarks/policy_constants.py --assets DIR --model TRAINING --out benchmarks/results/policy-constants.json

TRAINING is a training's folder. Judged is the model of its first round, on boards that it was not trained on: it makes
enough mistakes for the constants to matter, where the final one makes hardly any on objects that it knows.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

SEED = 71
VALUES: dict[str, tuple[float, ...]] = {
    "explore": (0.2, 0.35, 0.5),
    "prior": (0.05, 0.15, 0.4),
    "dense_weight": (0.25, 0.5, 0.75),
    "component_penalty": (0.3, 1.0, 2.0),
    "failure_penalty": (0.3, 0.7, 1.4),
    "failure_sigma": (3.0, 6.0, 12.0),
    "opening": (3, 5, 9),
    "same_link": (0.1, 0.25, 0.5),
    "peak_radius": (2, 3, 6),
}
"""The value in the middle is the default."""
KEYS = ("precision", "recall", "precision_exploring")


def busybot(*arguments: str) -> dict[str, Any]:
    """Run a command with --json and return what it printed."""
    command = [sys.executable, "-m", "busybot", *arguments, "--json"]
    return dict(json.loads(subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True).stdout))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", default="procedural")
    parser.add_argument("--model", type=Path, required=True, help="folder of a training")
    parser.add_argument("--boards", type=int, default=100)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    model = arguments.model / "models" / "00"
    result: dict[str, Any] = {"seed": SEED, "boards": arguments.boards, "rows": {}}
    with tempfile.TemporaryDirectory() as folder:
        boards = f"{folder}/boards"
        number = str(arguments.boards)
        make = ("generate", boards, "--split", "train", "--boards", number, "--group-size", "1", "--seed", str(SEED))
        result["board_hash"] = busybot(*make, "--assets", arguments.assets)["board_hash"]

        def judge(*settings: str) -> dict[str, float]:
            options = [word for setting in settings for word in ("--set", setting)]
            told = busybot("eval", "interact", boards, "--model", str(model), "--assets", arguments.assets, *options)
            return {key: round(told[key], 4) for key in KEYS}

        result["rows"]["defaults"] = judge()
        for name, values in VALUES.items():
            for value in (values[0], values[-1]):
                row = f"{name}={value}"
                result["rows"][row] = judge(f"learned.{row}")
                print(row, result["rows"][row], file=sys.stderr, flush=True)
    arguments.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
