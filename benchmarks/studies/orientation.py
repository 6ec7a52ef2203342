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
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import runner
from benchmarks.tables.worlds import Recorded
from busybot.boards.mechanisms import Mechanism
from busybot.common.rng import generator
from busybot.evaluation.statistics import two_level_interval
from busybot.reason.evaluation.causes import CLAIMED, count_parents, law_of, link_names, true_links
from busybot.reason.evaluation.evaluate import origin
from busybot.reason.evaluation.ground_truth import causes_of, trace_of
from busybot.reason.evaluation.hypotheses import Hypothesis, Space, board_space
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


@dataclass(frozen=True)
class Known:
    """What an observer knows of one responder that links drive.

    Attributes:
        counts: int (len(AFTER), 3), parents, link by link: rightly claimed, claimed, true.
        mechanism: whether it claims one, after 21 actions, that responds as the true one does.
    """

    board: int
    responder: str
    counts: np.ndarray
    mechanism: bool


def judged(recorded: Recorded, most: int) -> dict[str, list[Known]]:
    """Of each such responder, by whether the observer is told which way round links are."""
    found: dict[str, list[Known]] = {"told": [], "untold": []}
    for seen in recorded.boards(most):
        board, trace, law = seen.episode.board, trace_of(seen.episode), law_of(seen.episode, recorded.library)
        assert trace is not None and law is not None, "the simulator recorded its states"
        space, responders = board_space(board, law.links.sizes, law.stages)
        truth, names = causes_of(board, law.links), link_names(seen.episode)
        true = true_links(board, names, 0)
        for name, known in (("told", space), ("untold", untold(space))):
            counts, (likeliest, shares) = _watched(known, trace, responders, true)
            for place, index in enumerate(responders):
                mechanism = truth.mechanisms[index]
                if mechanism is not None and truth.read[index]:
                    meaning = Hypothesis(mechanism, truth.read[index]).meaning
                    right = bool(shares[place] > CLAIMED and likeliest[place].meaning == meaning)
                    found[name].append(Known(board.index, board.objects[index].key, counts[:, index], right))
    return found


def _watched(
    space: Space, trace: tuple[np.ndarray, np.ndarray], responders: list[int], true: np.ndarray
) -> tuple[np.ndarray, tuple[list[Hypothesis], np.ndarray]]:
    """Counts of parents, int (len(AFTER), N, 3), and the likeliest mechanisms after 21 actions with their
    probabilities."""
    links, states = trace
    observer, counts = Observer(space, links[0], states[0][responders]), []
    for action in range(1, max(AFTER) + 1):
        observer.see(links[action], states[action][responders])
        if action in AFTER:
            claimed = np.zeros_like(true)
            claimed[:, responders] = observer.belief().parents() > CLAIMED
            counts.append(count_parents(claimed, true))
        if action == ASKED:
            mechanisms = observer.belief().mechanisms()
    return np.array(counts), mechanisms


def figures(known: Sequence[Known]) -> dict[str, Any]:
    """Shares with 95 % intervals over objects and their boards."""
    counts = np.array([one.counts for one in known])
    groups, boards = [one.responder for one in known], [one.board for one in known]
    rng = generator(SEED, KIND, 0, "bootstrap")

    def share(part: np.ndarray, whole: np.ndarray) -> dict[str, Any]:
        interval = two_level_interval(part, whole, groups, boards, rng)
        return {"share": float(part.sum() / whole.sum()), "interval": interval}

    f1 = {
        str(action): share(2.0 * counts[:, place, 0], counts[:, place, 1:].sum(1).astype(float))
        for place, action in enumerate(AFTER)
    }
    right = np.array([one.mechanism for one in known], float)
    return {"responders": len(known), "link_parent_f1": f1, "mechanism": share(right, np.ones_like(right))}


def main(words: Sequence[str] | None = None) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--data", type=Path, required=True, help="recordings of `benchmarks.tables.worlds record`")
    options.add_argument("--boards", type=int, default=100, help="the first ones")
    arguments = options.parse_args(words)
    recorded = Recorded.at(arguments.data / WORLD / SET, arguments.assets)
    rows = {name: figures(known) for name, known in judged(recorded, arguments.boards).items()}
    boards = min(arguments.boards, len(recorded.dataset.finished()))
    told = {"assets": runner.assets_name(arguments.assets), "boards": boards, "rows": rows}
    runner.finish(KIND, arguments, told, hashes={"data": {f"{WORLD}/{SET}": origin(recorded.dataset)}}, seed=SEED)


if __name__ == "__main__":
    main()
