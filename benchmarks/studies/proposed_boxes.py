"""What is lost where nobody gives the objects: proposed boxes beside the true ones, for every measure of relations.

    python -m benchmarks.studies.proposed_boxes --data DATA --assets DIR --out benchmarks/results/proposed-boxes.json
        [--only gates,time]

DATA is what `benchmarks.tables.worlds record` makes: of each world the boards of `validation`, of the training split,
on which nothing is trained, are judged twice by what ships with busybot, as `busybot eval reason --boxes` does it.
Nothing is chosen here, and no test split is looked at.
"""

import argparse
from pathlib import Path
from typing import Any

from benchmarks import runner
from benchmarks.tables.worlds import NAMES

KIND = "proposed-boxes"
REASONERS = ("event", "mechanism", "count")
BOXES = ("given", "proposed")
KEYS = (
    *("boards", "edge_p", "edge_r", "parent_p", "parent_r", "parent_f1", "link_parent_p", "link_parent_r"),
    *("link_parent_f1", "mechanism_accuracy", "pred_a", "what_if", "ece_uncertain", "uncertain_pairs"),
    *("proposal_r", "proposal_r_triggers", "proposal_r_responders", "proposal_r_boxes", "proposal_p"),
    *("rewirings", "rewired_found", "rewired_placed", "rewired_false_alarms"),
    *("intervals", "object_intervals", "hashes"),
)


def judged(world: str, options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Figures of each reasoner, by the way in which it gets its boxes."""
    found: dict[str, dict[str, Any]] = {}
    names = [word for one in REASONERS for word in ("--reasoner", one)]
    for boxes in BOXES:
        folder = options.data / world / "validation"
        told = runner.busybot("eval", "reason", str(folder), *names, "--boxes", boxes, "--assets", options.assets)
        for one, result in zip(REASONERS, told["results"], strict=True):
            found.setdefault(one, {})[boxes] = {key: result[key] for key in KEYS}
    return found


def main(words: list[str]) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--data", type=Path, required=True, help="recorded boards of worlds")
    options.add_argument("--only", default=",".join(NAMES), help="names of worlds, comma-separated; all by default")
    arguments = options.parse_args(words)
    rows: dict[str, Any] = runner.told_rows(arguments.out, KIND, assets=runner.assets_name(arguments.assets))
    for world in runner.chosen(arguments.only, NAMES):
        rows[world] = judged(world, arguments)
        runner.finish(KIND, arguments, {"assets": runner.assets_name(arguments.assets), "rows": rows})
        for name, ways in rows[world].items():
            told = ", ".join(f"{way} {100 * (one['parent_f1'] or 0):.1f}" for way, one in ways.items())
            print(f"{world:8} {name:10} F1 of parents: {told}", flush=True)


if __name__ == "__main__":
    runner.one_of(main)
