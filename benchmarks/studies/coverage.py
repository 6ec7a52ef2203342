"""Counts the links that the learned policy would touch when it collects, by the least promise that it accepts.

    python -m benchmarks.studies.coverage --data DATASET --model MODEL --out benchmarks/results/coverage.json

On the first picture of each recorded board: of the trigger links those whose best candidate promises less (they are
never touched, as long as the board looks like that), and the candidates elsewhere that promise as much (they waste a
step each). `PolicyConfig.collect` was chosen by this on boards of training objects.
"""

import json
from collections import Counter
from pathlib import Path
from typing import Any

from benchmarks.runner import finish, parser
from busybot.datasets.dataset import Dataset
from busybot.episodes.camera import Rays
from busybot.episodes.mcap.reader import read_episode
from busybot.interact.policy.candidates import find_candidates
from busybot.interact.policy.policy_factory import fingerprint, load_once, policy_config

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
    options = parser(__doc__, assets=False)
    options.add_argument("--data", type=Path, required=True, help="recorded dataset")
    options.add_argument("--model", nargs="+", required=True)
    arguments = options.parse_args()
    names = [path.parent.name if path.name == "model" else path.name for path in map(Path, arguments.model)]
    if len(set(names)) < len(names):
        options.error(f"two models have the same name: {', '.join(names)}")
    judged = {
        name: coverage(Dataset.open(arguments.data), model) for name, model in zip(names, arguments.model, strict=True)
    }
    origins = {one["dataset"]["name"]: {"board_hash": one["dataset"]["board_hash"]} for one in judged.values()}
    models = {name: fingerprint(model)["sha256"] for name, model in zip(names, arguments.model, strict=True)}
    finish("coverage", arguments, {"models": judged}, hashes={"models": models, "data": origins})
    print(json.dumps(judged, indent=1))
