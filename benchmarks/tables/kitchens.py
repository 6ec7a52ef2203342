"""Relations of a stove and of a room, found by models that were trained on boards alone.

    python -m benchmarks.tables.kitchens --work FOLDER --out benchmarks/results/kitchens.json
        [--seeds 5] [--boards 4] [--only kitchen,room]
    python -m benchmarks.tables.kitchens sheet --work FOLDER --out docs/images/kitchens.jpg

For each scene and seed boards are drawn (half with the orderly wiring, half with another; the room's objects are those
of the split `novel-object`) and acted on 60 times, in four ways: `passive` is the scripted policy, which takes a
random link that shows; `coverage` takes the one that was taken least often, with the same oracle of contacts and
directions; `learned` is the shipped policy, which finds where and how to act itself, in pictures of the size that it
was trained on; `persistent` is the same with `learned.persist=0.5`: half of its actions go to what has not moved yet,
however little it promises. The shipped reasoners `event` and `mechanism`, and `count`, which nobody trains, are judged
beside rows that look at no effect: all pairs, for every responder a random trigger, and the trigger nearest to it in
the picture.

The command resumes: recordings where they were stopped, rows after the last scene and way that was written. Rows that
are there keep the hashes that they were made with.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks import runner
from busybot.boards.scenes import SCENES
from busybot.common.atomic_io import write_atomically
from busybot.common.rng import generator
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.dataset import Dataset
from busybot.episodes.camera import Rays
from busybot.episodes.codec import encode_rgb
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.results import read_result
from busybot.reason.evaluation.ground_truth import truth_of
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.inputs.observation import observe_episode
from busybot.reason.inputs.sequence import sequence_of
from busybot.reason.models.registry import infer, reasoner_of
from busybot.sim.builtin_policies import ScriptedPolicy
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.interaction import InteractionConfig
from busybot.sim.scene.board_scene import BoardScene
from busybot.training.model_cards import file_hashes, find_folder

KIND, FIRST_SEED, STEPS = "kitchens", 900, 60
SPLITS = {"kitchen": "train", "room": "novel-object"}
WAYS = ("passive", "coverage", "learned", "persistent")
OWN_HANDS: dict[str, list[str]] = {"learned": [], "persistent": ["learned.persist=0.5"]}
"""Settings of the shipped policy."""
TRAINED = ("event", "mechanism")
JUDGED = (10, 20, 30, 40, 50, 60)
PICTURES = {"width": 320, "height": 240}
TILES, MARGIN = 3, 6
Claims = dict[str, dict[int, np.ndarray]]


class CoveragePolicy(ScriptedPolicy):
    """The visible link that was taken least often, of several a random one; contacts as of the scripted policy."""

    name = "coverage"

    def __init__(self, scene: BoardScene, rays: Rays, config: InteractionConfig):
        super().__init__(scene, rays, config)
        self._taken = np.zeros(len(scene.triggers), int)

    def choose(self, visible: list[tuple[int, np.ndarray]], rng: np.random.Generator) -> tuple[int, np.ndarray]:
        counts = self._taken[[number for number, _ in visible]]
        least = np.flatnonzero(counts == counts.min())
        number, mask = visible[int(least[rng.integers(len(least))])]
        self._taken[number] += 1
        return number, mask


@dataclass(frozen=True)
class CoverageFactory:
    name: str = CoveragePolicy.name

    def make_oracle(self, scene: BoardScene, rays: Rays, config: InteractionConfig) -> CoveragePolicy:
        return CoveragePolicy(scene, rays, config)


def recorded(world: str, way: str, seed: int, options: Any) -> Dataset:
    """The boards of a scene, acted on; what is there is left alone."""
    folder, learned = options.work / f"{world}-{seed}-{way}", way in OWN_HANDS
    drawn = ("--split", SPLITS[world], "--boards", str(options.boards), "--seed", str(seed), "--assets", options.assets)
    runner.busybot("generate", str(folder), "--world", world, *drawn)
    if way == "coverage":
        dataset = Dataset.open(folder)
        config = CollectConfig.model_validate({"policy": way, "steps": STEPS, "render": PICTURES})
        collect(dataset, library_of(dataset, options.assets), config, 1, factory=CoverageFactory())
        return dataset
    told = [] if learned else [f"render.{name}={value}" for name, value in PICTURES.items()]
    told += OWN_HANDS.get(way, [])
    acting = ("--policy", "learned" if learned else "scripted", "--steps", str(STEPS), "--assets", options.assets)
    runner.busybot("collect", str(folder), *acting, "--workers", "1", *runner.settings(*told))
    return Dataset.open(folder)


def claims_of(episode: Episode, features: np.ndarray) -> Claims:
    """What each row claims after each number of actions, bool (N, N)."""
    observed = observe_episode(episode)
    sequence = sequence_of(observed, features)
    graphs = {name: reasoner_of(name).graph(sequence) for name in TRAINED} | {"count": infer(observed, "count")}
    found = {name: {actions: graph.claimed(actions) for actions in JUDGED} for name, graph in graphs.items()}
    candidates = observed.candidates
    seen = np.asarray((observed.boxes >= 0).all(axis=1))
    middles = np.where(seen[:, None], observed.boxes.reshape(-1, 2, 2).mean(1), np.inf)
    apart = np.linalg.norm(np.nan_to_num(middles, posinf=1e6)[:, None] - middles[None], axis=-1)
    drawn = generator(episode.board.seed, episode.board.split, episode.board.index, "kitchens").random(apart.shape)
    for name, cost in (("nearest", apart), ("random", drawn)):
        own = np.where(candidates, cost, np.inf)
        found[name] = dict.fromkeys(JUDGED, candidates & (own == own.min(0)))
    return found | {"all pairs": dict.fromkeys(JUDGED, candidates)}


def judged(dataset: Dataset) -> Iterator[dict[str, Any]]:
    """Of each board its wiring, how many actions moved something and controls were moved, and counts by row and number
    of actions: rightly claimed, claimed and true relations."""
    features = features_of(dataset, "embedded", workers=1)
    for index in sorted(dataset.finished()):
        episode = read_episode(dataset.episode_path(index), "lazy")
        true = truth_of(episode).edges()
        controls = {(ref.object, ref.link) for one in episode.board.relations for ref in one.triggers}
        moved = {(step.acted_object, step.acted_link) for step in episode.steps if step.success}
        yield {
            "orderly": index % 2 == 0,
            "objects": len(episode.board.objects),
            "success": sum(step.success for step in episode.steps),
            "controls": [len(controls & moved), len(controls)],
            "rows": {
                name: {str(k): [int((one & true).sum()), int(one.sum()), int(true.sum())] for k, one in told.items()}
                for name, told in claims_of(episode, features[index]).items()
            },
        }


def f1_of(counts: list[list[int]]) -> float:
    """Of boards taken together."""
    hits, claimed, true = np.sum(counts, axis=0).tolist()
    return float(2 * hits / (claimed + true)) if claimed + true else 0.0


def summed(boards: dict[int, list[dict[str, Any]]]) -> dict[str, Any]:
    """Figures of a scene and a way of acting.

    Args:
        boards: judged ones, by seed.
    """
    every = [one for own in boards.values() for one in own]
    moved, controls = np.sum([one["controls"] for one in every], axis=0).tolist()
    rows: dict[str, Any] = {}
    for name in every[0]["rows"]:
        rows[name] = {}
        for actions in map(str, JUDGED):
            counts = [one["rows"][name][actions] for one in every]
            hits, claimed, true = np.sum(counts, axis=0).tolist()
            by_seed = [f1_of([one["rows"][name][actions] for one in own]) for own in boards.values()]
            rows[name][actions] = {
                "p": hits / claimed if claimed else None,
                "r": hits / true,
                "f1": f1_of(counts),
                "seeds": by_seed,
                "orderly": f1_of([one["rows"][name][actions] for one in every if one["orderly"]]),
                "permuted": f1_of([one["rows"][name][actions] for one in every if not one["orderly"]]),
            }
    return {
        "boards": len(every),
        "objects": [min(one["objects"] for one in every), max(one["objects"] for one in every)],
        "success": float(np.mean([one["success"] for one in every]) / STEPS),
        "controls": moved / controls,
        "rows": rows,
    }


def main(words: list[str]) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--work", type=Path, required=True, help="for recordings")
    options.add_argument("--seeds", type=int, default=5)
    options.add_argument("--boards", type=int, default=4, help="of each scene and seed")
    options.add_argument("--only", help="names of scenes, comma-separated; all by default")
    arguments = options.parse_args(words)
    arguments.work.mkdir(parents=True, exist_ok=True)
    models = {name: file_hashes(find_folder(name, "reason")) for name in TRAINED}
    before = runner.told_rows(arguments.out, KIND, assets=runner.assets_name(arguments.assets))
    rows = {name: row for name, row in before.items() if name.split(", ")[1] in WAYS}
    data: dict[str, Any] = read_result(arguments.out, KIND)["hashes"]["data"] if rows else {}
    for world in runner.chosen(arguments.only, SCENES) if arguments.only else SCENES:
        for way in WAYS:
            if f"{world}, {way}" in rows:
                continue
            boards = {}
            for seed in range(FIRST_SEED, FIRST_SEED + arguments.seeds):
                dataset = recorded(world, way, seed, arguments)
                data[f"{world}, {way}, {seed}"] = {"trace_hash": dataset.hashes().trace}
                boards[seed] = list(judged(dataset))
            rows[f"{world}, {way}"] = {**summed(boards), "models": models}
            told = {"assets": runner.assets_name(arguments.assets), "rows": dict(sorted(rows.items(), key=_place))}
            runner.finish(KIND, arguments, told, hashes={"models": models, "data": data}, seed=FIRST_SEED)


def _place(row: tuple[str, Any]) -> tuple[int, int]:
    world, way = row[0].split(", ")
    return list(SCENES).index(world), WAYS.index(way)


def sheet(words: list[str]) -> None:
    """First pictures of boards of both scenes."""
    options = runner.parser(sheet.__doc__, assets=False)
    options.add_argument("--work", type=Path, required=True, help="with the recordings")
    arguments = options.parse_args(words)
    lines = []
    for world in SCENES:
        tiles = []
        for seed in range(FIRST_SEED, FIRST_SEED + TILES):
            dataset = Dataset.open(arguments.work / f"{world}-{seed}-learned")
            rgb = read_episode(dataset.episode_path(1), "lazy").image(0).rgb
            tile = cv2.resize(rgb, (420, 315), interpolation=cv2.INTER_AREA)
            tiles.append(np.pad(tile, ((0, MARGIN), (0, MARGIN), (0, 0)), constant_values=255))
        lines.append(np.hstack(tiles))
    write_atomically(arguments.out, encode_rgb(np.vstack(lines)[:-MARGIN, :-MARGIN], "jpeg"))


if __name__ == "__main__":
    runner.one_of(main, sheet=sheet)
