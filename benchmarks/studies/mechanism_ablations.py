"""Trains the `mechanism` network on less, or without something that it reads, and judges it on recorded boards.

    python -m benchmarks.studies.mechanism_ablations --data DATA --assets DIR --work FOLDER
        --out benchmarks/results/mechanism-ablations.json [--only NAMES] [--worlds NAMES] [--iterations 2000]
        [--most BOARDS]

DATA is what `benchmarks.tables.worlds record` made: recorded boards of the training split, real objects, of seven
worlds, on which the scripted policy acted. All but those called `validation` are trained on; on these, parents of links
that were seen are judged. Nothing is chosen by them: all trainings are equally long, and the last weights are judged.
Each row is compared with the first one on the same boards. Rows of a result that are not asked for stay, and trainings
that were stopped go on.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch

from benchmarks.runner import chosen, finish, hashes_beside, one_of, parser, told_rows
from benchmarks.studies.bounds import CLAIMED
from benchmarks.studies.mechanisms import f1_of, found_parents, parent_counts, picked_boards, weights_hash
from benchmarks.tables.world_rows import ENCODER
from benchmarks.tables.worlds import SCRIPTED, Recorded
from busybot.boards.spec import PAPER
from busybot.boards.worlds import WORLDS
from busybot.datasets.dataset import INFO_FILE
from busybot.evaluation.statistics import percentile_interval
from busybot.objects.resolve import find
from busybot.reason.models.mechanism.config import Blur, MechanismConfig, MechanismNetConfig
from busybot.reason.models.mechanism.contexts import MEMORIES
from busybot.reason.models.mechanism.evidence import EITHER, LEFT, SCALE
from busybot.reason.models.mechanism.perception import Perceived, perceive
from busybot.reason.models.mechanism.training.labelled import LabelledTrace, draw_boards, labelled
from busybot.reason.models.mechanism.training.learner import MechanismLearner
from busybot.reason.pyg import HeteroData
from busybot.training.loop import fit
from busybot.training.run_folder import begin_folder

KIND = "mechanism-ablations"
ACTIONS = (10, 22, 30)
JUDGED = tuple(name for name in WORLDS if name != PAPER)
NOW = [number for number, name in enumerate(MEMORIES) if name in ("none", "own", "late 0", "own and now")]


def _no_past(graph: HeteroData) -> None:
    node = graph["explanation"]
    now = torch.isin(node.kind % len(MEMORIES), torch.tensor(NOW))
    node.possible = node.possible & now[:, None]


def _no_witnesses(graph: HeteroData) -> None:
    graph["explanation", "reads", "candidate"].witnesses.zero_()


def _any_function(graph: HeteroData) -> None:
    graph["explanation"].evidence[..., LEFT] = graph["explanation"].evidence[..., 0]


def _not_told(graph: HeteroData) -> None:
    graph["board"].world.zero_()


def _nothing_hidden(graph: HeteroData) -> None:
    node = graph["explanation"]
    if "later" in node:  # boards that are judged have labels
        node.later = SCALE * node.evidence[..., EITHER]


@dataclass(frozen=True)
class Ablation:
    """What a network is trained on, and does without.

    Attributes:
        recorded, drawn: boards of all worlds together.
        masked: as of `MechanismConfig`.
        hide: takes something out of a board's graph.
        unseen: how links stand is not looked at: every action that takes hold of one flips it.
    """

    labels: Literal["parents", "pictures"] = "parents"
    recorded: int = 1000
    drawn: int = 0
    masked: float = 0.0
    hide: Callable[[HeteroData], None] = field(default=lambda graph: None)
    unseen: bool = False


WHOLE = "labels"
MASKED = 0.15
"""Share of the links that are hidden in an iteration of the row that masks links: one in seven."""
ABLATIONS: Mapping[str, Ablation] = {
    WHOLE: Ablation(),
    "labels 100": Ablation(recorded=100),
    "labels 300": Ablation(recorded=300),
    "labels 3000": Ablation(drawn=2000),
    "labels 3000 drawn": Ablation(recorded=0, drawn=3000),
    "labels links not seen": Ablation(unseen=True),
    "labels no past": Ablation(hide=_no_past),
    "labels no witnesses": Ablation(hide=_no_witnesses),
    "labels any function": Ablation(hide=_any_function),
    "labels world not told": Ablation(hide=_not_told),
    "pictures": Ablation("pictures"),
    "pictures 100": Ablation("pictures", 100),
    "pictures 300": Ablation("pictures", 300),
    "pictures 3000": Ablation("pictures", drawn=2000),
    "pictures links masked": Ablation("pictures", masked=MASKED),
    "pictures nothing hidden": Ablation("pictures", hide=_nothing_hidden),
}
"""The first is what all others are compared with."""


class _Ablated(MechanismLearner):
    """A learner that does without something."""

    hide: Callable[[HeteroData], None]

    def graph(self, board: LabelledTrace, after: Sequence[int]) -> HeteroData:
        made = super().graph(board, after)
        self.hide(made)
        return made


def _flipping(seen: Perceived, board: LabelledTrace) -> LabelledTrace:
    """The same with links that every action flips."""
    held = seen.links.clusters[:, None] == np.arange(len(seen.links.owners))
    states = np.concatenate([np.zeros((1, held.shape[1]), int), np.cumsum(held, axis=0) % 2])
    return replace(board, trace=replace(board.trace, links=states, sizes=(2,) * held.shape[1]))


Boards = list[tuple[Perceived, LabelledTrace]]


def seen_boards(recorded: Recorded, most: int | None) -> Boards:
    """The recorded boards of a dataset as pictures show them, with their true parents."""
    found = []
    for seen in recorded.boards(most):
        perceived = perceive(seen.sequence, ENCODER)
        found.append((perceived, labelled(seen.episode, perceived)))
    return found


def trained(name: str, boards: Boards, data: Mapping[str, str], arguments: argparse.Namespace) -> _Ablated:
    """The network of a row; boards of all worlds take turns, so that fewer are fewer of each.

    Args:
        data: hashes of the datasets that the boards come from.
    """
    row = ABLATIONS[name]
    traces = [_flipping(*one) if row.unseen else one[1] for one in boards[: row.recorded]]
    library, worlds = find("procedural"), sorted({one.world for _, one in boards})
    share = row.drawn // len(worlds)
    for world in worlds if share else ():
        traces += [trace for _, trace in draw_boards(world, share, arguments.seed, library, max(ACTIONS), Blur())]
    if row.labels == "pictures":
        traces = [LabelledTrace(one.trace, one.world) for one in traces]
    net = MechanismNetConfig(worlds=tuple(worlds), changes=row.labels == "parents")
    config = MechanismConfig(iterations=arguments.iterations, labels=row.labels, masked=row.masked, net=net)
    folder = arguments.work / name.replace(" ", "-")
    begin_folder(folder, config, arguments.seed, data=[{"row": name, "boards": len(traces), **data}])
    learner = _Ablated(config, traces, [], arguments.seed)
    learner.hide = row.hide
    fit(learner, folder, config.loop)
    return learner


@torch.no_grad()
def judged(learner: _Ablated, boards: Boards, unseen: bool) -> np.ndarray:
    """Links rightly claimed, claimed and true, int (B, K, 3), of those that were seen, after each of `ACTIONS`."""
    learner.network.eval()
    counts = []
    for seen, board in boards:
        graph = learner.graph(_flipping(seen, board) if unseen else board, ACTIONS)
        found = found_parents(learner.network, graph, board, ACTIONS)
        assert board.parents is not None
        true, links = board.parents[np.array(ACTIONS) - 1], board.trace.links.shape[1]  # (K, I, R)
        counts.append(parent_counts(found[:, :links] > CLAIMED, true[:, :links]))
    return np.array(counts)


def compared(counts: np.ndarray, others: np.ndarray, seed: int) -> dict[str, Any]:
    """F1 by number of actions, and how far it is ahead of another network's on the same boards, (B, K, 3)."""
    picked = picked_boards(seed, len(counts))
    told = {}
    for place, after in enumerate(ACTIONS):
        own, other = counts[:, place], others[:, place]
        ahead = _f1(own[picked].sum(1)) - _f1(other[picked].sum(1))
        gap = {"ahead": float(_f1(own.sum(0)) - _f1(other.sum(0))), "ahead_interval": percentile_interval(ahead)}
        told[str(after)] = f1_of(own, picked) | gap
    return told


