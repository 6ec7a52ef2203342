"""How often a reasoner is right on boards whose truth is known, for assertions."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from busybot.reason.models.base import Reasoner
from tests.reason.boards import Board


@dataclass(frozen=True)
class Score:
    """Shares: of edges; of predicted steps in which all responders look as they should, and of those that succeeded."""

    precision: float
    recall: float
    right: float
    right_changes: float


def score(reasoner: Reasoner, boards: Iterable[Board], images: int = 23) -> Score:
    """The graph from the first images, the following steps one by one."""
    hits = claimed = true = 0
    right: list[bool] = []
    changes: list[bool] = []
    for board in boards:
        everything, seen = board.seen, board.seen.first(images)
        known = seen.steps
        edges = reasoner.graph(seen).claimed(known)
        hits, claimed, true = hits + (edges & board.edges).sum(), claimed + edges.sum(), true + board.edges.sum()
        predicted = reasoner.predict(
            seen, everything.features[known:-1], everything.actions[known:], everything.acted[known:]
        )
        error = np.linalg.norm(predicted - everything.features[known + 1 :], axis=-1)
        right += (error < 1).all(axis=1).tolist()
        changes += board.succeeded[known:].tolist()
    good, moved = np.array(right), np.array(changes)
    return Score(hits / max(claimed, 1), hits / true, float(good.mean()), float(good[moved].mean()))
