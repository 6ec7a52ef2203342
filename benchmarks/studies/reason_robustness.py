"""Measures how well relations are found and steps predicted when observations are disturbed.

    python -m benchmarks.studies.reason_robustness --data DATASET --model event=FOLDER --out FILE
        [--png DATASET] [--boards 150] [--only boxes,jpeg] [--figure F.png]

Recorded episodes are disturbed (`disturbances.py`) in all that a reasoner sees: the first 23 pictures and
those from which the later steps are predicted. The truth is left alone. Predictions are read by who knows each
state's look in the undisturbed pictures: its mean over the frames that truly show it, within the boxes that were given.

Trained models (`--model`, several times) were trained on what they were trained on. The baselines are judged with
their defaults and with the best of several settings, chosen for every row *with the truth*: nobody tunes better.

`--png` names the same boards recorded with lossless pictures. `--only` renews a part of a result.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.runner import chosen, finish, hashes_beside, named, one_of, parser, told_rows
from benchmarks.studies.disturbances import DISTURBANCES, DisturbedBoard, noisy, recording_of
from busybot.common.atomic_io import sha256_of
from busybot.common.process_pool import share
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.evaluation.decoders import NearestState, judged_objects
from busybot.reason.evaluation.evaluate import IMAGES, origin
from busybot.reason.evaluation.ground_truth import truth_of
from busybot.reason.evaluation.prediction import BOUND, NEAREST, EvaluatedBoard, JudgedPrediction, judge_prediction
from busybot.reason.evaluation.summary import JudgedGraph, summarise
from busybot.reason.inputs.object_masks import ChangeConfig, changes
from busybot.reason.inputs.observation import acted_objects
from busybot.reason.inputs.sequence import sequence_of
from busybot.reason.models.base import InferredGraph, Reasoner
from busybot.reason.models.counting import CountConfig, count_changes
from busybot.reason.models.lookup import Lookup, LookupConfig
from busybot.reason.models.registry import ReasonerInfo, reasoner_of
from busybot.training.model_cards import WEIGHTS_FILE, find_folder, read_info

KIND, ENCODER = "reason-robustness", "embedded"
UNDISTURBED, PNG = "undisturbed", "png"
NOISE = {"": (1.0, 5000.0), "one change in 20 is none": (1.0, 20.0)}
"""Priors of false changes."""
TOLERANCES, THRESHOLDS = (10, 30), (0.5, 1.0)
"""What counts as a change: of a pixel, and of features."""

STRENGTHS = {name: one.strengths for name, one in DISTURBANCES.items()}
BASELINES = ("lookup", "count")
"""Judged with several settings: behind the name and a comma."""
SCORES = ("edge_p", "edge_r", "edge_r_bound", "pred_a", "pred_a_successful", "pred_a_bound", "ece", "failing")

Row = tuple[str, float]
"""Name of a disturbance, and strength."""


@dataclass(frozen=True)
class Asked:
    """What is done with every board; plain data for worker processes.

    Attributes:
        models: name to folder.
        only: disturbances.
        png: episodes with lossless pictures.
        seed: of the disturbances.
    """

    models: dict[str, str]
    only: tuple[str, ...]
    png: Dataset | None
    seed: int


Told = tuple[dict[str, JudgedGraph], np.ndarray]
"""Of one row and board: what was said by each model; and bool (S,) the steps that the bound gets right and before which
every responder is read rightly from the disturbed picture, so how much of what they predict from could be read."""


def told_row(told: list[Told], seed: int) -> dict[str, Any]:
    """JSON values: scores by model, for baselines those of the defaults and of the best setting."""
    scores = {name: _scores([judged[name] for judged, _ in told], seed) for name in told[0][0]}
    known = np.concatenate([known for _, known in told])
    row: dict[str, Any] = {"boards": len(told), "known": float(known.mean()), "models": {}}
    for name, score in scores.items():
        base = name.split(",")[0]
        if base not in BASELINES:
            row["models"][name] = score
        elif name == base:
            settings = [other for other in scores if other.split(",")[0] == base]
            best = max(settings, key=lambda other: _worth(scores[other]))
            row["models"] |= {base: score, f"{base} at best": {**scores[best], "setting": best}}
    return row


def _scores(judged: list[JudgedGraph], seed: int) -> dict[str, Any]:
    result = summarise(judged, IMAGES, seed)
    kept = {key: result[key] for key in (*SCORES, "predicted_steps")}
    return {**kept, "edge_f1": f1(kept), "intervals": {"pred_a": result["intervals"]["pred_a"]}}


def f1(scores: dict[str, Any]) -> float:
    """Harmonic mean of Edge-P and Edge-R, 0 where nothing is claimed."""
    precision, recall = scores["edge_p"] or 0.0, scores["edge_r"] or 0.0
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def _worth(scores: dict[str, Any]) -> float:
    return float(scores["edge_f1"] + (scores["pred_a"] or 0))


def rows_of(task: tuple[int, Path], asked: Asked) -> list[tuple[Row, Told]]:
    """All rows of the board of that number in that file."""
    index, path = task
    recording = recording_of(read_episode(path, "lazy"))
    encoder, unit = make_extractor(ENCODER), _unit(asked)
    looks = np.asarray(encoder.of(recording.observed), np.float32)
    told, board = [], recording.episode.board
    wanted = [(name, strength) for name in asked.only for strength in STRENGTHS.get(name, (0.0,))]
    for name, strength in wanted:
        rng = generator(asked.seed, board.split, board.index, f"robustness/{name}/{strength}")
        disturbance = DISTURBANCES.get(name)
        if name == PNG:
            if asked.png is None or not asked.png.episode_path(index).exists():
                continue
            lossless = recording_of(read_episode(asked.png.episode_path(index), "lazy"))
            other = replace(recording, observed=lossless.observed)
        elif disturbance is None or disturbance.apply is None:
            other = recording
        else:
            other = disturbance.apply(recording, strength, rng)
        features = looks if other is recording else np.asarray(encoder.of(other.observed), np.float32)
        if name == "features":
            features = noisy(features, strength * unit, rng)
        moved = not np.array_equal(other.observed.boxes, recording.observed.boxes)
        judged, known = _judge(other, features, features if moved else looks, recording, asked)
        if name != "features":  # counting reads pixels
            judged |= {setting: _judged(other, graph, None) for setting, graph in _counted(other)}
        told.append(((name, strength), (judged, known)))
    return told


def _unit(asked: Asked) -> float:
    """The smallest change, as the first trained model found it on its training boards."""
    reasoner: Any = reasoner_of(next(iter(asked.models.values())))
    if reasoner.encoder != ENCODER:
        raise SystemExit(f"a model reads features of {reasoner.encoder}, this measures those of {ENCODER}")
    return float(reasoner.network.scale)


def _judge(
    recording: DisturbedBoard, features: np.ndarray, looks: np.ndarray, undisturbed: DisturbedBoard, asked: Asked
) -> Told:
    """What all that predict say of a recording, and what could be known.

    Args:
        looks: by which predictions are read, (T + 1, N, C) of the undisturbed pictures.
    """
    observed = recording.observed
    sequence, judged = sequence_of(observed, features), judged_objects(observed)
    states = undisturbed.truth.states
    judge = NearestState(looks, states, states, judged)
    judge.truth = recording.truth.states
    watched = EvaluatedBoard(recording.truth, observed, judged, sequence, {NEAREST: judge})
    seen, reasoners = sequence.first(IMAGES), dict(_reasoners(asked))
    predicted = {name: judge_prediction(watched, reasoner, IMAGES) for name, reasoner in reasoners.items()}
    told = {name: _judged(recording, one.graph(seen), predicted[name]) for name, one in reasoners.items()}
    return told, _known(next(iter(predicted.values())))


def _reasoners(asked: Asked) -> Iterator[tuple[str, Reasoner]]:
    for name, folder in asked.models.items():
        yield name, reasoner_of(folder)
    for words, prior in NOISE.items():
        for changed in THRESHOLDS:
            config = LookupConfig(changed=changed, counting=CountConfig(noise=prior))
            yield _setting("lookup", changed, THRESHOLDS, words), Lookup(ENCODER, config)


def _counted(recording: DisturbedBoard) -> Iterator[tuple[str, InferredGraph]]:
    """Counting, which reads no features."""
    seen = recording.observed.first(IMAGES)
    acted = acted_objects(seen)
    for tolerance in TOLERANCES:
        changed = changes(seen, ChangeConfig(tolerance=tolerance))
        for words, prior in NOISE.items():
            found = count_changes(changed, acted, seen.triggers, seen.responders, CountConfig(noise=prior))
            yield _setting("count", tolerance, TOLERANCES, words), InferredGraph("count", found)


def _setting(name: str, value: float, values: tuple[float, ...], words: str) -> str:
    """The name alone for the defaults."""
    told = [f"from {value:g}"] if value != values[0] else []
    return ", ".join([name, *told, *([words] if words else [])])


def _judged(recording: DisturbedBoard, graph: InferredGraph, predicted: JudgedPrediction | None) -> JudgedGraph:
    """Only what is believed in the end is kept."""
    episode, steps = recording.episode, IMAGES - 1
    final = replace(graph, probabilities=graph.after(steps)[None])
    return JudgedGraph(episode.board, final, truth_of(episode), steps, episode.policy, episode.oracle, predicted)


def _known(predicted: JudgedPrediction) -> np.ndarray:
    steps = len(predicted.successful)
    legible = predicted.reads[NEAREST][-1 - steps : -1]
    return np.asarray((legible & predicted.right[BOUND])[:, predicted.judged].all(axis=1))


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__, assets=False)
    options.add_argument("--data", type=Path, required=True, help="recorded dataset")
    options.add_argument("--model", action="append", required=True, metavar="NAME=FOLDER", help="trained model")
    options.add_argument("--png", type=Path, help="the same boards, or some of them, recorded as PNG")
    options.add_argument("--boards", type=int, help="only so many, the first ones")
    options.add_argument("--only", help="disturbances, separated by commas")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--workers", type=int, default=1)
    options.add_argument("--figure", type=Path, help="draw the result, too, F.png")
    arguments = options.parse_args(words)
    figures = measure(arguments)
    models = {name: {"weights": one["weights"]} for name, one in figures["models"].items()}
    data = {one["name"]: one["content_hash"] for one in (figures["dataset"], figures["png"]) if one}
    finish(KIND, arguments, figures, hashes={"models": models, "data": data})
    if arguments.figure:
        from busybot.view.figures.curves import robustness_figure

        robustness_figure(arguments.figure, figures)


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """The whole result; rows that are not asked for are kept from an earlier one."""
    known = (*DISTURBANCES, PNG)
    only = (UNDISTURBED, *(chosen(arguments.only, known) if arguments.only else known))
    dataset = Dataset.open(arguments.data)
    indices = sorted(dataset.finished())[: arguments.boards]
    models = named(arguments.model, "--model")
    png = Dataset.open(arguments.png) if arguments.png else None
    about, of = origin(dataset), {name: _origin(folder) for name, folder in models.items()}
    if arguments.only:  # other rows stay
        hashes_beside(arguments.out, KIND, "models", {name: {"weights": one["weights"]} for name, one in of.items()})
        hashes_beside(arguments.out, KIND, "data", {about["name"]: about["content_hash"]})
    work = partial(rows_of, asked=Asked(models, only, png, arguments.seed))
    gathered: dict[Row, list[Told]] = {}
    tasks = [(index, dataset.episode_path(index)) for index in indices]
    for number, told in enumerate(share(work, tasks, arguments.workers), start=1):
        for row, of_board in told:
            gathered.setdefault(row, []).append(of_board)
        print(f"{number} of {len(indices)} boards", flush=True)
    rows: dict[str, Any] = told_rows(arguments.out, KIND)
    for name in only:
        rows.pop(name, None)
    for (name, strength), one in gathered.items():
        rows.setdefault(name, []).append({"strength": strength, **told_row(one, arguments.seed)})
    return {
        "dataset": about,
        "png": origin(png) if png else None,
        "boards": len(indices),
        "images": IMAGES,
        "models": of,
        "disturbances": {
            name: {"title": one.title, "what": one.what, "unit": one.unit} for name, one in DISTURBANCES.items()
        },
        "rows": rows,
    }


def _origin(folder: str) -> dict[str, Any]:
    """What a model is and was trained on, without where it lies."""
    found = find_folder(folder, "reason")
    return {"weights": sha256_of(found / WEIGHTS_FILE), **read_info(found, ReasonerInfo).training}


if __name__ == "__main__":
    one_of(main)
