"""Judged boards to one result: all metrics of relations and predictions as JSON values, shares from 0 to 1."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from busybot.boards.spec import PAPER, BoardSpec
from busybot.common.rng import generator
from busybot.evaluation.results import package_versions
from busybot.evaluation.statistics import LEVEL, Interval, interval_over_objects
from busybot.reason.evaluation import metrics as m
from busybot.reason.evaluation.causes import JudgedCauses
from busybot.reason.evaluation.causes_summary import summarise_causes
from busybot.reason.evaluation.ground_truth import GraphTruth
from busybot.reason.evaluation.prediction import BOUND, BOUND_KNOWING, DECODED, NEAREST, PERSISTENCE, JudgedPrediction
from busybot.reason.evaluation.proposed import JudgedProposals, summarise_proposals
from busybot.reason.models.base import InferredGraph

Forecasts = Sequence[tuple[BoardSpec, JudgedPrediction]]
Scores = dict[str, float | None]
CLAIMS: m.Shares = {"edge_p": m.EDGES["precision"], "edge_r": m.EDGES["recall"]}
EDGES: m.Shares = CLAIMS | {"edge_acc": m.EDGES["accuracy"]}
"""`metrics.EDGES` as results call them."""
BOUNDS = (BOUND, BOUND_KNOWING)
"""What the observed transitions determine if an action shows at once what it does: in the paper's world alone."""
SINGLE = {"responders": "pred_a_responder", "changed": "pred_a_changed", "unchanged": "pred_a_unchanged"}
"""How results by category call the scores of single responders."""


def summarise_predictions(forecasts: Forecasts) -> dict[str, Any]:
    """Pred-A by the primary judge, its bounds, what it is compared with and how far the judges can be trusted."""
    counts, bound = counted(forecasts, NEAREST), _scores(forecasts, BOUND)
    return {
        "predicted_boards": len(forecasts),
        "predicted_steps": sum(len(one.successful) for _, one in forecasts),
        "failing": _share([~one.successful for _, one in forecasts]),
        **m.micro(counts, m.PREDICTIONS),
        "pred_a_macro": m.macro(counts, m.PREDICTIONS)["pred_a"],
        "pred_a_bound": bound["pred_a"],
        "bounds": {"not_knowing": bound, "knowing": _scores_if_any(forecasts, BOUND_KNOWING)},
        "decoded": _scores_if_any(forecasts, DECODED),
        "persistence": _scores_if_any(forecasts, PERSISTENCE),
        "decoder_accuracy": {name: _accuracy(forecasts, name) for name in (NEAREST, DECODED)},
        "pred_by_kind": _by_kind(forecasts),
        "pred_by_category": _by_category(forecasts),
    }


def intervals(forecasts: Forecasts, seed: int) -> dict[str, Any]:
    """Bootstrap intervals over boards, by the names of the scores."""
    rng = generator(seed, forecasts[0][0].split if forecasts else "", 0, "reason/bootstrap-predictions")
    return m.intervals(counted(forecasts, NEAREST), m.PREDICTIONS, rng)


def after_images(forecasts: Forecasts, images: int) -> Scores:
    """Pred-A and its bound when so many images were observed; None where that was not judged."""
    names = {"pred_a": NEAREST, "pred_a_bound": BOUND}
    return {told: _scores(forecasts, name, images=images)["pred_a"] for told, name in names.items()}


def counted(
    forecasts: Forecasts, name: str, images: int | None = None, kind: str | None = None, category: str | None = None
) -> list[m.Counts]:
    """Counts per board that has predictions of this name; `BOUNDS` have a meaning in the paper's world alone.

    Args:
        name: of `JudgedPrediction.right`; with `images` of `by_images`.
        kind: count only steps of this kind.
        category: count only responders of this category.
    """
    counts = []
    for board, one in forecasts:
        right = (one.right if images is None else one.by_images.get(images, {})).get(name)
        if right is not None and (name not in BOUNDS or board.world == PAPER):
            steps = np.array([kind is None or kind in each for each in one.kinds], bool)
            wanted = np.array([category in (None, placed.category) for placed in board.objects], bool)
            judged = one.judged & wanted
            counts.append(m.count_predictions(right[steps], one.changed[steps], judged, one.successful[steps]))
    return counts


