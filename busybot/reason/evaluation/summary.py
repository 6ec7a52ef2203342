"""Judged boards to one result: all metrics of protocol "Reasoning" as JSON values, shares from 0 to 1.

Judged predictions of many boards to the part of a result that is about Pred-A; JSON values, shares from 0 to 1.
"""

import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from busybot import __version__
from busybot.boards.spec import BoardSpec
from busybot.common.rng import generator
from busybot.evaluation.bootstrap import LEVEL
from busybot.reason.evaluation import metrics as m
from busybot.reason.evaluation.ground_truth import GraphTruth
from busybot.reason.evaluation.prediction import BOUND, BOUND_KNOWING, DECODED, NEAREST, PERSISTENCE, JudgedPrediction
from busybot.reason.models import lookup as baselines
from busybot.reason.models.base import InferredGraph

Forecasts = Sequence[tuple[BoardSpec, JudgedPrediction]]
Part = Callable[[BoardSpec, JudgedPrediction], np.ndarray]
"""Which predicted steps (S,) or objects (N,) of a board belong to a part of the result, bool."""


def summarise_predictions(forecasts: Forecasts) -> dict[str, Any]:
    """Pred-A by the primary judge, its bounds, what it is compared with and how far the judges can be trusted."""
    counts = counted(forecasts, NEAREST)
    scores = m.prediction_scores(counts)
    steps = m.prediction_scores(counted(forecasts, BOUND))
    return {
        "predicted_boards": len(forecasts),
        "predicted_steps": sum(len(one.successful) for _, one in forecasts),
        "failing": _share([~one.successful for _, one in forecasts]),
        **_flat(scores),
        "pred_a_macro": m.macro_predictions(counts),
        "pred_a_bound": steps.steps,
        "bounds": {"not_knowing": _flat(steps), "knowing": _scores(forecasts, BOUND_KNOWING)},
        "decoded": _scores(forecasts, DECODED),
        "persistence": _scores(forecasts, PERSISTENCE),
        "decoder_accuracy": {name: _accuracy(forecasts, name) for name in (NEAREST, DECODED)},
        "pred_by_kind": _by_kind(forecasts),
        "pred_by_category": _by_category(forecasts),
    }


def intervals(forecasts: Forecasts, seed: int) -> dict[str, Any]:
    """Bootstrap intervals over boards, by the names of the scores."""
    rng = generator(seed, forecasts[0][0].split if forecasts else "", 0, "reason/bootstrap-predictions")
    found = m.prediction_intervals(counted(forecasts, NEAREST), rng)
    return {NAMES[name]: interval for name, interval in found.items()}


def after_images(forecasts: Forecasts, images: int) -> dict[str, float | None]:
    """Pred-A and its bound when so many images were observed; None where that was not judged."""
    return {
        "pred_a": m.prediction_scores(counted(forecasts, NEAREST, images)).steps,
        "pred_a_bound": m.prediction_scores(counted(forecasts, BOUND, images)).steps,
    }


NAMES = {
    "steps": "pred_a",
    "successful": "pred_a_successful",
    "responders": "pred_a_responder",
    "changed": "pred_a_changed",
    "unchanged": "pred_a_unchanged",
}
"""Fields of `metrics.PredictionScores` as results call them."""


def counted(
    forecasts: Forecasts,
    name: str,
    images: int | None = None,
    steps: Part | None = None,
    objects: Part | None = None,
) -> list[m.PredictionCounts]:
    """Counts per board that has predictions of this name: of all or some steps, of all or some responders.

    Args:
        name: of `Forecast.right`; with `images` of `Forecast.by_images`.
    """
    counts = []
    for board, one in forecasts:
        right = (one.right if images is None else one.by_images.get(images, {})).get(name)
        if right is not None:
            chosen = steps(board, one) if steps else np.ones(len(right), bool)
            judged = one.judged & objects(board, one) if objects else one.judged
            counts.append(m.count_predictions(right[chosen], one.changed[chosen], judged, one.successful[chosen]))
    return counts


def _flat(scores: m.PredictionScores) -> dict[str, float | None]:
    return {told: getattr(scores, name) for name, told in NAMES.items()}


def _scores(forecasts: Forecasts, name: str) -> dict[str, float | None] | None:
    """None if nobody predicted under this name."""
    counts = counted(forecasts, name)
    return _flat(m.prediction_scores(counts)) if counts else None


def _share(parts: Sequence[np.ndarray]) -> float | None:
    values = np.concatenate([np.zeros(0, bool), *(part.ravel() for part in parts)])
    return float(values.mean()) if len(values) else None


