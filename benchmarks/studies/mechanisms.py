"""Trains the `mechanism` network on true states of drawn boards, and compares it with the exact observer.

    python -m benchmarks.studies.mechanisms --work FOLDER --out benchmarks/results/mechanisms.json
        [--boards 400] [--judged 60] [--iterations 3000] [--worlds gates,time,...]

No picture is involved: what the network loses against the exact observer here, it loses by inference alone. Boards are
of the training split, with procedural objects and random actions of which three in a hundred fail, moved without a
simulator; those that are judged have seeds of their own. Labels are the true parents of the boards that are trained on.
A training that was stopped goes on.
"""

import argparse
import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import save

from benchmarks.runner import chosen, finish, one_of, parser
from benchmarks.studies.bounds import CLAIMED, DRAWS, Drawn
from busybot.boards.worlds import WORLDS
from busybot.common.rng import generator
from busybot.evaluation.statistics import share_interval
from busybot.objects.library import Library
from busybot.objects.resolve import find
from busybot.reason.evaluation.hypotheses import Space
from busybot.reason.evaluation.upper_bound import Observer
from busybot.reason.models.mechanism.config import MechanismConfig, MechanismNetConfig
from busybot.reason.models.mechanism.contexts import Trace
from busybot.reason.models.mechanism.networks import MechanismNet, parents_of, world_number
from busybot.reason.models.mechanism.training.labelled import LabelledTrace, draw_boards
from busybot.reason.models.mechanism.training.learner import JUDGED_AFTER, MechanismLearner
from busybot.reason.pyg import Batch, HeteroData
from busybot.training.loop import fit
from busybot.training.run_folder import begin_folder

KIND = "mechanisms"
ACTIONS = 30
TRAINED_SEED, JUDGED_SEED = 0, 7_000_000
"""Boards of a training take seeds from the first on."""


def draw(world: str, boards: int, seed: int, library: Library) -> Iterator[tuple[LabelledTrace, np.ndarray | None]]:
    """Boards of a world after random actions, each with what the exact observer believes of the parents.

    Yields:
        the trace, and float (len(JUDGED_AFTER), I, R); None on boards to train on, which nobody observes.
    """
    for board, seen in draw_boards(world, boards, seed, library, ACTIONS):
        yield seen, _believed(Drawn(board, library).space, seen.trace) if seed >= JUDGED_SEED else None


def _believed(space: Space, trace: Trace) -> np.ndarray:
    """What the exact observer believes after each of `JUDGED_AFTER`."""
    triggers, shown = ([tuple(row) for row in states.tolist()] for states in (trace.links, trace.responders))
    observer, believed = Observer(space, triggers[0], shown[0]), []
    for action in range(1, len(triggers)):
        observer.see(triggers[action], shown[action])
        if action in JUDGED_AFTER:
            believed.append(observer.belief().parents())
    return np.array(believed)


@torch.no_grad()
def compare(net: MechanismNet, boards: Sequence[tuple[LabelledTrace, np.ndarray | None]], seed: int) -> dict[str, Any]:
    """F1 of parents link by link, of the network and of the exact observer, by number of actions."""
    told = []
    for board, believed in boards:
        graph = board.graph(JUDGED_AFTER, world_number(net.config, board.world))
        found = found_parents(net, graph, board, JUDGED_AFTER)
        assert board.parents is not None and believed is not None
        true = board.parents[np.array(JUDGED_AFTER) - 1]  # (K, I, R)
        told.append([parent_counts(found > CLAIMED, true), parent_counts(believed > CLAIMED, true)])
    counts = np.array(told)  # (B, 2, K, 3)
    picked = picked_boards(seed, len(counts))
    return {
        str(after): {who: f1_of(counts[:, row, place], picked) for row, who in enumerate(("network", "bound"))}
        for place, after in enumerate(JUDGED_AFTER)
    }


def found_parents(net: MechanismNet, graph: HeteroData, board: LabelledTrace, after: Sequence[int]) -> np.ndarray:
    """Probabilities of parents by the network, float (K, I, R), as of `LabelledTrace.parents`."""
    batch = Batch.from_data_list([graph])
    responders = board.trace.responders.shape[1]
    return parents_of(net(batch)[0], batch).view(responders, -1, len(after)).numpy().T


def picked_boards(seed: int, boards: int) -> np.ndarray:
    """Boards of each draw of a bootstrap."""
    return generator(seed, "bootstrap", 0, KIND).integers(0, boards, (DRAWS, boards))


def f1_of(counts: np.ndarray, picked: np.ndarray) -> dict[str, Any]:
    """F1 with its interval, of `parent_counts` of each board, int (B, 3)."""
    part, whole = 2 * counts[:, 0], counts[:, 1] + counts[:, 2]
    interval = share_interval(part[picked].sum(1), whole[picked].sum(1))
    return {"share": float(part.sum() / max(whole.sum(), 1)), "interval": interval}


def weights_hash(net: MechanismNet) -> str:
    """sha256 of the network's weights, as a file of them would have it."""
    return hashlib.sha256(save(net.state_dict())).hexdigest()


def parent_counts(claimed: np.ndarray, true: np.ndarray) -> np.ndarray:
    """(K, 3): rightly claimed, claimed and true, of bool (K, I, R)."""
    return np.stack([each.sum((1, 2)) for each in (claimed & true, claimed, true)], axis=1)


def measure(arguments: argparse.Namespace) -> None:
    """Write the whole result; the training goes on where it was stopped."""
    worlds = chosen(arguments.worlds, WORLDS) if arguments.worlds else tuple(WORLDS)
    library, net = find("procedural"), MechanismNetConfig(worlds=worlds)
    config = MechanismConfig(iterations=arguments.iterations, net=net)
    begin_folder(arguments.work, config, arguments.seed, data=[{"worlds": list(worlds), "boards": arguments.boards}])
    trained = [board for world in worlds for board, _ in draw(world, arguments.boards, arguments.seed, library)]
    held = max(1, len(trained) // 20)
    order = generator(arguments.seed, "train", 0, "mechanisms/held out").permutation(len(trained))
    held_out, boards = [trained[i] for i in order[:held]], [trained[i] for i in order[held:]]
    learner = MechanismLearner(config, boards, held_out, arguments.seed)
    figures = fit(learner, arguments.work, config.loop)
    learner.network.eval()
    rows = {}
    for world in worlds:
        judged = list(draw(world, arguments.judged, JUDGED_SEED + arguments.seed, library))
        rows[world] = compare(learner.network, judged, arguments.seed)
        print(world, {k: [round(100 * v[who]["share"], 1) for who in v] for k, v in rows[world].items()}, flush=True)
    hashes = {"models": {KIND: weights_hash(learner.network)}, "data": {"objects": library.sha256}}
    told = {"boards": len(trained), "judged": arguments.judged, "training": figures, "rows": rows}
    finish(KIND, arguments, told, hashes=hashes)


def main(words: list[str] | None = None) -> None:
    options = parser(__doc__, assets=False)
    options.add_argument("--work", type=Path, required=True, help="folder of the training")
    options.add_argument("--boards", type=int, default=400, help="of each world to train on")
    options.add_argument("--judged", type=int, default=60, help="of each world to judge on")
    options.add_argument("--iterations", type=int, default=3000)
    options.add_argument("--worlds", help="names of worlds, separated by commas; all by default")
    options.add_argument("--seed", type=int, default=0)
    measure(options.parse_args(words))


if __name__ == "__main__":
    one_of(main)
