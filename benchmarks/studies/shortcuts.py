"""Whether relations can be told without watching what follows an action: they must not, or learners would learn that.

    python -m benchmarks.studies.shortcuts --data FOLDER --assets DIR --out benchmarks/results/shortcuts.json
        [--boards 1000] [--only gates,time]

A classifier (gradient-boosted trees of scikit-learn, which causal-learn brings: extra `causal`) is told one thing about
each pair that may be parent and child, and says whether it is. It is trained on four fifths of the boards and judged on
the rest, each fifth in turn, by the area under its ROC curve: the probability that it puts a true pair before another
one. The things are

- `looks`: which objects they are, how large and how turned, and the states of both before the first action;
- `picture`: the responder's features in the first picture of a recording;
- `places`: where both stand, how far apart, and how many stand nearer;
- `order`: their numbers in the list of objects;
- `actions`: all that recorded actions say about the trigger: how many, when, where and in which directions.

What looks tell of the law itself is no shortcut: a trigger with three links controls more than one with a single link,
and a responder of two states never follows a link of three in the paper's world; where there are few links, each has a
part in more. So `alike` compares only pairs on the same board of which that says the same: the numbers of states of the
trigger's links, and of the responder; and `whom` only those of these that have the responder in common: which trigger
moves it, and not whether anything does. The first three of these need no simulator, so
there are more boards of them than of the others, whose recordings `benchmarks.tables.worlds record` makes.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import rankdata

from benchmarks import runner
from benchmarks.tables.worlds import NAMES, SCRIPTED, Recorded
from busybot.boards.config import BoardConfig
from busybot.boards.dynamics import Dynamics
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.boards.worlds import links_of
from busybot.common.rng import generator
from busybot.evaluation.statistics import percentile_interval, share_interval
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.reason.evaluation.causes import candidates_of, parents_at
from busybot.reason.inputs.sequence import BoardSequence

KIND = "shortcuts"
SEED = 823
DRAWN, RECORDED = ("looks", "places", "order"), ("picture", "actions")
FOLDS, DRAWS, FEW_DRAWS = 5, 1000, 100
CHANCE, WITHIN = 0.5, 0.03
LINKS = 4
"""So many links of a trigger are told."""
CHANNELS = 16
"""Of features: the classifier is told so many principal components."""


@dataclass(frozen=True)
class Pairs:
    """Pairs of objects that may be parent and child, of all boards. M pairs.

    Attributes:
        told: float (M, C), by view.
        true: bool (M,), whether the first is a parent of the second.
        kind: int (M,), equal for pairs that are alike before the law.
        child: int (M,), equal for pairs with the same second object.
        board: int (M,).
    """

    told: dict[str, np.ndarray]
    true: np.ndarray
    kind: np.ndarray
    child: np.ndarray
    board: np.ndarray


class Kinds:
    """Numbers for things that are equal or not, in the order in which they are met."""

    def __init__(self) -> None:
        self._known: dict[Any, int] = {}

    def __call__(self, thing: Any) -> int:
        return self._known.setdefault(thing, len(self._known))


def pairs_of(boards: Iterable[tuple[BoardSpec, dict[str, np.ndarray]]], library: Library) -> Pairs:
    """All pairs.

    Args:
        boards: with what is told of each pair beside what the board itself tells, float (N, N, C) by view.
    """
    keys, kinds = Kinds(), Kinds()
    told: dict[str, list[np.ndarray]] = {}
    true, kind, child, number = [], [], [], []
    for place, (board, more) in enumerate(boards):
        pairs = [(int(i), int(j)) for i, j in np.argwhere(candidates_of(board))]
        views = more or {"looks": looks(board, library, keys), "places": places(board), "order": order(board)}
        for name, values in views.items():
            told.setdefault(name, []).extend(values[i, j] for i, j in pairs)
        parents = parents_at(board, 0)
        models = [library.get(one.key) for one in board.objects]
        sizes = [tuple(sorted(link.states for link in model.trigger_links)) for model in models]
        stages = [
            model.effect and (model.effect.single is not None, model.effect.multi is not None) for model in models
        ]
        true += [bool(parents[pair]) for pair in pairs]
        kind += [kinds((sizes[i], stages[i], stages[j])) for i, j in pairs]
        child += [kinds((place, j)) for _, j in pairs]
        number += [place] * len(pairs)
    arrays = {name: np.array(values, float) for name, values in told.items()}
    return Pairs(arrays, np.array(true, bool), *(np.array(one, int) for one in (kind, child, number)))


def looks(board: BoardSpec, library: Library, keys: Kinds) -> np.ndarray:
    """float (N, N, C), of both objects."""
    models = [library.get(one.key) for one in board.objects]
    triggers = tuple(state for placed in board.objects for state in placed.states)
    shown = Dynamics(board, links_of(models)).start(triggers).shown
    own = []
    for placed, state in zip(board.objects, shown, strict=True):
        states = [*placed.states[:LINKS], *[-1] * (LINKS - len(placed.states))]
        own.append([keys(placed.key), keys(placed.category), placed.scale, placed.yaw, state, *states])
    return _of_both(np.array(own, float))


def places(board: BoardSpec) -> np.ndarray:
    """float (N, N, C): both positions, how the second lies to the first, how far, and how many lie nearer."""
    where = np.array([placed.position[:2] for placed in board.objects])
    apart = where[None] - where[:, None]
    distance = np.linalg.norm(apart, axis=-1, keepdims=True)
    nearer = distance[..., 0].argsort(axis=1).argsort(axis=1)[..., None]
    return np.concatenate([_of_both(where), apart, distance, nearer, nearer.transpose(1, 0, 2)], axis=-1)


def order(board: BoardSpec) -> np.ndarray:
    """float (N, N, C)."""
    numbers = np.arange(len(board.objects), dtype=float)[:, None]
    both = _of_both(numbers)
    return np.concatenate([both, both[..., :1] - both[..., 1:]], axis=-1)


def actions(sequence: BoardSequence) -> np.ndarray:
    """float (N, N, C), of the first object and of all together."""
    count, steps = len(sequence.triggers), sequence.steps
    own = np.zeros((count, 22))
    for index in range(count):
        when = np.flatnonzero(sequence.acted == index)
        if len(when):
            done = sequence.actions[when]
            gaps = np.diff(when, prepend=-1)
            told = [len(when), len(when) / steps, when[0], when[-1], when.mean(), gaps.max(), (gaps == 1).sum()]
            own[index] = [
                *told,
                *done.mean(0),
                *done.std(0),
                np.ptp(done[:, 0]),
                np.ptp(done[:, 1]),
                sequence.triggers.sum(),
            ]
    return np.repeat(own[:, None], count, axis=1)


def picture(features: np.ndarray) -> np.ndarray:
    """float (N, N, 256), the second object's features in the first picture."""
    return np.repeat(features[0].astype(float)[None], features.shape[1], axis=0)


