"""`busybot eval reason`: infer the graphs of a dataset's boards and compare them with the truth (protocol "Reasoning").

The graph is inferred from the first 23 images, as in the paper. Inference sees what `observed` lets through; the truth
is read here, after it.
"""

import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from busybot import __version__
from busybot.boards.spec import BoardSpec
from busybot.episodes.dataset import Dataset
from busybot.episodes.episode import Episode
from busybot.episodes.mcap_file import read_episode
from busybot.errors import BusybotError
from busybot.reason import baselines
from busybot.reason import metrics as m
from busybot.reason.count import CountConfig
from busybot.reason.infer import check_model, infer
from busybot.reason.observed import observe
from busybot.reason.result import InferredGraph
from busybot.reason.truth import GraphTruth, truth_of
from busybot.rng import generator
from busybot.workers import default_workers, share

IMAGES = 23
"""The paper infers the graph from so many images, one more than actions."""

BOARDS_PER_WORKER = 10
"""A process more costs about as much time as so many boards."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Judged:
    """One board's graph and truth.

    Attributes:
        steps: observed actions.
        policy: that chose them.
        oracle: whether that policy knew what only the simulator knows.
    """

    board: BoardSpec
    graph: InferredGraph
    truth: GraphTruth
    steps: int
    policy: str
    oracle: bool

    def counts(self, steps: int) -> m.EdgeCounts:
        """Edges claimed after so many steps against the truth."""
        claimed = self.graph.claimed(steps)
        return m.count_edges(claimed, self.truth.edges, self.truth.candidates)


def judge_episode(
    episode: Episode, model: str = "count", images: int = IMAGES, config: CountConfig | None = None
) -> Judged:
    """Infer the board's graph from the first `images` images and put the truth beside it."""
    observed = observe(episode).first(images)
    graph = infer(observed, model, config)
    return Judged(episode.board, graph, truth_of(episode), len(observed.actions), episode.policy, episode.oracle)


def _judge_file(path: Path, model: str, images: int, config: CountConfig | None) -> Judged:
    return judge_episode(read_episode(path, "lazy"), model, images, config)


