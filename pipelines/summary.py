"""The few figures of a run that one looks at first, and its learning curves, for DVC and for people.

    python -m pipelines.summary runs/smoke

Reads what the other stages left behind of what the run's profile asks for; writes `metrics.json` and `curves.tsv`
beside it, in the forms that DVC asks for, which are numbers alone: where they come from is told by the results that
they are taken from.
"""

import csv
import io
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from busybot.common.atomic_io import read_json, write_atomically
from busybot.common.errors import BusybotError
from busybot.training.run_folder import read_metrics
from pipelines.profile import Profile, profile_of, run_of

SHOWN = {
    "interact": ("judged/{}/result.json", ("precision", "recall", "precision_exploring", "boards")),
    "relations": ("relations/{}/result.json", ("edge_p", "edge_r", "edge_r_bound", "pred_a", "pred_a_bound", "boards")),
    "plan": ("planned/{}/result.json", ("success", "tasks")),
}


def metrics(run: Path, asked: Profile) -> dict[str, Any]:
    """By skill and split; what a stage did not make is left out."""
    found: dict[str, Any] = {}
    splits: dict[str, Iterable[str]] = {
        "interact": asked.judge.splits,
        "relations": asked.relations.sets,
        "plan": asked.tasks.cells,
    }
    for skill, (place, keys) in SHOWN.items():
        for split in splits[skill]:
            file = run / place.format(split)
            if file.is_file():
                result = read_json(file)
                found.setdefault(skill, {})[split] = {key: result[key] for key in keys}
    return found


def curves(run: Path) -> str:
    """Losses by iteration as tab-separated values, one line per network and report."""
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    writer.writerow(("network", "iteration", "loss"))
    for file in sorted((run / "interact" / "metrics").glob("*.jsonl"), reverse=True):  # position first
        losses = (line for line in read_metrics(file) if "loss" in line)
        writer.writerows((file.stem, line["iteration"], line["loss"]) for line in losses)
    return text.getvalue()


def main() -> None:
    run = run_of(sys.argv[1:])
    write_atomically(run / "metrics.json", (json.dumps(metrics(run, profile_of(run)), indent=1) + "\n").encode())
    write_atomically(run / "curves.tsv", curves(run).encode())


if __name__ == "__main__":
    try:
        main()
    except BusybotError as error:
        sys.exit(f"error: {error}")