def _accuracy(forecasts: Forecasts, judge: str) -> dict[str, Any] | None:
    """How often the judge reads true features rightly, over responders and frames; by category beside it."""
    known = [(board, one) for board, one in forecasts if judge in one.reads]
    if not known:
        return None
    parts: dict[str, list[np.ndarray]] = {}
    for board, one in known:
        for index in np.flatnonzero(one.judged):
            parts.setdefault(board.objects[index].category, []).append(one.reads[judge][:, index])
    every = [part for own in parts.values() for part in own]
    return {"all": _share(every), **{category: _share(parts[category]) for category in sorted(parts)}}


def _by_kind(forecasts: Forecasts) -> dict[str, dict[str, Any]]:
    """Scores of the steps by the kind of the relation whose trigger was held."""
    result = {}
    for kind in sorted({kind for _, one in forecasts for kind in one.kinds}):

        def steps(_: BoardSpec, one: JudgedPrediction, kind: str = kind) -> np.ndarray:
            return np.array(one.kinds) == kind

        scores = m.prediction_scores(counted(forecasts, NEAREST, steps=steps))
        bound = m.prediction_scores(counted(forecasts, BOUND, steps=steps))
        number = sum(int(steps(board, one).sum()) for board, one in forecasts)
        result[kind] = {**_flat(scores), "pred_a_bound": bound.steps, "steps": number}
    return result


def _by_category(forecasts: Forecasts) -> dict[str, dict[str, Any]]:
    """Scores of single responders by their category."""
    result = {}
    found = {board.objects[index].category for board, one in forecasts for index in np.flatnonzero(one.judged)}
    for category in sorted(found):

        def objects(board: BoardSpec, _: JudgedPrediction, category: str = category) -> np.ndarray:
            return np.array([placed.category == category for placed in board.objects])

        scores = _flat(m.prediction_scores(counted(forecasts, NEAREST, objects=objects)))
        result[category] = {name: scores[NAMES[name]] for name in ("responders", "changed", "unchanged")}
    return result


@dataclass(frozen=True)
class JudgedGraph:
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
    forecast: JudgedPrediction | None = None

    def counts(self, steps: int) -> m.EdgeCounts:
        """Edges claimed after so many steps against the truth."""
        claimed = self.graph.claimed(steps)
        return m.count_edges(claimed, self.truth.edges, self.truth.candidates)


def summarise(judged: Sequence[JudgedGraph], images: int, seed: int) -> dict[str, Any]:
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
        **summarise_predictions(forecasts),
        "ece": calibrated.ece,
        "brier": calibrated.brier,
        "threshold": judged[0].graph.threshold if judged else None,
        "macro": asdict(m.macro(counts)),
        "intervals": {
            "level": LEVEL,
            **asdict(m.intervals(counts, rng)),
            **intervals(forecasts, seed),
        },
        "calibration": asdict(calibrated),
        "counts": _totals(counts),
        "by_kind": _summary_by_kind(judged, steps),
        "by_images": _curve(judged, forecasts, images),
        "baselines": _baselines(judged, seed),
        "seed": seed,
        "versions": {"busybot": __version__, "python": platform.python_version(), "numpy": version("numpy")},
    }


def _calibration(judged: Sequence[JudgedGraph], probabilities: Sequence[np.ndarray]) -> m.Calibration:
    said = [p[one.truth.candidates] for one, p in zip(judged, probabilities, strict=True)]
    true = [one.truth.edges[one.truth.candidates] for one in judged]
    return m.calibration(np.concatenate([np.zeros(0), *said]), np.concatenate([np.zeros(0), *true]))


def _bound(judged: Sequence[JudgedGraph], steps: int) -> float | None:
    return m.shown_share([one.truth.edges for one in judged], [one.truth.shown for one in judged], steps)


def _totals(counts: Sequence[m.EdgeCounts]) -> dict[str, int]:
    return {name: sum(getattr(one, name) for one in counts) for name in ("hits", "claimed", "true", "correct", "pairs")}


def _summary_by_kind(judged: Sequence[JudgedGraph], steps: int) -> dict[str, dict[str, Any]]:
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


def _curve(judged: Sequence[JudgedGraph], forecasts: Forecasts, images: int) -> list[dict[str, Any]]:
    """Scores and bounds after 2, 3, ... images. Pred-A is that of the steps after `images` images throughout."""
    longest = min(images, 1 + max((one.steps for one in judged), default=0))
    curve = []
    for seen in range(2, longest + 1):
        scores = m.micro([one.counts(seen - 1) for one in judged])
        bound = _bound(judged, seen - 1)
        edges = {"images": seen, "edge_p": scores.precision, "edge_r": scores.recall, "edge_r_bound": bound}
        curve.append(edges | after_images(forecasts, seen))
    return curve


def _baselines(judged: Sequence[JudgedGraph], seed: int) -> dict[str, dict[str, Any]]:
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