def _scores(forecasts: Forecasts, name: str, **chosen: Any) -> Scores:
    """Scores of what `counted` counts."""
    return m.micro(counted(forecasts, name, **chosen), m.PREDICTIONS)


def _scores_if_any(forecasts: Forecasts, name: str) -> Scores | None:
    """None if nobody predicted under this name."""
    return _scores(forecasts, name) if counted(forecasts, name) else None


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
    """Scores of the steps by the kind of the relation whose trigger was held, under each kind if there are several."""
    kinds = [kind for _, one in forecasts for each in one.kinds for kind in each]
    return {
        kind: {
            **_scores(forecasts, NEAREST, kind=kind),
            "pred_a_bound": _scores(forecasts, BOUND, kind=kind)["pred_a"],
            "steps": kinds.count(kind),
        }
        for kind in sorted(set(kinds))
    }


def _by_category(forecasts: Forecasts) -> dict[str, Scores]:
    """Scores of single responders by their category."""
    result = {}
    found = {board.objects[index].category for board, one in forecasts for index in np.flatnonzero(one.judged)}
    for category in sorted(found):
        scores = _scores(forecasts, NEAREST, category=category)
        result[category] = {told: scores[name] for told, name in SINGLE.items()}
    return result


@dataclass(frozen=True)
class JudgedGraph:
    """One board's graph, predictions and truth.

    Attributes:
        steps: observed actions.
        policy: that chose them.
        oracle: whether that policy knew what only the simulator knows.
        forecast: the predicted steps; None where the recording does not know states or ends with the observed images.
        causes: what is judged in every world (`causes`); None if nobody judged it.
        proposals: how good the objects are that the reasoner was given; None where they are the true ones.
        spurious: int, after each number of steps, edges that are claimed of objects that are not there; None where all
            objects were given, or nobody knows the relations.
    """

    board: BoardSpec
    graph: InferredGraph
    truth: GraphTruth
    steps: int
    policy: str
    oracle: bool
    forecast: JudgedPrediction | None = None
    causes: JudgedCauses | None = None
    proposals: JudgedProposals | None = None
    spurious: np.ndarray | None = None

    def true(self, steps: int) -> np.ndarray:
        """The true edges after so many steps, or after all that were observed."""
        return self.truth.edges(min(steps, self.steps))

    def kinds(self, steps: int) -> dict[tuple[int, int], tuple[str, ...]]:
        """Of their relations."""
        return self.truth.kinds(min(steps, self.steps))

    def counts(self, steps: int) -> m.Counts:
        """Edges claimed after so many steps against the truth; those of objects that are not there are wrong."""
        counted = m.count_edges(self.graph.claimed(steps), self.true(steps), self.truth.candidates)
        if self.spurious is None:
            return counted
        return {**counted, "claimed": counted["claimed"] + int(self.spurious[min(steps, len(self.spurious) - 1)])}


