"""What the models said of all boards under one disturbance, as scores (`benchmarks/reason_robustness.py`)."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from busybot.reason.evaluate import IMAGES
from busybot.reason.summary import Judged, summarise

BASELINES = ("lookup", "count")
"""Judged with several settings: behind the name and a comma."""
SCORES = ("edge_p", "edge_r", "edge_r_bound", "pred_a", "pred_a_successful", "pred_a_bound", "ece", "failing")


@dataclass
class Told:
    """Of one row: what the models said of each board, and how much of what they predict from could be read.

    Attributes:
        judged: by model.
        known: bool (S,) for each board: steps that the bound gets right and before which every responder is read
            rightly from the disturbed picture.
    """

    judged: dict[str, list[Judged]] = field(default_factory=dict)
    known: list[np.ndarray] = field(default_factory=list)

    def add(self, other: "Told") -> None:
        """Another board."""
        for model, judged in other.judged.items():
            self.judged.setdefault(model, []).extend(judged)
        self.known.extend(other.known)


def told_row(told: Told, seed: int) -> dict[str, Any]:
    """JSON values: scores by model, for baselines those of the defaults and of the best setting."""
    scores = {name: _scores(judged, seed) for name, judged in told.judged.items()}
    row: dict[str, Any] = {"boards": len(told.known), "known": float(np.concatenate(told.known).mean()), "models": {}}
    for name, score in scores.items():
        base = name.split(",")[0]
        if base not in BASELINES:
            row["models"][name] = score
        elif name == base:
            settings = [other for other in scores if other.split(",")[0] == base]
            best = max(settings, key=lambda other: _worth(scores[other]))
            row["models"] |= {base: score, f"{base} at best": {**scores[best], "setting": best}}
    return row


def _scores(judged: list[Judged], seed: int) -> dict[str, Any]:
    result = summarise(judged, IMAGES, seed)
    kept = {key: result[key] for key in (*SCORES, "predicted_steps")}
    return {**kept, "edge_f1": f1(kept), "intervals": {"pred_a": result["intervals"]["pred_a"]}}


def f1(scores: dict[str, Any]) -> float:
    """Harmonic mean of Edge-P and Edge-R, 0 where nothing is claimed."""
    precision, recall = scores["edge_p"] or 0.0, scores["edge_r"] or 0.0
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def _worth(scores: dict[str, Any]) -> float:
    return float(scores["edge_f1"] + (scores["pred_a"] or 0))
