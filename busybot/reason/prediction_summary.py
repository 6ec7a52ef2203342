"""Judged predictions of many boards to the part of a result that is about Pred-A; JSON values, shares from 0 to 1."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from busybot.boards.spec import BoardSpec
from busybot.reason import metrics as m
from busybot.reason.forecast import BOUND, BOUND_KNOWING, DECODED, NEAREST, PERSISTENCE, Forecast
from busybot.rng import generator

Forecasts = Sequence[tuple[BoardSpec, Forecast]]
Part = Callable[[BoardSpec, Forecast], np.ndarray]
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

        def steps(_: BoardSpec, one: Forecast, kind: str = kind) -> np.ndarray:
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

        def objects(board: BoardSpec, _: Forecast, category: str = category) -> np.ndarray:
            return np.array([placed.category == category for placed in board.objects])

        scores = _flat(m.prediction_scores(counted(forecasts, NEAREST, objects=objects)))
        result[category] = {name: scores[NAMES[name]] for name in ("responders", "changed", "unchanged")}
    return result
