"""The twin of the paper's real board, under the real camera at its hardest, by models that never saw it.

    python -m benchmarks.tables.real_board --assets DIR --work FOLDER --out benchmarks/results/real_board.json

Models of the kind `event` are trained on boards of the paper's world with the objects in DIR, on clean pictures with
five seeds, and under the real camera with randomised appearance, with five. The twin has other objects. Each of its
six wirings is recorded for 30 steps by somebody who knows where the switches are, and judged in six windows of 25
steps: 36 sequences with 108 relations. Under the hardest camera there is a twin for each seed, with other switches,
places and colours; the others are asked of the first one, the terms alone by photos of its clean recording.

Recordings and trainings lie in the folder `--work` and are gone on with; so are judgements.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.runner import as_typed, assets_name, busybot, finish, generating, one_of, parser, settings, train
from busybot.common.atomic_io import write_atomically, write_json
from busybot.datasets.dataset import Dataset
from busybot.episodes.codec import encode_rgb
from busybot.episodes.episode import Episode, Image
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.results import code_digest
from busybot.evaluation.statistics import binomial_interval
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.evaluation.evaluate import origin
from busybot.reason.inputs.object_masks import changes
from busybot.reason.inputs.observation import NO_BOXES, ObservedEpisode, acted_objects, observe_episode
from busybot.reason.inputs.sequence import sequence_of
from busybot.reason.models.counting import CountConfig, count_changes
from busybot.reason.models.registry import reasoner_of
from busybot.sim.scene.real_camera import REAL, CameraConfig, take_photo
from busybot.training.model_cards import file_hashes, find_folder

STEPS, WINDOW, WINDOWS = 30, 25, 6
TRAIN_SEED = 24001
HARDEST = {term: 2 * strength for term, strength in REAL.items()} | {"hand": 0.2, "shadow": 0.5, "jpeg": 60}
"""Twice what `--camera real` does, a hand in every fifth picture, JPEG 60."""
RANDOMISED = ("pose=0.3", "fov=0.1", "lights=0.5", "textures=0.5")


def camera(**terms: float) -> tuple[str, ...]:
    """Options of a camera with these terms."""
    return settings(*(f"render.camera.{term}={strength}" for term, strength in terms.items()))


CAMERAS = {"hardest": camera(**HARDEST), "clean": (), "real": ("--camera", "real")}
TRAINED = {
    "event, clean": (),
    "event, randomised": ("--camera", "real", *settings(*(f"render.randomise.{one}" for one in RANDOMISED))),
}
"""What the pictures are like on which each is trained."""
SHIPPED = {"event, shipped": "event", "lookup": "lookup"}
SLOW = {"mechanism, shipped": "mechanism"}
"""Judged at the end, on the first twin alone, under two cameras."""
EVERY = "every pair"
Judge = Callable[[ObservedEpisode, np.ndarray], np.ndarray]
"""Claimed edges of each window, bool (WINDOWS, N, N), from a recording and its features."""
FIRST = 1
"""Seed of the first twin."""


def main(words: list[str]) -> None:
    options = parser(__doc__, out=True)
    options.add_argument("--work", type=Path, required=True, help="for data, models and judgements; continued")
    options.add_argument("--seeds", type=int, default=5)
    options.add_argument("--boards", type=int, default=40, help="to train on")
    arguments = options.parse_args(words)
    places = {str(arguments.work): "WORK", str(arguments.assets): "ASSETS"}
    done: list[tuple[str, ...]] = []

    def run(*command: str) -> None:
        done.append(command)
        busybot(*command)

    models, trainings = trained(arguments, run, done)
    rows: dict[str, dict[str, Any]] = {}
    hashes: dict[str, dict[str, Any]] = {}
    jobs = [("hardest", "", number) for number in range(arguments.seeds)] + [("clean", "", 0), ("real", "", 0)]
    jobs += [*(("clean", term, 0) for term in HARDEST), ("real", "slow", 0), ("hardest", "slow", 0)]
    for name, term, twin in jobs:
        data = arguments.work / f"twin-{FIRST + twin}-{name}"
        run("generate", str(data), "--world", "real-board", "--seed", str(FIRST + twin))
        run("collect", str(data), "--policy", "scripted", "--steps", str(STEPS), *CAMERAS[name])
        told = origin(Dataset.open(data))
        hashes[data.name] = {key: told[key] for key in told if key.endswith("_hash")}
        chosen: dict[str, list[str]] = {row: [model] for row, model in SHIPPED.items()} | {"count": [""], EVERY: [""]}
        for row, found in models.items():
            chosen[row] = [str(found[twin % len(found)])] if name == "hardest" else list(map(str, found))
        if term == "slow":
            chosen, term = {row: [model] for row, model in SLOW.items()}, ""
        for row, counts in judged(data, term, chosen, arguments.work).items():
            rows.setdefault(row, {}).setdefault(term or name, []).extend(counts)
        table = {row: {camera: pooled(counts) for camera, counts in found.items()} for row, found in rows.items()}
        figures = {"assets": assets_name(arguments.assets), "boards": arguments.boards, "hardest": HARDEST}
        figures |= {"rows": table, "training": trainings}
        figures["commands"] = list(dict.fromkeys(as_typed(one, places) for one in done))
        told_models = {path.name: file_hashes(path / "model") for found in models.values() for path in found}
        finish("real-board", arguments, figures, hashes={"data": hashes, "models": told_models}, seed=TRAIN_SEED)
        shares = {row: (of["p"], of["r"]) for row, found in table.items() if (of := found.get(term or name))}
        print(term or name, twin, shares, flush=True)


def trained(
    arguments: Any, run: Callable[..., None], done: list[tuple[str, ...]]
) -> tuple[dict[str, list[Path]], dict[str, Any]]:
    """The folders of the models by row and seed, and what their trainings tell."""
    models: dict[str, list[Path]] = {}
    told: dict[str, Any] = {}
    for row, pictures in TRAINED.items():
        name = row.split(", ")[1]
        data = arguments.work / f"train-{name}"
        run(*generating(data, "train", arguments.boards, TRAIN_SEED, arguments.assets))
        run("collect", str(data), "--policy", "scripted", "--steps", str(STEPS), *pictures)
        for seed in range(arguments.seeds):
            out = arguments.work / f"event-{name}-{seed}"
            command = ("train", "reason", "--data", str(data), "--out", str(out), "--seed", str(seed))
            done.append(command)
            told[out.name] = train(out, *command)["cost"]
            models.setdefault(row, []).append(out)
    return models, told


def judged(data: Path, term: str, chosen: dict[str, list[str]], work: Path) -> dict[str, list[dict[str, int]]]:
    """By row and model: how many edges it claims in the windows of a twin, how many are right, how many there are."""
    dataset, note = Dataset.open(data), work / "judged" / f"{data.name}-{term}-{len(chosen)}.json"
    trained = {one for found in chosen.values() for one in found} - {"", "lookup"}
    hashes = {one: file_hashes(find_folder(one, "reason")) for one in sorted(trained)}
    key = {"content": dataset.hashes().content, "chosen": chosen, "models": hashes, "code": code_digest()}
    if note.exists() and json.loads(note.read_text())["key"] == key:
        return dict(json.loads(note.read_text())["counted"])
    counted = {row: [{"claimed": 0, "right": 0, "true": 0} for _ in models] for row, models in chosen.items()}
    for index in sorted(dataset.finished()):
        episode = read_episode(dataset.episode_path(index), "lazy")
        observed = photographed(episode, term) if term else observe_episode(episode)
        features = make_extractor().of(observed)
        true = np.array(episode.board.relation_matrix(), bool)
        for row, models in chosen.items():
            for count, model in zip(counted[row], models, strict=True):
                claimed = ({"count": by_counting, EVERY: all_pairs}.get(row) or by_reasoner(model))(observed, features)
                count["claimed"] += int(claimed.sum())
                count["right"] += int((claimed & true).sum())
                count["true"] += int(true.sum()) * WINDOWS
    note.parent.mkdir(exist_ok=True)
    write_json(note, {"key": key, "counted": counted})
    return counted


def photographed(episode: Episode, term: str) -> ObservedEpisode:
    """A clean recording as a camera with one term would have shown it, each frame by itself."""
    observed, config = observe_episode(episode), CameraConfig.model_validate({term: HARDEST[term]})
    where = (0, episode.board.split, episode.board.index)
    photos = [take_photo(episode.image(number), config, where, number) for number in range(len(episode.frame_of))]
    images = [Image(photo.rgb, photo.depth, None, NO_BOXES) for photo in photos]
    return replace(observed, images=images, image_of=tuple(range(len(images))))


def by_reasoner(model: str) -> Judge:
    """Of a model that reads features."""
    reasoner = reasoner_of(model)

    def claimed(observed: ObservedEpisode, features: np.ndarray) -> np.ndarray:
        told = []
        for start in range(WINDOWS):
            seen = sequence_of(observed.window(start, WINDOW), features[start : start + WINDOW + 1])
            told.append(reasoner.graph(seen).claimed(WINDOW))
        return np.array(told)

    return claimed


def by_counting(observed: ObservedEpisode, _: np.ndarray) -> np.ndarray:
    config = CountConfig()
    changed, acted = changes(observed, config.change), acted_objects(observed)
    parts = [slice(start, start + WINDOW) for start in range(WINDOWS)]
    sides = (observed.triggers, observed.responders)
    found = [count_changes(changed[part], acted[part], *sides, config)[-1] > config.claimed for part in parts]
    return np.array(found)


def all_pairs(observed: ObservedEpisode, _: np.ndarray) -> np.ndarray:
    return np.repeat(observed.candidates[None], WINDOWS, axis=0)


def pooled(counts: list[dict[str, int]]) -> dict[str, Any]:
    """Precision and recall over all sequences, the least of a single seed, and exact intervals.

    Windows of a recording overlap: intervals take its relations once.
    """
    total = {key: sum(one[key] for one in counts) for key in counts[0]}
    told: dict[str, Any] = {**total, "seeds": counts}
    for name, whole in (("p", "claimed"), ("r", "true")):
        shares = [one["right"] / one[whole] if one[whole] else None for one in counts]
        told[name] = total["right"] / total[whole] if total[whole] else None
        told[f"{name}_least"] = None if None in shares else min(share for share in shares if share is not None)
        told[f"{name}_interval"] = binomial_interval(total["right"] // WINDOWS, total[whole] // WINDOWS)
    return told


def sheet(words: list[str]) -> None:
    """Three frames in a row of the first twin under the hardest camera."""
    options = parser(sheet.__doc__, assets=False)
    options.add_argument("--work", type=Path, required=True, help="with the recordings")
    options.add_argument("--frame", type=int, default=0, help="the first of them")
    arguments = options.parse_args(words)
    episode = read_episode(Dataset.open(arguments.work / f"twin-{FIRST}-hardest").episode_path(0), "lazy")
    frames = [episode.image(number).rgb for number in range(arguments.frame, arguments.frame + 3)]
    height, width = frames[0].shape[:2]
    cut = [frame[height // 5 : -height // 4, width // 4 : -width // 5] for frame in frames]
    write_atomically(arguments.out, encode_rgb(np.hstack(cut), "jpeg"))


if __name__ == "__main__":
    one_of(main, sheet=sheet)