def summarise(judged: Sequence[JudgedGraph], images: int, seed: int) -> dict[str, Any]:
    """All metrics over judged boards. Pred-A is null for what infers a graph alone."""
    steps = images - 1
    forecasts = [(one.board, one.forecast) for one in judged if one.forecast is not None]
    counts = [one.counts(steps) for one in judged]
    rng = generator(seed, judged[0].board.split if judged else "", 0, "reason/bootstrap")
    calibrated = _calibration(judged, [one.graph.after(steps) for one in judged], steps)
    predicted = summarise_predictions(forecasts)
    causes = [(one.board, one.causes) for one in judged if one.causes is not None]
    caused = summarise_causes(causes, images, predicted["pred_a"], seed)
    return {
        "model": judged[0].graph.name if judged else None,
        "images": images,
        "boards": len(judged),
        "steps": sum(one.steps for one in judged),
        "policy": ", ".join(sorted({one.policy for one in judged})),
        "oracle": any(one.oracle for one in judged),
        **m.micro(counts, EDGES),
        "edge_r_bound": _bound(judged, steps),
        **predicted,
        "ece": calibrated["ece"],
        "brier": calibrated["brier"],
        "threshold": judged[0].graph.threshold if judged else None,
        "macro": m.macro(counts, m.EDGES),
        "intervals": {"level": LEVEL, **m.intervals(counts, m.EDGES, rng), **intervals(forecasts, seed)},
        "object_intervals": object_intervals(judged, steps, seed),
        "calibration": calibrated,
        "counts": m.totals(counts, m.EDGES),
        "by_kind": _summary_by_kind(judged, steps),
        "by_images": _curve(judged, forecasts, images),
        "by_board": {**_by_board(judged, steps), **caused.pop("by_board")},
        "baselines": _baselines(judged, steps, seed),
        **summarise_proposals([one.proposals for one in judged]),
        "world": ", ".join(sorted({one.board.world for one in judged})),
        **caused,
        "seed": seed,
        "versions": package_versions(("numpy",)),
    }


def object_intervals(judged: Sequence[JudgedGraph], steps: int, seed: int) -> dict[str, Interval]:
    """Of `EDGES` and Pred-A, triggers drawn with replacement and of each its boards (`interval_over_objects`).

    An edge belongs to its trigger, a predicted step to the one that is held in it. Edges that are claimed of objects
    that are not there, and steps that hold no trigger, belong to one more.
    """
    records: dict[str, list[_Record]] = {name: [] for name in (*m.EDGES, "pred_a")}
    for number, one in enumerate(judged):
        names, nothing = [placed.key for placed in one.board.objects], ""
        claimed, true, candidates = one.graph.claimed(steps), one.true(steps), one.truth.candidates
        for trigger in np.flatnonzero(candidates.any(axis=1)):
            own = np.zeros_like(candidates)
            own[trigger] = candidates[trigger]
            counts = m.count_edges(claimed, true, own)
            for name, (part, whole) in m.EDGES.items():
                records[name].append((counts[part], counts[whole], names[trigger], number))
        if absent := one.counts(steps)["claimed"] - int((claimed & candidates).sum()):
            records["precision"].append((0, absent, nothing, number))
        if one.forecast is not None and (right := one.forecast.right.get(NEAREST)) is not None:
            whole_steps = np.asarray(right[:, one.forecast.judged].all(axis=1))
            held = (nothing if index < 0 else names[index] for index in one.forecast.held)
            records["pred_a"] += [(int(done), 1, key, number) for key, done in zip(held, whole_steps, strict=True)]
    rng = generator(seed, judged[0].board.split if judged else "", 0, "reason/bootstrap/objects")
    return {name: _over_objects(rows, rng) for name, rows in records.items()}


_Record = tuple[int, int, str, int]
"""Part, whole, object, board."""


def _over_objects(records: Sequence[_Record], rng: np.random.Generator) -> Interval:
    part, whole = (np.array([one[column] for one in records], int) for column in (0, 1))
    return interval_over_objects(part, whole, [one[2] for one in records], [one[3] for one in records], rng)


def _calibration(judged: Sequence[JudgedGraph], probabilities: Sequence[np.ndarray], steps: int) -> Scores:
    said = [p[one.truth.candidates] for one, p in zip(judged, probabilities, strict=True)]
    true = [one.true(steps)[one.truth.candidates] for one in judged]
    return m.calibration(np.concatenate([np.zeros(0), *said]), np.concatenate([np.zeros(0), *true]))


def _bound(judged: Sequence[JudgedGraph], steps: int) -> float | None:
    """Over boards of the paper's world, as `BOUNDS`."""
    truths = [one.truth for one in judged if one.board.world == PAPER]
    return m.shown_share([truth.edges() for truth in truths], [truth.shown for truth in truths], steps)