def _of_both(own: np.ndarray) -> np.ndarray:
    """float (N, N, 2 C) from (N, C)."""
    first = np.repeat(own[:, None], len(own), axis=1)
    return np.concatenate([first, first.transpose(1, 0, 2)], axis=-1)


def said(told: np.ndarray, pairs: Pairs, seed: int) -> np.ndarray:
    """float (M,), the classifier's probability of each pair, from boards that it was not trained on."""
    from sklearn.decomposition import PCA
    from sklearn.ensemble import HistGradientBoostingClassifier

    fold = generator(seed, "shortcuts", 0, "folds").permutation(int(pairs.board.max()) + 1)[pairs.board] % FOLDS
    found = np.zeros(len(told))
    for number in range(FOLDS):
        learnt, judged = fold != number, fold == number
        seen = told
        if told.shape[1] > 4 * CHANNELS:
            seen = PCA(CHANNELS, random_state=0).fit(told[learnt]).transform(told)
        trees = HistGradientBoostingClassifier(
            max_iter=80, learning_rate=0.05, max_leaf_nodes=15, min_samples_leaf=40, l2_regularization=1, random_state=0
        )
        found[judged] = trees.fit(seen[learnt], pairs.true[learnt]).predict_proba(seen[judged])[:, 1]
    return found