def _f1(counts: np.ndarray) -> np.ndarray:
    """Of counts (..., 3)."""
    return 2 * counts[..., 0] / np.maximum(counts[..., 1] + counts[..., 2], 1)


def measure(arguments: argparse.Namespace) -> None:
    """Write the result after each row, with the rows of an earlier one that are not asked for."""
    names = chosen(arguments.only, ABLATIONS) if arguments.only else tuple(ABLATIONS)
    rows = told_rows(arguments.out, KIND)
    worlds = chosen(arguments.worlds, JUDGED) if arguments.worlds else JUDGED
    of_world: dict[str, Boards] = {world: [] for world in worlds}
    held: dict[str, Boards] = {}
    data: dict[str, str] = {}
    for world in worlds:
        there = (arguments.data / world / name for name in sorted(SCRIPTED))
        folders = [path for path in there if (path / INFO_FILE).exists()]
        for folder in folders:
            recorded = Recorded.at(folder, arguments.assets)
            data[f"{world}/{folder.name}"] = recorded.dataset.hashes().content
            read = seen_boards(recorded, arguments.most)
            if folder.name == "validation":
                held[world] = read
            else:
                of_world[world] += read
        print(world, {"trained on": len(of_world[world]), "judged": len(held[world])}, flush=True)
    kept = rows.keys() - {WHOLE, *names}
    told_data = hashes_beside(arguments.out, KIND, "data", data) if kept else data
    longest = max(map(len, of_world.values()))
    turns = [own[k] for k in range(longest) for own in of_world.values() if k < len(own)]
    whole: dict[str, np.ndarray] = {}
    for name in dict.fromkeys((WHOLE, *names)):
        learner = trained(name, turns, data, arguments)
        counts = {world: judged(learner, own, ABLATIONS[name].unseen) for world, own in held.items()}
        counts["all"] = np.concatenate(list(counts.values()))
        whole = whole or counts
        row = {world: compared(own, whole[world], arguments.seed) for world, own in counts.items()}
        rows[name] = {"boards": len(learner.boards), "model": weights_hash(learner.network), "worlds": row}
        print(name, {world: [round(100 * one["share"], 1) for one in told.values()] for world, told in row.items()})
        figures = {"rows": rows, "judged": {world: len(own) for world, own in held.items()}}
        finish(KIND, arguments, figures, hashes={"data": told_data})


def main(words: Sequence[str] | None = None) -> None:
    options = parser(__doc__)
    options.add_argument("--data", type=Path, required=True, help="folder of recordings")
    options.add_argument("--work", type=Path, required=True, help="folder of the trainings")
    options.add_argument("--only", help="names of rows, separated by commas; all by default")
    options.add_argument("--worlds", help="names of worlds, separated by commas; all by default")
    options.add_argument("--iterations", type=int, default=2000)
    options.add_argument("--most", type=int, help="boards of each dataset; all by default")
    options.add_argument("--seed", type=int, default=0)
    measure(options.parse_args(words))


if __name__ == "__main__":
    one_of(main)
