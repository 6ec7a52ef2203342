"""Measures how well features tell states apart.

    python -m benchmarks.studies.features --train DATASET --novel DATASET... --out FILE [--encoders a,b]
        [--weights FILE] [--assets DIR]

Datasets have one split each; the last third of the boards of the training split fits nothing. For every split and
encoder the study tells

- auc: how surely the distance between two consecutive frames is larger for a responder that changed than for one that
  did not; beside it quantiles of both, in units of the median change on training boards;
- clusters: for how many responders the label-free clusters are the true states, all of them and those that changed;
- decoders: the share of responders in all frames that linear decoders of training boards read rightly, lamps by colour.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import rankdata

from benchmarks.runner import finish, one_of, parser
from busybot.common.errors import UsageError
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.dataset import Dataset
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.objects.library import Library
from busybot.reason.evaluation.decoders import DecodedState, Linear, appearances, examples, fit_decoders
from busybot.reason.evaluation.ground_truth import states_of
from busybot.reason.inputs.feature_store import Features, features_of
from busybot.reason.inputs.sequence import THRESHOLDS, clusters_of, fit_threshold

ENCODERS = "embedded,embedded-box,embedded-mask,random"
LEAST = 2
"""Recorded boards of the training split."""


@dataclass(frozen=True)
class Board:
    """One board with its truth.

    Attributes:
        features: float32 (T + 1, N, 256).
        states: int (T + 1, N).
        shown: str (T + 1, N), what decoders are to read.
        judged: bool (N,), responders that a box shows.
    """

    episode: Episode
    features: np.ndarray
    states: np.ndarray
    shown: np.ndarray
    judged: np.ndarray


def boards(dataset: Dataset, library: Library, features: Features) -> Iterator[Board]:
    """All boards whose states are known."""
    for index, values in features.items():
        episode = read_episode(dataset.episode_path(index), "lazy")
        truth = states_of(episode)
        if truth is not None:
            looks = np.asarray(values, np.float32)
            shown = appearances(episode.board, library, truth.states)
            yield Board(episode, looks, truth.states, shown, np.any(looks, axis=(0, 2)))


def distances(board: Board) -> tuple[np.ndarray, np.ndarray]:
    """Distances of consecutive frames, of responders that changed and of those that did not."""
    apart = np.linalg.norm(np.diff(board.features, axis=0), axis=-1)[:, board.judged]
    changed = (board.states[1:] != board.states[:-1])[:, board.judged]
    return apart[changed], apart[~changed]


def auc(different: np.ndarray, alike: np.ndarray) -> float:
    """Probability that one of `different` is larger than one of `alike`; ties count half."""
    ranks = rankdata(np.concatenate([different, alike]))[: len(different)].sum()
    return float((ranks - len(different) * (len(different) + 1) / 2) / (len(different) * len(alike)))


def clustered(board: Board, threshold: float) -> list[tuple[bool, bool]]:
    """For every responder: whether its clusters are its states, and whether it changed at all."""
    found = clusters_of(board.features, threshold)
    result = []
    for index in np.flatnonzero(board.judged):
        mine, true = found[:, index].tolist(), board.states[:, index].tolist()
        equal = len(set(zip(mine, true, strict=True))) == len(set(mine)) == len(set(true))
        result.append((equal, len(set(true)) > 1))
    return result


def decoded(decoders: dict[str, Linear], parts: list[Board]) -> dict[str, Any]:
    """Share of frames and responders that are read rightly, by category and of all boards at once."""
    right: dict[str, list[bool]] = {}
    whole: list[bool] = []
    for board in parts:
        judge = DecodedState(decoders, board.episode.board, board.shown, board.judged)
        correct = judge.read(board.features) == board.shown
        whole += correct[:, board.judged].all(axis=1).tolist()
        for index in np.flatnonzero(board.judged):
            right.setdefault(board.episode.board.objects[index].category, []).extend(correct[:, index].tolist())
    shares = {category: share(values) for category, values in sorted(right.items())}
    return {**shares, "all of a frame": share(whole)}


def share(values: list[bool]) -> float | None:
    return round(float(np.mean(values)), 4) if values else None


def apart(parts: list[Board]) -> tuple[np.ndarray, np.ndarray]:
    """Distances of all boards, of responders that changed and of those that did not."""
    changed, unchanged = zip(*map(distances, parts), strict=True)
    return np.concatenate(changed), np.concatenate(unchanged)


def describe(parts: list[Board], threshold: float, unit: float) -> dict[str, Any]:
    """One split's row without decoders."""
    different, alike = apart(parts)
    pairs = [pair for board in parts for pair in clustered(board, threshold)]
    return {
        "boards": len(parts),
        "responders": int(sum(board.judged.sum() for board in parts)),
        "changed": len(different),
        "unchanged": len(alike),
        "auc": round(auc(different, alike), 6),
        "changed_distance": {
            name: round(float(np.quantile(different, q)) / unit, 4) for name, q in (("least", 0), ("1 %", 0.01))
        },
        "unchanged_distance": {
            name: round(float(np.quantile(alike, q)) / unit, 4) for name, q in (("99.9 %", 0.999), ("most", 1))
        },
        "unchanged_that_differ": share((alike > 0).tolist()),
        "clusters_are_states": share([equal for equal, _ in pairs]),
        "clusters_are_states_of_changed": share([equal for equal, changed in pairs if changed]),
    }


