"""Measures what recordings determine about hard causes: the exact observer's share by number of actions.

    python -m benchmarks.studies.bounds --out benchmarks/results/bounds.json
        [--boards 60] [--greedy 12] [--assets procedural|DIR] [--only table,gates,time]

`table` is the table of symbolic boards: two-state links, six responders whose mechanisms are drawn from the space of
`hypotheses.table_space`. The other rows are boards that `busybot generate --world NAME` draws, of the training split
and of `novel-mechanism`, with their locks, luck and rewirings, but without a simulator: three of a hundred actions
fail.

Links are chosen at random (a link, then one of the states next to its own), or greedily, by what the exact observer
expects to learn; the greedy experimenter wastes no action on a link that is held, and may do nothing where time
matters.

A parent is claimed when it is more probable than not. A mechanism is known when what responds like it is more probable
than all else together. Intervals are by the bootstrap over boards.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from benchmarks.runner import assets_name, chosen, finish, one_of, parser, told_rows
from busybot.boards.config import BoardConfig
from busybot.boards.dynamics import Dynamics, Triggers
from busybot.boards.generate import generate_boards
from busybot.boards.mechanisms.rest import Rest
from busybot.boards.spec import BoardSpec
from busybot.boards.worlds import NOVEL, WORLDS, links_of
from busybot.common.rng import generator
from busybot.evaluation.statistics import share_interval
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.reason.evaluation.ground_truth import causes_of
from busybot.reason.evaluation.hypotheses import Hypothesis, Space, board_space, table_space
from busybot.reason.evaluation.upper_bound import Belief, Observer, greedy

KIND = "bounds"
TABLE = "table"
LINKS, RESPONDERS = (3, 4, 6), 6
TABLE_ACTIONS = (5, 10, 15, 22, 30, 40)
ACTIONS = (4, 8, 10, 12, 16, 22, 30, 40)
SPLITS = ("train", NOVEL)
CHOICES = ("random", "greedy")
WORKS = 0.97
"""Share of actions that move their link."""
DRAWS = 2000
CLAIMED = 0.5
COUNTS = ("right", "claimed", "true")


@dataclass
class Symbolic:
    """A board of the table: links, and responders whose mechanisms come from the space."""

    space: Space
    causes: list[Hypothesis]
    triggers: Triggers
    shown: tuple[int, ...] = ()
    owners: tuple[int, ...] = ()
    memories: list[tuple[int, ...]] = field(default_factory=list)
    waits: bool = False

    @staticmethod
    def draw(links: int, rng: np.random.Generator) -> "Symbolic":
        space = table_space(links, RESPONDERS)
        drawn = [space.hypotheses[int(rng.choice(len(space.prior), p=column))] for column in space.prior.T]
        board = Symbolic(space, drawn, tuple(int(state) for state in rng.integers(0, 2, links)))
        started = [one.mechanism.start(board._read(one)) for one in drawn]
        board.shown, board.memories = tuple(shown for shown, _ in started), [memory for _, memory in started]
        board.owners = tuple(range(links + RESPONDERS))
        return board

    def truth(self) -> list[Hypothesis]:
        return self.causes

    def moves(self, link: int) -> list[Triggers]:
        return [_with(self.triggers, link, 1 - self.triggers[link])]

    def held(self, link: int) -> bool:
        return False

    def act(self, triggers: Triggers) -> None:
        self.triggers = triggers
        pairs = zip(self.causes, self.memories, strict=True)
        stepped = [one.mechanism.step(self._read(one), memory, None) for one, memory in pairs]
        self.shown, self.memories = tuple(shown for shown, _ in stepped), [memory for _, memory in stepped]

    def _read(self, one: Hypothesis) -> tuple[int, ...]:
        return tuple(self.triggers[place] for place in one.inputs)


class Drawn:
    """A board of a world, moved without a simulator."""

    def __init__(self, board: BoardSpec, library: Library):
        models = [library.get(placed.key) for placed in board.objects]
        self.links = links_of(models)
        effects = [model.effect for model in models if model.effect is not None]
        self._stages = [(effect.single is not None, effect.multi is not None) for effect in effects]
        self.responders = [index for index, placed in enumerate(board.objects) if placed.role == "responder"]
        self.board, self.dynamics = board, Dynamics(board, self.links)
        self.waits = self.dynamics.remembers
        self.triggers: Triggers = tuple(state for placed in board.objects for state in placed.states)
        self.state = self.dynamics.start(self.triggers)
        self.owners = (*(index for index, _ in self.links.names), *self.responders)

    @cached_property
    def space(self) -> Space:
        return board_space(self.board, self.links.sizes, self._stages)[0]

    @property
    def shown(self) -> tuple[int, ...]:
        return tuple(self.state.shown[index] for index in self.responders)

    def truth(self) -> list[Hypothesis]:
        causes = causes_of(self.board, self.links, self.state.tick - 1)
        pairs = [(causes.mechanisms[index], causes.read[index]) for index in self.responders]
        return [Hypothesis(one or Rest(sizes=(), table=(0,)), read) for one, read in pairs]

    def moves(self, link: int) -> list[Triggers]:
        now = self.triggers[link]
        there = [state for state in (now - 1, now + 1) if 0 <= state < self.links.sizes[link]]
        return [_with(self.triggers, link, state) for state in there]

    def held(self, link: int) -> bool:
        return self.dynamics.locked(link, self.state.shown)

    def act(self, triggers: Triggers) -> None:
        self.triggers, self.state = triggers, self.dynamics.step(triggers, self.state)


Board = Symbolic | Drawn


def _with(triggers: Triggers, link: int, state: int) -> Triggers:
    return (*triggers[:link], state, *triggers[link + 1 :])


def play(board: Board, choice: str, actions: Sequence[int], rng: np.random.Generator) -> np.ndarray:
    """Act on a board and tell what is known after each of `actions`.

    Args:
        choice: one of `CHOICES`, or `coverage`: all links in turn, in an order that is drawn.

    Returns:
        float (len(actions), 2 x 3 + 2): `COUNTS` of parents at link level, then at object level; numbers of responders
        whose parents, and whose mechanism, is known.
    """
    observer = Observer(board.space, board.triggers, board.shown)
    told, order = [], rng.permutation(len(board.triggers)) if choice == "coverage" else ()
    for number in range(max(actions) + 1):
        if number:
            link, there = _chosen(
                board, observer, choice, rng, order[(number - 1) % len(order)] if len(order) else None
            )
            works = link is None or (rng.random() < WORKS and not board.held(link))
            board.act(there if works else board.triggers)
            observer.see(board.triggers, board.shown)
        if number in actions:
            told.append(judged(board, observer.belief()))
    return np.array(told)


def _chosen(
    board: Board, observer: Observer, choice: str, rng: np.random.Generator, due: int | None = None
) -> tuple[int | None, Triggers]:
    """The link to be moved, None for none, and the states that are meant to follow; the link that is due, if one is."""
    links = list(range(len(board.triggers)))
    if choice != "greedy":
        link = int(rng.integers(len(links))) if due is None else int(due)
        moves = board.moves(link)
        return link, moves[int(rng.integers(len(moves)))]
    choices: list[tuple[int | None, Triggers]] = [
        (n, move) for n in links if not board.held(n) for move in board.moves(n)
    ]
    if board.waits or not choices:
        choices.append((None, board.triggers))
    return choices[greedy(observer.belief(), [there for _, there in choices], rng)]


def judged(board: Board, belief: Belief) -> list[float]:
    """A row of what `play` returns."""
    truth = board.truth()
    parents = np.zeros((len(board.owners), len(truth)), bool)
    for responder, one in enumerate(truth):
        parents[list(one.inputs), responder] = True
    objects = max(board.owners) + 1
    of_objects = np.zeros((objects, len(truth)), bool)
    np.logical_or.at(of_objects, np.array(board.owners), parents)
    found, probable = belief.mechanisms()
    same = [board.space.meaning_of(one) == board.space.meaning_of(two) for one, two in zip(found, truth, strict=True)]
    sets = [one == tuple(sorted(two.inputs)) for one, two in zip(belief.parent_sets(), truth, strict=True)]
    counts = [
        *_counts(belief.parents() > CLAIMED, parents),
        *_counts(belief.object_parents(board.owners, objects) > CLAIMED, of_objects),
    ]
    return [*counts, float(sum(sets)), float((np.array(same) & (probable > CLAIMED)).sum())]


def _counts(claimed: np.ndarray, true: np.ndarray) -> tuple[float, float, float]:
    return float((claimed & true).sum()), float(claimed.sum()), float(true.sum())


def summed(
    told: np.ndarray, responders: np.ndarray, actions: Sequence[int], rng: np.random.Generator
) -> dict[str, Any]:
    """JSON values by measure and number of actions, of boards (B, len(actions), 8) with so many responders (B,)."""
    picked = rng.integers(0, len(told), (DRAWS, len(told)))

    def share(part: np.ndarray, whole: np.ndarray) -> dict[str, Any]:
        interval = share_interval(part[picked].sum(1), whole[picked].sum(1))
        total = float(whole.sum())
        return {"share": float(part.sum()) / total if total else None, "interval": interval}

    found: dict[str, Any] = {}
    for place, number in enumerate(actions):
        here = told[:, place]
        for level, first in (("link", 0), ("object", 3)):
            right, claimed, true = here[:, first], here[:, first + 1], here[:, first + 2]
            parts = {"p": share(right, claimed), "r": share(right, true), "f1": share(2 * right, claimed + true)}
            found.setdefault(level, {})[str(number)] = parts
        found.setdefault("parents", {})[str(number)] = share(here[:, 6], responders)
        found.setdefault("mechanism", {})[str(number)] = share(here[:, 7], responders)
    return found


def row(boards: list[Board], choice: str, actions: Sequence[int], name: str, seed: int) -> dict[str, Any]:
    """What is known of these boards, one after the other."""
    told, responders = [], np.array([board.space.responders for board in boards])
    for number, board in enumerate(boards):
        told.append(play(board, choice, actions, generator(seed, name, number, f"bounds/{choice}")))
    print(f"{name}, {choice}: {len(boards)} boards", flush=True)
    return {"boards": len(boards), **summed(np.array(told), responders, actions, generator(seed, name, 0, "bootstrap"))}


def table_rows(counts: dict[str, int], seed: int) -> dict[str, Any]:
    """By number of links and way of choosing."""
    found: dict[str, Any] = {}
    for links in LINKS:
        for choice in CHOICES:
            name = f"{TABLE}/{links}"
            boards: list[Board] = [
                Symbolic.draw(links, generator(seed, name, number, f"bounds/board/{choice}"))
                for number in range(counts[choice])
            ]
            found.setdefault(str(links), {})[choice] = row(boards, choice, TABLE_ACTIONS, name, seed)
    return found


def world_rows(world: str, library: Library, counts: dict[str, int], seed: int) -> dict[str, Any]:
    """By split and way of choosing; a split of which a world has no mechanism is left out."""
    found: dict[str, Any] = {}
    for split in SPLITS:
        config = BoardConfig(world=world, split=split, boards=max(counts.values()), seed=seed, group_size=1)
        specs = list(generate_boards(config, library))
        for choice in CHOICES:
            boards: list[Board] = [Drawn(spec, library) for spec in specs[: counts[choice]]]
            found.setdefault(split, {})[choice] = row(boards, choice, ACTIONS, f"{world}/{split}", seed)
    return found


def measure(arguments: argparse.Namespace, library: Library) -> Iterator[dict[str, Any]]:
    """The whole result, after each of its rows; those that are not asked for are kept from an earlier one."""
    known = (TABLE, *WORLDS)
    names = chosen(arguments.only, known) if arguments.only else known
    counts = {"random": arguments.boards, "greedy": arguments.greedy}
    rows = told_rows(arguments.out, KIND, assets=assets_name(arguments.assets), seed=arguments.seed)
    for name in names:
        if name == TABLE:
            rows[name] = table_rows(counts, arguments.seed)
        else:
            rows[name] = world_rows(name, library, counts, arguments.seed)
        kept = {one: rows[one] for one in known if one in rows}
        yield {"assets": assets_name(arguments.assets), "works": WORKS, "rows": kept}


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__)
    options.add_argument("--boards", type=int, default=60, help="of each cell with random choice")
    options.add_argument("--greedy", type=int, default=12, help="of each cell with greedy choice")
    options.add_argument("--only", help="`table` and names of worlds, separated by commas")
    options.add_argument("--seed", type=int, default=0)
    arguments = options.parse_args(words)
    library = find(arguments.assets)
    for figures in measure(arguments, library):
        finish(KIND, arguments, figures, hashes={"data": {"objects": library.sha256}})


if __name__ == "__main__":
    one_of(main)
