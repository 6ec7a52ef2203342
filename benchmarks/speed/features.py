"""Measures how many frames a second are turned into features, by the clock and by processor time, into a new store.

python -m benchmarks.speed.features --data DATASET [--encoder NAME] [--workers 2] [--out FILE]
"""

import argparse
import json
import os
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.runner import finish, parser
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.reason.inputs.feature_store import features_of


def measured(arguments: argparse.Namespace) -> dict[str, Any]:
    """All figures."""
    dataset = Dataset.open(arguments.data)
    dataset.hashes()  # so that the tables, not the first encoder, pay for reading what they need
    with tempfile.TemporaryDirectory() as store:
        load, before, began = os.getloadavg()[0], _processor_seconds(), time.monotonic()
        features = features_of(dataset, arguments.encoder, store=Path(store), workers=arguments.workers)
        seconds, used = time.monotonic() - began, _processor_seconds() - before
        frames = sum(len(values) for values in features.values())
    pictures = sum(len(read_episode(dataset.episode_path(i), "lazy").images) for i in features)
    return {
        "encoder": arguments.encoder,
        "workers": arguments.workers,
        "episodes": len(features),
        "frames": frames,
        "pictures": pictures,
        "seconds": round(seconds, 2),
        "cpu_seconds": round(used, 2),
        "frames_per_second": round(frames / seconds, 1),
        "frames_per_cpu_second": round(frames / used, 1),
        "pictures_per_cpu_second": round(pictures / used, 1),
        "load_before": round(load, 2),
        "cores": os.cpu_count(),
    }


def _processor_seconds() -> float:
    own, ended = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + ended.ru_utime + ended.ru_stime


def main() -> None:
    options = parser(__doc__, assets=False, out=False)
    options.add_argument("--data", type=Path, required=True, help="recorded dataset")
    options.add_argument("--encoder", default="embedded")
    options.add_argument("--workers", type=int, default=2)
    arguments = options.parse_args()
    data = {arguments.data.name: {"content_hash": Dataset.open(arguments.data).hashes().content}}
    print(json.dumps(finish("features-speed", arguments, measured(arguments), hashes={"data": data}), indent=1))


if __name__ == "__main__":
    main()