def study_encoder(name: str, splits: list[Dataset], arguments: argparse.Namespace) -> dict[str, Any]:
    """All splits' rows of one encoder; the first split is the training one."""
    began = time.process_time()
    weights = arguments.weights if name.partition("-")[0] == "resnet50" else None
    taken = [features_of(one, name, weights=weights, store=arguments.store, workers=1) for one in splits]
    seconds = time.process_time() - began
    frames = sum(len(values) for features in taken for values in features.values())
    known = [
        list(boards(dataset, library_of(dataset, arguments.assets), features))
        for dataset, features in zip(splits, taken, strict=True)
    ]
    fitting, train = known[0][: 2 * len(known[0]) // 3], known[0][2 * len(known[0]) // 3 :]
    different, alike = apart(fitting)
    threshold = fit_threshold(alike, different)
    decoders = fit_decoders(examples(b.episode.board, b.features, b.shown, b.judged) for b in fitting)
    rows = {}
    for dataset, parts in zip(splits, [train, *known[1:]], strict=True):
        row = describe(parts, THRESHOLDS.get(name, threshold), float(np.median(different)))
        rows[dataset.info.split] = row | {"decoders": decoded(decoders, parts)}
    return {
        "oracle": taken[0].oracle,
        "median_change": round(float(np.median(different)), 4),
        "threshold_fitted": round(threshold, 4),
        "threshold_used": THRESHOLDS.get(name, round(threshold, 4)),
        "cpu_ms_per_new_frame": round(1e3 * seconds / frames, 2) if all(f.new == len(f) for f in taken) else None,
        "splits": rows,
    }


def study(arguments: argparse.Namespace) -> dict[str, Any]:
    splits = [Dataset.open(path) for path in (arguments.train, *arguments.novel)]
    if len(splits[0].finished()) < LEAST:
        raise UsageError(
            f"{arguments.train}: fewer than {LEAST} recordings", "record more: a third of them fits nothing"
        )
    result: dict[str, Any] = {"datasets": {}, "encoders": {}}
    for dataset in splits:
        result["datasets"][dataset.info.split] = {
            "episodes": len(dataset.finished()),
            "generator": dataset.info.generator.config,
            **{name: getattr(dataset.info.collect, name, None) for name in ("policy", "steps", "images")},
            "content_hash": dataset.hashes().content,
        }
    for name in arguments.encoders.split(","):
        result["encoders"][name] = study_encoder(name, splits, arguments)
        print(name, result["encoders"][name], file=sys.stderr, flush=True)
    return result


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__, assets=False)
    options.add_argument("--train", type=Path, required=True, help="recorded dataset of the training split")
    options.add_argument("--novel", type=Path, nargs="*", default=[], help="recorded datasets of other splits")
    options.add_argument("--encoders", default=ENCODERS)
    options.add_argument("--weights", type=Path)
    options.add_argument("--assets", help="objects, if they are not found by their hashes")
    options.add_argument("--store", type=Path, help="keep the features here instead of beside the datasets")
    arguments = options.parse_args(words)
    figures = study(arguments)
    data = {split: {"content_hash": told["content_hash"]} for split, told in figures["datasets"].items()}
    finish("features", arguments, figures, hashes={"data": data})


if __name__ == "__main__":
    one_of(main)
