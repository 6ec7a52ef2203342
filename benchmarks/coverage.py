"""How many links the learned policy would touch when it collects, by the least promise that it accepts.

    python -m benchmarks.coverage DATASET --model MODEL --out benchmarks/results/coverage.json

On the first picture of each recorded board: of the trigger links those whose best candidate promises less (they are
never touched, as long as the board looks like that), and the candidates elsewhere that promise as much (they waste a
step each). `PolicyConfig.collect` was chosen by this on boards of training objects.
"""

import argparse
import json
from collections import Counter
from pathlib import Path
from typing import Any

from benchmarks.commands import write_result
from busybot.episodes.dataset import Dataset
from busybot.episodes.geometry import Rays
from busybot.episodes.mcap_file import read_episode
from busybot.interact.candidates import find_candidates
from busybot.interact.chooser import load_once, policy_config
from busybot.workers import machine

PROMISES = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5)


def coverage(dataset: Dataset, name: str) -> dict[str, Any]:
    """Untouched links and wasted candidates by promise."""
    model = load_once(name)
    config = policy_config(model.info, {})
    links, untouched, elsewhere = 0, Counter[float](), Counter[float]()
    for index in sorted(dataset.finished()):
        episode = read_episode(dataset.episode_path(index), "lazy")
        image = episode.image(0)
        found = find_candidates(model, episode.observation(0), Rays(episode.camera), None, config)
        assert image.segmentation is not None
        codes = image.segmentation[found.pixels[:, 1], found.pixels[:, 0]]
        triggers = [code for code, link in enumerate(episode.links, 1) if link.trigger]
        links += len(triggers)
        for promise in PROMISES:
            enough = found.scores >= promise
            untouched[promise] += sum(not (enough & (codes == code)).any() for code in triggers)
            elsewhere[promise] += int((enough & ~(codes[:, None] == triggers).any(axis=1)).sum())
    origin = {"name": dataset.info.name, "split": dataset.info.split, "board_hash": dataset.hashes().board}
    told = {str(one): {"untouched_links": untouched[one], "elsewhere": elsewhere[one]} for one in PROMISES}
    return {"dataset": origin, "boards": len(dataset.finished()), "links": links, "by_promise": told}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--model", nargs="+", required=True)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    names = [path.parent.name if path.name == "model" else path.name for path in map(Path, arguments.model)]
    if len(set(names)) < len(names):
        parser.error(f"two models have the same name: {', '.join(names)}")
    judged = {
        name: coverage(Dataset.open(arguments.dataset), model)
        for name, model in zip(names, arguments.model, strict=True)
    }
    write_result(
        arguments.out,
        {"command": "python -m benchmarks.coverage VALIDATION --model ...", "machine": machine(), "models": judged},
    )
    print(json.dumps(judged, indent=1))
