"""Judged boards to one result: all metrics of protocol "Reasoning" as JSON values, shares from 0 to 1."""

import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from busybot import __version__
from busybot.boards.spec import BoardSpec
from busybot.evaluation.bootstrap import LEVEL
from busybot.reason import baselines, prediction_summary
from busybot.reason import metrics as m
from busybot.reason.forecast import Forecast
from busybot.reason.result import InferredGraph
from busybot.reason.truth import GraphTruth
from busybot.rng import generator


@dataclass(frozen=True)
class Judged:
    """One board's graph, predictions and truth.

    Attributes:
        steps: observed actions.
        policy: that chose them.
        oracle: whether that policy knew what only the simulator knows.
        forecast: the predicted steps; None where the recording does not know states or ends with the observed images.
    """

    board: BoardSpec
    graph: InferredGraph
    truth: GraphTruth
    steps: int
    policy: str
    oracle: bool
    forecast: Forecast | None = None

    def counts(self, steps: int) -> m.EdgeCounts:
        """Edges claimed after so many steps against the truth."""
        claimed = self.graph.claimed(steps)
        return m.count_edges(claimed, self.truth.edges, self.truth.candidates)


def summarise(judged: Sequence[Judged], images: int, seed: int) -> dict[str, Any]:
    """All metrics over judged boards. Pred-A is null for what infers a graph alone."""
    steps = images - 1
    forecasts = [(one.board, one.forecast) for one in judged if one.forecast is not None]
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
        **prediction_summary.summarise_predictions(forecasts),
        "ece": calibrated.ece,
        "brier": calibrated.brier,
        "threshold": judged[0].graph.threshold if judged else None,
        "macro": asdict(m.macro(counts)),
        "intervals": {
            "level": LEVEL,
            **asdict(m.intervals(counts, rng)),
            **prediction_summary.intervals(forecasts, seed),
        },
        "calibration": asdict(calibrated),
        "counts": _totals(counts),
        "by_kind": _by_kind(judged, steps),
        "by_images": _curve(judged, forecasts, images),
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


def _curve(judged: Sequence[Judged], forecasts: prediction_summary.Forecasts, images: int) -> list[dict[str, Any]]:
    """Scores and bounds after 2, 3, ... images. Pred-A is that of the steps after `images` images throughout."""
    longest = min(images, 1 + max((one.steps for one in judged), default=0))
    curve = []
    for seen in range(2, longest + 1):
        scores = m.micro([one.counts(seen - 1) for one in judged])
        bound = _bound(judged, seen - 1)
        edges = {"images": seen, "edge_p": scores.precision, "edge_r": scores.recall, "edge_r_bound": bound}
        curve.append(edges | prediction_summary.after_images(forecasts, seen))
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