def compared(score: np.ndarray, true: np.ndarray, group: np.ndarray) -> tuple[float, int]:
    """How many true pairs were put before others of their group (ties count half), and how many were compared.

    Args:
        score: (M,).
        true: bool (M,).
        group: int (M,).
    """
    before, count = 0.0, 0
    for one in np.unique(group):
        here = group == one
        positive = int(true[here].sum())
        ranks = rankdata(score[here])[true[here]]
        before += float(ranks.sum()) - positive * (positive + 1) / 2
        count += positive * (int(here.sum()) - positive)
    return before, count


def judged(score: np.ndarray, pairs: Pairs, seed: int) -> dict[str, Any]:
    """Areas of the three comparisons with 95 % intervals by the bootstrap over boards."""
    rows = [np.flatnonzero(pairs.board == number) for number in range(int(pairs.board.max()) + 1)]
    picked = generator(seed, "shortcuts", 0, "bootstrap").integers(len(rows), size=(DRAWS, len(rows)))
    everyone = np.zeros_like(pairs.kind)
    drawn = [np.concatenate([rows[k] for k in one]) for one in picked[:FEW_DRAWS]]
    areas = [_ratio(compared(score[own], pairs.true[own], everyone[own])) for own in drawn]
    pooled = {"area": _ratio(compared(score, pairs.true, everyone)), "interval": percentile_interval(np.array(areas))}
    found: dict[str, Any] = {"all": pooled}
    together = np.unique(np.stack([pairs.kind, pairs.child]), axis=1, return_inverse=True)[1].ravel()
    for name, group in (("alike", pairs.kind), ("whom", together)):
        counts = np.array([compared(score[own], pairs.true[own], group[own]) for own in rows])
        interval = share_interval(*counts[picked].sum(1).T)
        found[name] = {"area": _ratio(counts.sum(0)), "interval": interval}
    return found


def _ratio(counted: Sequence[float] | np.ndarray) -> float:
    return float(counted[0] / counted[1])


def recorded_boards(recordings: Iterable[Recorded]) -> Iterator[tuple[BoardSpec, dict[str, np.ndarray]]]:
    """Boards of all recordings of a world, with what only recordings tell."""
    for data in recordings:
        for seen in data.boards():
            board = seen.episode.board
            yield board, {"actions": actions(seen.sequence), "picture": picture(seen.sequence.features)}


def measure(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """The whole result, after each world."""
    library = find(arguments.assets)
    rows = runner.told_rows(arguments.out, KIND, assets=runner.assets_name(arguments.assets))
    for world in runner.chosen(arguments.only, NAMES) if arguments.only else NAMES:
        config = BoardConfig(world=world, boards=arguments.boards, seed=SEED, group_size=1)
        none: dict[str, np.ndarray] = {}
        drawn = pairs_of(((board, none) for board in generate_boards(config, library)), library)
        recordings = {name: Recorded.at(arguments.data / world / name, arguments.assets) for name in SCRIPTED}
        recorded = pairs_of(recorded_boards(recordings.values()), library)
        rows[world] = {"data": {name: one.dataset.hashes().content for name, one in recordings.items()}}
        for views, pairs in ((DRAWN, drawn), (RECORDED, recorded)):
            for view in views:
                told = judged(said(pairs.told[view], pairs, SEED), pairs, SEED)
                counts = {
                    "boards": int(pairs.board.max()) + 1,
                    "pairs": len(pairs.true),
                    "true": float(pairs.true.mean()),
                }
                rows[world][view] = {**counts, **told}
                print(world, view, told, file=sys.stderr, flush=True)
        kept = {name: rows[name] for name in NAMES if name in rows}
        yield {"assets": runner.assets_name(arguments.assets), "within": WITHIN, "rows": kept}


def main(words: list[str] | None = None) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--data", type=Path, required=True, help="recordings of `benchmarks.tables.worlds record`")
    options.add_argument("--boards", type=int, default=1000, help="of each world, for what needs no simulator")
    options.add_argument("--only", help="names of worlds, comma-separated; all by default")
    arguments = options.parse_args(words)
    for figures in measure(arguments):
        runner.finish(KIND, arguments, figures, seed=SEED)


if __name__ == "__main__":
    runner.one_of(main)