def _summary_by_kind(judged: Sequence[JudgedGraph], steps: int) -> dict[str, dict[str, Any]]:
    """Scores by kind of relation. A wrong edge has no kind: it counts for every kind that its trigger really has."""
    kinds = sorted({kind for one in judged for names in one.kinds(steps).values() for kind in names})
    result = {}
    for kind in kinds:
        counts = []
        for one in judged:
            edges, true = one.graph.claimed(steps), one.true(steps)
            of_kind = np.zeros_like(true)
            for pair, names in one.kinds(steps).items():
                of_kind[pair] = kind in names
            of_trigger = np.asarray(of_kind.any(axis=1))[:, None]
            wrong = edges & one.truth.candidates & ~true & of_trigger
            hits = int((edges & of_kind).sum())
            counts.append({"hits": hits, "claimed": hits + int(wrong.sum()), "true": int(of_kind.sum())})
        result[kind] = {**m.micro(counts, CLAIMS), "relations": m.totals(counts, CLAIMS)["true"]}
    return result


def _curve(judged: Sequence[JudgedGraph], forecasts: Forecasts, images: int) -> list[dict[str, Any]]:
    """Scores and bounds after 2, 3, ... images. Pred-A is that of the steps after `images` images throughout."""
    longest = min(images, 1 + max((one.steps for one in judged), default=0))
    curve = []
    for seen in range(2, longest + 1):
        scores = m.micro([one.counts(seen - 1) for one in judged], CLAIMS)
        bound = _bound(judged, seen - 1)
        curve.append({"images": seen, **scores, "edge_r_bound": bound, **after_images(forecasts, seen)})
    return curve


def _by_board(judged: Sequence[JudgedGraph], steps: int) -> dict[str, dict[str, list[int]]]:
    """Numerators and denominators on each board (`statistics.compare_boards`); 0 where nothing was predicted."""
    rows = []
    for one in judged:
        forecast = [] if one.forecast is None else [(one.board, one.forecast)]
        rows.append({**one.counts(steps), **m.totals(counted(forecast, NEAREST), m.PREDICTIONS)})
    shares = CLAIMS | {"pred_a": m.PREDICTIONS["pred_a"]}
    return {
        name: {"part": [row[part] for row in rows], "whole": [row[whole] for row in rows]}
        for name, (part, whole) in shares.items()
    }


def _baselines(judged: Sequence[JudgedGraph], steps: int, seed: int) -> dict[str, Scores]:
    graphs = [trivial_graphs(one.board, one.truth.candidates, seed) for one in judged]
    rows = {}
    for name in TRIVIAL_GRAPHS:
        claimed = [graph[name] for graph in graphs]
        pairs = zip(judged, claimed, strict=True)
        counts = [m.count_edges(edges > 0, one.true(steps), one.truth.candidates) for one, edges in pairs]
        calibrated = _calibration(judged, claimed, steps)
        rows[name] = {**m.micro(counts, EDGES), "ece": calibrated["ece"], "brier": calibrated["brier"]}
    return rows


TRIVIAL_GRAPHS = ("empty graph", "all-ones graph", "random trigger")
"""Claims that need no look at the board and stand beside every result: they say what a number is worth."""


def trivial_graphs(board: BoardSpec, candidates: np.ndarray, seed: int) -> dict[str, np.ndarray]:
    """Edge probabilities (N, N) by name; candidates is bool (N, N).

    `random trigger` claims one trigger by chance for each responder. Its draws depend on (seed, split, board).
    """
    guess = np.zeros(candidates.shape)
    triggers, responders = np.flatnonzero(candidates.any(1)), np.flatnonzero(candidates.any(0))
    if len(triggers):
        rng = generator(seed, board.split, board.index, "reason/random-trigger")
        guess[rng.choice(triggers, size=len(responders)), responders] = 1.0
    return {
        "empty graph": np.zeros(candidates.shape),
        "all-ones graph": candidates.astype(float),
        "random trigger": guess,
    }