def evaluate_dataset(
    dataset: Dataset,
    model: str = "count",
    images: int = IMAGES,
    config: CountConfig | None = None,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Evaluate on every finished episode; JSON values, see `summarise`, with the dataset's origin and hashes.

    Args:
        workers: processes; None for one per core, as far as there are boards enough to pay for starting them.

    Raises:
        BusybotError: no episode is finished, one is damaged, or there is no such model.
    """
    check_model(model)
    if images < 2:
        raise BusybotError(f"{images} images show no action", "take at least 2")
    indices = sorted(dataset.finished())
    if not indices:
        what = f"{dataset.path}: none of its {dataset.info.boards} boards has an episode"
        raise BusybotError(what, f"busybot collect {dataset.path}")
    judged: list[Judged] = []
    processes = workers or min(default_workers(), 1 + len(indices) // BOARDS_PER_WORKER)
    task = partial(_judge_file, model=model, images=images, config=config)
    for one in share(task, [dataset.episode_path(index) for index in indices], processes):
        judged.append(one)
        if progress is not None:
            progress(len(judged), len(indices))
    hashes = dataset.hashes()
    return {
        **summarise(judged, images, seed),
        "config": (config or CountConfig()).model_dump(mode="json"),
        "dataset": {
            "name": dataset.info.name,
            "split": dataset.info.split,
            "boards": dataset.info.boards,
            "episodes": len(indices),
            "board_hash": hashes.board,
            "trace_hash": hashes.trace,
            "content_hash": hashes.content,
        },
    }


def summarise(judged: Sequence[Judged], images: int, seed: int) -> dict[str, Any]:
    """All metrics of protocol "Reasoning" over judged boards, JSON values; shares from 0 to 1.

    Pred-A is null: what infers a graph alone predicts no states.
    """
    steps = images - 1
    counts = [one.counts(steps) for one in judged]
    scores = m.micro(counts)
    rng = generator(seed, judged[0].board.split if judged else "", 0, "reason/bootstrap")
    calibrated = _calibration(judged, [one.graph.after(steps) for one in judged])
    return {
        "model": judged[0].graph.name if judged else None,
        "images": images,
        "boards": len(judged),
        "steps": sum(one.steps for one in judged),
        "policy": ", ".join(sorted({one.policy for one in judged})),
        "oracle": any(one.oracle for one in judged),
        "edge_p": scores.precision,
        "edge_r": scores.recall,
        "edge_acc": scores.accuracy,
        "edge_r_bound": _bound(judged, steps),
        "pred_a": None,
        "pred_a_responder": None,
        "pred_a_bound": None,
        "ece": calibrated.ece,
        "brier": calibrated.brier,
        "threshold": judged[0].graph.threshold if judged else None,
        "macro": asdict(m.macro(counts)),
        "intervals": {"level": m.LEVEL, **asdict(m.intervals(counts, rng))},
        "calibration": asdict(calibrated),
        "counts": _totals(counts),
        "by_kind": _by_kind(judged, steps),
        "by_images": _curve(judged, images),
        "baselines": _baselines(judged, seed),
        "seed": seed,
        "versions": {"busybot": __version__, "python": platform.python_version(), "numpy": version("numpy")},
    }


def _calibration(judged: Sequence[Judged], probabilities: Sequence[np.ndarray]) -> m.Calibration:
    said = [p[one.truth.candidates] for one, p in zip(judged, probabilities, strict=True)]
    true = [one.truth.edges[one.truth.candidates] for one in judged]
    return m.calibration(np.concatenate([np.zeros(0), *said]), np.concatenate([np.zeros(0), *true]))


def _bound(judged: Sequence[Judged], steps: int) -> float | None:
    return m.shown_share([one.truth.edges for one in judged], [one.truth.shown for one in judged], steps)


def _totals(counts: Sequence[m.EdgeCounts]) -> dict[str, int]:
    return {name: sum(getattr(one, name) for one in counts) for name in ("hits", "claimed", "true", "correct", "pairs")}


def _by_kind(judged: Sequence[Judged], steps: int) -> dict[str, dict[str, Any]]:
    """Scores by kind of relation. A wrong edge has no kind: it counts for every kind that its trigger really has."""
    kinds = sorted({kind for one in judged for names in one.truth.kinds.values() for kind in names})
    result = {}
    for kind in kinds:
        hits = claimed = true = 0
        for one in judged:
            edges = one.graph.claimed(steps)
            of_kind = np.zeros_like(one.truth.edges)
            for pair, names in one.truth.kinds.items():
                of_kind[pair] = kind in names
            of_trigger = np.asarray(of_kind.any(axis=1))[:, None]
            wrong = edges & one.truth.candidates & ~one.truth.edges & of_trigger
            hits += int((edges & of_kind).sum())
            claimed += int((edges & of_kind).sum() + wrong.sum())
            true += int(of_kind.sum())
        result[kind] = {
            "edge_p": hits / claimed if claimed else None,
            "edge_r": hits / true if true else None,
            "relations": true,
        }
    return result


def _curve(judged: Sequence[Judged], images: int) -> list[dict[str, Any]]:
    """Scores and bound after 2, 3, ... images."""
    longest = min(images, 1 + max((one.steps for one in judged), default=0))
    curve = []
    for seen in range(2, longest + 1):
        scores = m.micro([one.counts(seen - 1) for one in judged])
        bound = _bound(judged, seen - 1)
        curve.append({"images": seen, "edge_p": scores.precision, "edge_r": scores.recall, "edge_r_bound": bound})
    return curve


def _baselines(judged: Sequence[Judged], seed: int) -> dict[str, dict[str, Any]]:
    graphs = [baselines.trivial_graphs(one.board, one.truth.candidates, seed) for one in judged]
    rows = {}
    for name in baselines.NAMES:
        claimed = [graph[name] for graph in graphs]
        counts = [
            m.count_edges(edges > 0, one.truth.edges, one.truth.candidates)
            for one, edges in zip(judged, claimed, strict=True)
        ]
        scores, calibrated = m.micro(counts), _calibration(judged, claimed)
        rows[name] = {
            "edge_p": scores.precision,
            "edge_r": scores.recall,
            "edge_acc": scores.accuracy,
            "ece": calibrated.ece,
            "brier": calibrated.brier,
        }
    return rows
