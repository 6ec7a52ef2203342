"""What a recording determines for somebody who is not told which state of a link is "on".

    python -m benchmarks.studies.orientation --data FOLDER --assets DIR --out benchmarks/results/orientation.json
        [--boards 100]

Gates are true where a link rests in its highest state, and training has four of the eight functions of two links in
which one combination differs from the other three: which four depends on what is high. The exact observer is told the
states, pictures show only that there are two. Here the same observer is asked once more with a space in which every
link of every mechanism may be the other way round, as probable as it was; nothing else differs. The recordings are
those of `benchmarks.tables.worlds record`, in the world `gates`, where all mechanisms are tables of states.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import runner
from benchmarks.studies.bounds import Drawn, judged, summed
from benchmarks.tables.worlds import Recorded
from busybot.boards.mechanisms import Mechanism
from busybot.common.rng import generator
from busybot.reason.evaluation.evaluate import origin
from busybot.reason.evaluation.ground_truth import trace_of
from busybot.reason.evaluation.hypotheses import Hypothesis, Space
from busybot.reason.evaluation.upper_bound import Observer

KIND, WORLD, SET = "orientation", "gates", "others"
SEED = 0
ASKED, AFTER = 21, (10, 21, 29)
"""Actions after which mechanisms, and parents, are asked about; 21 are those of 22 images."""


def turned(mechanism: Mechanism, which: Sequence[bool]) -> Mechanism:
    """The same mechanism with some of its inputs the other way round."""
    table = np.array(mechanism.table).reshape(mechanism.sizes)
    flipped = np.flip(table, tuple(axis for axis, one in enumerate(which) if one))
    return mechanism.model_copy(update={"table": tuple(flipped.ravel().tolist())})


@lru_cache(maxsize=256)
def untold(space: Space) -> Space:
    """The space of an observer who does not know which way round links are."""
    links = len(space.sizes)
    found: dict[tuple[Any, ...], list[Any]] = {}
    for number, one in enumerate(space.hypotheses):
        ways = [which for which in product(*((False, True) if place < links else (False,) for place in one.inputs))]
        for which in ways:
            other = Hypothesis(turned(one.mechanism, which), one.inputs) if any(which) else one
            key = (int(space.stages[number]), other.kind, other.meaning)
            kept = found.setdefault(key, [other, number, np.zeros(space.responders), np.zeros(space.responders)])
            kept[2] = kept[2] + space.prior[number] / len(ways)
            kept[3] = kept[3] + space.driven[number] / len(ways)
    hypotheses, numbers, prior, driven = zip(*found.values(), strict=True)
    rows = list(numbers)
    return replace(
        space, hypotheses=hypotheses, prior=np.array(prior), stages=space.stages[rows], driven=np.array(driven),
        orders=space.orders[rows],
    )  # fmt: skip


class Untold(Drawn):
    """A board whose observer is not told."""

    @cached_property
    def space(self) -> Space:
        return untold(super().space)


def known(board: Drawn, links: np.ndarray) -> np.ndarray:
    """What `bounds.judged` tells after each of `AFTER` of the recorded actions, float (len(AFTER), 8).

    Args:
        links: int (T + 1, L), their states on the new board and after each action.
    """
    observer, told = Observer(board.space, board.triggers, board.shown), []
    for number, triggers in enumerate(links.tolist()[1 : max(AFTER) + 1], 1):
        board.act(tuple(triggers))
        observer.see(board.triggers, board.shown)
        if number in AFTER:
            told.append(judged(board, observer.belief()))
    return np.array(told)


def figures(recorded: Recorded, most: int, kind: type[Drawn]) -> dict[str, Any]:
    """Shares with their 95 % intervals over boards."""
    told, responders = [], []
    for seen in recorded.boards(most):
        trace, board = trace_of(seen.episode), kind(seen.episode.board, recorded.library)
        assert trace is not None, "the simulator recorded its states"
        told.append(known(board, trace[0]))
        responders.append(board.space.responders)
    shares = summed(np.array(told), np.array(responders), AFTER, generator(SEED, KIND, 0, "bootstrap"))
    return {
        "responders": sum(responders),
        "link_parent_f1": {action: told["f1"] for action, told in shares["link"].items()},
        "mechanism": shares["mechanism"][str(ASKED)],
    }


def main(words: Sequence[str] | None = None) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--data", type=Path, required=True, help="recordings of `benchmarks.tables.worlds record`")
    options.add_argument("--boards", type=int, default=100, help="the first ones")
    arguments = options.parse_args(words)
    recorded = Recorded.at(arguments.data / WORLD / SET, arguments.assets)
    kinds = {"told": Drawn, "untold": Untold}
    rows = {name: figures(recorded, arguments.boards, kind) for name, kind in kinds.items()}
    boards = min(arguments.boards, len(recorded.dataset.finished()))
    told = {"assets": runner.assets_name(arguments.assets), "boards": boards, "rows": rows}
    runner.finish(KIND, arguments, told, hashes={"data": {f"{WORLD}/{SET}": origin(recorded.dataset)}}, seed=SEED)


if __name__ == "__main__":
    runner.one_of(main)
