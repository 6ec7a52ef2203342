"""The recorded boards of Table 2, by the commands that a user types.

    python -m benchmarks.tables.reason_data --model MODEL --assets DIR --data FOLDER [--only train,random/train]

`--model` is the interaction policy that records (`busybot train interact`). Beneath `random` lie recordings of the same
boards without exploration. Every board has an appearance of its own: 300 tell more than 15. Every command resumes, so
this one does.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.runner import busybot

STEPS = 30


@dataclass(frozen=True)
class RecordedSplit:
    """Boards of one split.

    Attributes:
        split: of `busybot generate`.
        seed: no two recordings share boards, except with and without exploration.
    """

    split: str
    boards: int
    seed: int


JUDGED = {
    "novel-object": RecordedSplit("novel-object", 300, 604),
    "novel-config": RecordedSplit("novel-config", 300, 603),
    "validation": RecordedSplit("train", 150, 602),
}
LEARNED = {**JUDGED, "train": RecordedSplit("train", 1000, 601)}
RANDOM = {name: replace(recording, boards=min(150, recording.boards)) for name, recording in JUDGED.items()}
RANDOM["train"] = replace(LEARNED["train"], boards=300)
"""The first of the same boards: without exploration there is little to find, and fewer boards tell it."""


def record(folder: Path, recording: RecordedSplit, most: int, assets: str, *policy: str) -> None:
    """Generate the boards and act on them; what is there is left alone."""
    seed, count = ("--seed", str(recording.seed)), str(min(most, recording.boards))
    boards = ("--split", recording.split, "--boards", count, "--group-size", "1")
    busybot("generate", str(folder), *boards, *seed, "--assets", assets)
    busybot("collect", str(folder), "--steps", str(STEPS), "--policy", *policy, *seed, "--assets", assets)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", required=True)
    parser.add_argument("--assets", default="procedural")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--only", help="names, comma-separated; all by default")
    parser.add_argument("--most", type=int, default=10_000, help="boards per recording")
    arguments = parser.parse_args()
    named = arguments.only.split(",") if arguments.only else None
    for name, recording in LEARNED.items():
        if named is None or name in named:
            policy = ("learned", "--model", arguments.model)
            record(arguments.data / name, recording, arguments.most, arguments.assets, *policy)
    for name, recording in RANDOM.items():
        if named is None or f"random/{name}" in named:
            record(arguments.data / "random" / name, recording, arguments.most, arguments.assets, "random")
