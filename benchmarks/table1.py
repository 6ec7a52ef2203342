"""Table 1 of the protocol: all interaction policies, trained and judged by the commands that a user types.

    python benchmarks/table1.py --assets DIR --work FOLDER --out benchmarks/results/table1.json [--rows a,b]

Every command resumes, so this one does: run it again with the same FOLDER after any interruption. A row appears in the
result as soon as both novel splits are judged. All rows propose ten actions on each of the same boards; every trained
row had the same number of boards, actions and iterations. Boards have an appearance each (`--group-size 1`). Time and
memory of a training are noted if nothing interrupted it.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SPLITS = ("novel-config", "novel-object")
KEYS = (
    "precision",
    "recall",
    "recall_objects",
    "precision_exploring",
    "off_axis_share",
    "precision_reward",
    "reward_agreement",
    "boards",
    "intervals",
    "failures_by_cause",
    "failures_by_object",
    "missed_links",
)


@dataclass(frozen=True)
class Row:
    """One policy.

    Attributes:
        train: options of `busybot train interact`; None for a row that trains nothing of its own.
        seed: of the training.
        judge: options of `busybot eval interact`.
        model: a built-in policy, or the row whose model is judged.
    """

    train: tuple[str, ...] | None = ()
    seed: int = 0
    judge: tuple[str, ...] = ()
    model: str | None = None


def _delta(pixels: int) -> Row:
    options = ("--set", "responders=false", "--set", f"interaction.delta={pixels}")
    return Row(options, judge=options)


JOINTS = ("--set", "interaction.reward=joints")


ROWS = {
    "free-0": Row(seed=0),
    "free-1": Row(seed=1),
    "free-2": Row(seed=2),
    "strict-0": Row(("--strict",), 0, ("--strict",)),
    "strict-1": Row(("--strict",), 1, ("--strict",)),
    "strict-2": Row(("--strict",), 2, ("--strict",)),
    "oracle": Row(JOINTS, judge=JOINTS),
    "rgb": Row(("--set", "inputs=rgb")),
    "greedy": Row(None, judge=("--mode", "greedy"), model="free-0"),
    "ucb": Row(None, judge=("--mode", "ucb"), model="free-0"),
    "random": Row(None, model="random"),
    "without-responders-100": _delta(100),
    "without-responders-500": _delta(500),
    "without-responders-1000": _delta(1000),
}
NOTHING_LEARNED = "no recorded action succeeded"
"""What training says where not a single action was rewarded: there is no model to judge."""


def busybot(*arguments: str) -> dict[str, Any]:
    """Run a command with --json and return what it printed; its progress goes on being shown.

    Raises:
        RuntimeError: the command failed; with the last lines of what it said.
    """
    command = [sys.executable, "-m", "busybot", *arguments, "--json"]
    said: deque[str] = deque(maxlen=5)
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        for line in process.stderr:
            print(line, end="", file=sys.stderr, flush=True)
            said.append(line.strip())
        printed = process.stdout.read()
    if process.returncode:
        raise RuntimeError(" ".join(said))
    return dict(json.loads(printed))


def boards(work: Path, split: str, arguments: argparse.Namespace) -> Path:
    """The boards that all rows are judged on, made once."""
    folder = work / f"judge-{split}"
    if not (folder / "dataset.json").exists():
        seed, number = str(arguments.judge_seed), str(arguments.boards)
        options = ("--split", split, "--boards", number, "--seed", seed, "--group-size", "1")
        busybot("generate", str(folder), *options, "--assets", arguments.assets)
    return folder


class Cost:
    """Wall time and memory of the processes below this one, while it is entered."""

    def __enter__(self) -> "Cost":
        self.began, self.megabytes, self._over = time.monotonic(), 0.0, threading.Event()
        self._watch = threading.Thread(target=self._sample, daemon=True)
        self._watch.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._watch.join()
        self.seconds = time.monotonic() - self.began

    def _sample(self) -> None:
        while not self._over.wait(2):
            self.megabytes = max(self.megabytes, sum(_private(pid) for pid in _below(os.getpid())))


def _below(pid: int) -> list[int]:
    found = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in task.read_text().split():
            found += [int(child), *_below(int(child))]
    return found


def _private(pid: int) -> float:
    """Memory that no file backs, MB; pages shared by processes are divided among them."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0  # it has just ended
    return sum(int(line.split()[1]) for line in lines if line.startswith(("Pss_Anon", "Pss_Shmem"))) / 1000


def train(row: Row, out: Path, arguments: argparse.Namespace) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Train, or continue, or find it done; returns the command and what it tells."""
    command = ("train", "interact", "--out", str(out), "--assets", arguments.assets, "--seed", str(row.seed))
    config = ("--config", str(arguments.config)) if arguments.config else ()
    command = (*command, *(row.train or ()), *config)
    fresh, note = not out.exists(), out.with_suffix(".cost.json")
    with Cost() as cost:
        told = busybot(*command)["training"]
    if fresh:
        note.write_text(json.dumps({"seconds": round(cost.seconds), "megabytes": round(cost.megabytes)}))
    told["cost"] = json.loads(note.read_text()) if note.exists() else None
    return command, told


def run(name: str, arguments: argparse.Namespace) -> dict[str, Any]:
    """Train a row if it has a training, and judge it on both novel splits."""
    row, work = ROWS[name], arguments.work
    commands, training = [], None
    model = row.model if row.model == "random" else str(work / (row.model or name))
    if row.train is not None:
        try:
            command, training = train(row, Path(model), arguments)
        except RuntimeError as error:
            if NOTHING_LEARNED not in str(error):
                raise
            return {"commands": [], "training": None, "untrained": NOTHING_LEARNED}
        commands.append(command)
    judged = {}
    for split in SPLITS:
        command = ("eval", "interact", str(boards(work, split, arguments)), "--model", model, *row.judge)
        out = str(work / f"judged-{name}-{split}")
        result = busybot(*command, "--out", out, "--assets", arguments.assets)
        judged[split] = {key: result[key] for key in (*KEYS, "dataset", "versions")}
        commands.append(command)
    lines = ["busybot " + " ".join(command) for command in commands]
    lines = [line.replace(str(work), "WORK").replace(arguments.assets, "ASSETS") for line in lines]
    return {"commands": lines, "training": training, **judged}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", default="procedural")
    parser.add_argument("--work", type=Path, required=True, help="for models and results; continued if it exists")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--rows", default=",".join(ROWS), help="which rows, in this order")
    parser.add_argument("--boards", type=int, default=200, help="per split")
    parser.add_argument("--judge-seed", type=int, default=303)
    parser.add_argument("--config", type=Path, help="YAML file with parameters of every training")
    arguments = parser.parse_args()
    machine = {"cores": os.cpu_count(), "system": platform.system(), "processor": platform.machine()}
    assets = "procedural" if arguments.assets == "procedural" else Path(arguments.assets).name
    result: dict[str, Any] = {"assets": assets, "machine": machine, "rows": {}}
    if arguments.out.exists():
        result["rows"] = json.loads(arguments.out.read_text())["rows"]
    for name in arguments.rows.split(","):
        result["rows"][name] = run(name, arguments)
        arguments.out.write_text(json.dumps(result, indent=1) + "\n")
        for split in SPLITS:
            row = result["rows"][name].get(split, {"precision": 0.0, "recall": 0.0})
            print(f"{name:24} {split:13} P {100 * row['precision']:5.1f} R {100 * row['recall']:5.1f}", flush=True)


if __name__ == "__main__":
    main()
