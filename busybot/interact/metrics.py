"""Metrics of an interaction policy (paper section 5.1): precision, recall, and causes of failures.

A success is a true change of a trigger's state caused by the action. Every proposed action counts, also when nothing
was held. All values are shares from 0 to 1; what is not defined is None. Micro pools the actions or links of all
boards, macro averages over boards. Intervals are over boards, and over objects and their boards. Networks are judged
by how well their scores order what works before what does not.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from busybot.boards.directions import OPPOSITE
from busybot.common.frozen_model import FrozenModel
from busybot.evaluation.statistics import Interval, interval_over_boards, interval_over_objects
from busybot.interact.policy.direction_pairs import PAIRS

DRAWS = 1000
"""Of the bootstrap."""


def average_precision(scores: np.ndarray, works: np.ndarray) -> float | None:
    """Mean precision at the ranks of what works, in the order of falling scores; None if nothing works."""
    if not works.any():
        return None
    ordered = works[np.argsort(-scores, kind="stable")].astype(float)
    precision = np.cumsum(ordered) / np.arange(1, len(ordered) + 1)
    return float((precision * ordered).sum() / ordered.sum())


def area_under_curve(scores: np.ndarray, works: np.ndarray) -> float | None:
    """Probability that something that works has a higher score than something that does not; ties count half."""
    positives, negatives = int(works.sum()), int((~works).sum())
    if not positives or not negatives:
        return None
    _, inverse, counts = np.unique(scores, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - (counts - 1) / 2)[inverse]
    return float((ranks[works].sum() - positives * (positives + 1) / 2) / (positives * negatives))


def precision_at_count(scores: np.ndarray, works: np.ndarray) -> float | None:
    """Precision of the n highest scores where n things work: equals the recall there."""
    count = int(works.sum())
    if not count:
        return None
    return float(works[np.argsort(-scores, kind="stable")[:count]].mean())


def position_figures(scores: np.ndarray, works: np.ndarray) -> dict[str, float | None]:
    """Figures of a position score, float (N,), against whether acting there works, bool (N,)."""
    return {
        "position_ap": average_precision(scores, works),
        "position_auc": area_under_curve(scores, works),
        "position_precision": precision_at_count(scores, works),
    }


def direction_figures(logits: np.ndarray, labels: np.ndarray, known: np.ndarray) -> dict[str, float | None]:
    """Figures of direction logits, float (N, 18), where it is known (bool) which directions work (bool).

    A pair (a direction and its opposite) works when one of the two does: `pair_auc` judges 1 - (1 - p)(1 - p').
    """
    failing, others = 1 / (1 + np.exp(np.clip(logits, -30, 30))), OPPOSITE[PAIRS]  # 1 - p
    pairs = 1 - failing[:, PAIRS] * failing[:, others]
    pair_known = known[:, PAIRS] | known[:, others]
    pair_works = labels[:, PAIRS] | labels[:, others]
    return {
        "direction_auc": area_under_curve(logits[known], labels[known]),
        "pair_auc": area_under_curve(pairs[pair_known], pair_works[pair_known]),
    }


Target = Literal["link", "trigger", "responder", "board"]
CAUSES: dict[Target, str] = {
    "trigger": "position: trigger body",
    "responder": "position: responder",
    "board": "position: board",
}
"""Why an action failed that held nothing movable."""


class JudgedLink(FrozenModel):
    """A movable link of the board.

    Attributes:
        object: index on the board.
        key: the object in the library.
        pixels: visible at the beginning.
    """

    object: int
    key: str
    link: str
    pixels: int


class JudgedAction(FrozenModel):
    """A proposed action and what came of it.

    Attributes:
        pixel: (u, v).
        direction: the one proposed.
        executed: the directions that were tried, in order.
        on: what the pixel showed: a movable link, a trigger's body, a responder, or none of them.
        key: the object at the pixel, "" for the board.
        link: index of the held link among the board's links, -1 for none.
        success: the link's state changed.
        reward: what the pixels said: more of them differ than the threshold asks for.
        changed_pixels: how many differed.
        off_axis: the direction that worked is more than 30 degrees off every annotated one; None without success.
        vetoed: strict mode refused all directions.
    """

    pixel: tuple[int, int]
    direction: int
    executed: tuple[int, ...]
    on: Target
    key: str
    link: int
    success: bool
    reward: bool
    changed_pixels: int
    off_axis: bool | None
    vetoed: bool


class JudgedBoard(FrozenModel):
    """All that the metrics need of one board."""

    board: int
    links: tuple[JudgedLink, ...]
    actions: tuple[JudgedAction, ...]

    def moved(self) -> set[int]:
        """Links that at least one action moved."""
        return {action.link for action in self.actions if action.success}

    def exploring(self) -> list[JudgedAction]:
        """Actions that did not take hold of a link which had moved before."""
        moved: set[int] = set()
        new = []
        for action in self.actions:
            if action.link < 0 or action.link not in moved:
                new.append(action)
            if action.success:
                moved.add(action.link)
        return new

    def objects(self) -> tuple[int, int]:
        """Trigger objects of which a link was moved, and trigger objects."""
        moved = {self.links[link].object for link in self.moved()}
        return len(moved), len({link.object for link in self.links})


Parts = Callable[[JudgedBoard], tuple[int, int]]
"""Numerator and denominator of a share on one board."""

SHARES: dict[str, Parts] = {
    "precision": lambda board: (sum(a.success for a in board.actions), len(board.actions)),
    "recall": lambda board: (len(board.moved()), len(board.links)),
    "recall_objects": lambda board: board.objects(),
    "precision_exploring": lambda board: (sum(a.success for a in board.exploring()), len(board.exploring())),
    "off_axis_share": lambda board: (
        sum(a.off_axis or 0 for a in board.actions),
        sum(a.success for a in board.actions),
    ),
    "precision_reward": lambda board: (sum(a.reward for a in board.actions), len(board.actions)),
    "reward_agreement": lambda board: (sum(a.reward == a.success for a in board.actions), len(board.actions)),
}
"""What each share pools: successes of proposed actions; moved of all movable links; objects with a moved link of all
trigger objects; successes of actions that do not repeat a link; successes off the annotated axes; rewarded actions;
actions on which the pixels and the joints agree."""


OVER_BOARDS = ("precision", "recall", "recall_objects", "precision_exploring")
"""Shares that results tell of every single board."""


def micro(boards: Sequence[JudgedBoard]) -> dict[str, float | None]:
    """All shares over all boards pooled."""
    return {name: _share(part, whole) for name, (part, whole) in counts(boards).items()}


def counts(boards: Sequence[JudgedBoard]) -> dict[str, tuple[int, int]]:
    """Numerators and denominators of the pooled shares."""
    return {name: (int(table[:, 0].sum()), int(table[:, 1].sum())) for name, table in _tables(boards).items()}


def by_board(boards: Sequence[JudgedBoard]) -> dict[str, dict[str, list[int]]]:
    """Numerators and denominators of the shares that the paper has, on each board (`statistics.compare_boards`)."""
    tables = _tables(boards)
    return {name: dict(zip(("part", "whole"), tables[name].T.tolist(), strict=True)) for name in OVER_BOARDS}


def macro(boards: Sequence[JudgedBoard]) -> dict[str, float | None]:
    """Mean over the boards on which a share is defined."""
    means = {}
    for name, table in _tables(boards).items():
        defined = table[table[:, 1] > 0]
        means[name] = float((defined[:, 0] / defined[:, 1]).mean()) if len(defined) else None
    return means


def intervals(boards: Sequence[JudgedBoard], rng: np.random.Generator) -> dict[str, Interval]:
    """Of the pooled shares, boards drawn with replacement (`interval_over_boards`); None where a draw has none."""
    if not boards:
        return dict.fromkeys(SHARES)
    chosen = rng.integers(len(boards), size=(DRAWS, len(boards)))
    return {name: interval_over_boards(table[:, 0], table[:, 1], chosen) for name, table in _tables(boards).items()}


def object_intervals(boards: Sequence[JudgedBoard], rng: np.random.Generator) -> dict[str, Interval]:
    """Of `OVER_OBJECTS`, objects drawn with replacement and of each its boards (`two_level_interval`).

    An action that held the board itself is a group of its own. Where everything or nothing succeeded each object is one
    trial of the exact bounds.
    """
    actions = [_outcomes(board, board.actions) for board in boards]
    exploring = [_outcomes(board, board.exploring()) for board in boards]
    links = [
        [(link.key, board.board, number in board.moved()) for number, link in enumerate(board.links)]
        for board in boards
    ]
    records = dict(zip(OVER_OBJECTS, (actions, links, exploring), strict=True))
    return {name: _over_objects([one for own in each for one in own], rng) for name, each in records.items()}


OVER_OBJECTS = ("precision", "recall", "precision_exploring")
"""Shares that objects have, so that they can be drawn anew."""
_Record = tuple[str, int, bool]
"""Object, board, success."""


def _outcomes(board: JudgedBoard, actions: Sequence[JudgedAction]) -> list[_Record]:
    return [(one.key if one.on != "board" else f"board {board.board}", board.board, one.success) for one in actions]


def _over_objects(records: Sequence[_Record], rng: np.random.Generator) -> Interval:
    if not records:
        return None
    keys, numbers, part = zip(*records, strict=True)
    return interval_over_objects(np.array(part, float), np.ones(len(part)), keys, numbers, rng)


def failures_by_cause(boards: Sequence[JudgedBoard]) -> dict[str, int]:
    """Failed actions by what they held: nothing movable (where), or a link in a direction that does not move it."""
    counts = dict.fromkeys(("direction", "direction vetoed", *CAUSES.values()), 0)
    for action in (action for board in boards for action in board.actions if not action.success):
        counts["direction vetoed" if action.vetoed else CAUSES.get(action.on, "direction")] += 1
    return counts


def failures_by_object(boards: Sequence[JudgedBoard]) -> dict[str, dict[str, int]]:
    """For each object on which an action failed: failures because of the position and of the direction, and actions."""
    counts: dict[str, dict[str, int]] = {}
    for board in boards:
        for action in board.actions:
            row = counts.setdefault(action.key or "board", {"position": 0, "direction": 0, "actions": 0})
            row["actions"] += 1
            if not action.success:
                row["direction" if action.on == "link" else "position"] += 1
    failed = {key: row for key, row in counts.items() if row["position"] + row["direction"]}
    return dict(sorted(failed.items(), key=lambda item: (-item[1]["position"] - item[1]["direction"], item[0])))


def missed_links(boards: Sequence[JudgedBoard]) -> dict[str, dict[str, int]]:
    """For each `object/link` that was missed on a board: how often it was, on how many, its fewest visible pixels."""
    present: Counter[str] = Counter()
    missed: dict[str, list[int]] = defaultdict(list)
    for board in boards:
        moved = board.moved()
        for number, link in enumerate(board.links):
            name = f"{link.key}/{link.link}"
            present[name] += 1
            if number not in moved:
                missed[name].append(link.pixels)
    rows = {
        name: {"missed": len(pixels), "fewest_pixels": min(pixels), "boards": present[name]}
        for name, pixels in missed.items()
    }
    return dict(sorted(rows.items(), key=lambda item: (-item[1]["missed"], item[0])))


def by_step(boards: Sequence[JudgedBoard]) -> list[dict[str, float | None]]:
    """Precision of the k-th actions, and recall after them, k from 1."""
    rows: list[dict[str, float | None]] = []
    moved: list[set[int]] = [set() for _ in boards]
    links = sum(len(board.links) for board in boards)
    for number in range(max((len(board.actions) for board in boards), default=0)):
        last = [
            (board.actions[number], own)
            for board, own in zip(boards, moved, strict=True)
            if number < len(board.actions)
        ]
        for action, own in last:
            if action.success:
                own.add(action.link)
        precision = _share(sum(action.success for action, _ in last), len(last))
        rows.append({"precision": precision, "recall": _share(sum(map(len, moved)), links)})
    return rows


def _tables(boards: Sequence[JudgedBoard]) -> dict[str, np.ndarray]:
    """Numerators and denominators of all shares on each board, int (boards, 2)."""
    return {name: np.array([parts(board) for board in boards], int).reshape(-1, 2) for name, parts in SHARES.items()}


def _share(part: int, whole: int) -> float | None:
    return float(part / whole) if whole else None
