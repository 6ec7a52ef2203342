"""What pictures cost the `mechanism` model: the same recordings, with true states in the place of seen ones.

    python -m benchmarks.studies.perception_costs --data NAME=DATASET [--data NAME=DATASET]
        --assets DIR --out benchmarks/results/perception-costs.json [--models mechanism,FOLDER] [--boards 60]

Datasets are recordings that know states, of boards on which choices may be made: the validation sets that
`benchmarks.tables.world_gates` records, say, before the clean and the real camera. Perception makes a trace of each:
states of links and of responders. The network is asked what explains it as it is, with links that truly move as their
actions moved them, with responders that truly change, and with both. Links that nobody saw moving stay unseen; what is
no link leaves where links are true. F1 of links is of all true ones, as in the gates, all models together. What both
leave is what was not done before that camera, or does not tell more.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import runner
from benchmarks.studies.bounds import CLAIMED
from benchmarks.studies.mechanism_ablations import ACTIONS, compared
from benchmarks.tables.world_rows import ENCODER, Seen
from benchmarks.tables.worlds import Recorded
from busybot.common.errors import UsageError
from busybot.evaluation.results import read_result
from busybot.reason.evaluation.causes import held_links, link_names, matched_links, true_links
from busybot.reason.evaluation.evaluate import origin
from busybot.reason.evaluation.ground_truth import trace_of
from busybot.reason.inputs.trigger_links import numbered
from busybot.reason.models.mechanism.contexts import Trace
from busybot.reason.models.mechanism.perception import Perceived, perceive
from busybot.reason.models.mechanism.reasoner import MechanismReasoner
from busybot.reason.models.mechanism.training.pictured import as_they_appear
from busybot.reason.models.registry import load_reasoner
from busybot.training.model_cards import file_hashes, find_folder

KIND, SEED = "perception-costs", 0
SEEN = "seen"
WAYS: Mapping[str, tuple[bool, bool]] = {
    SEEN: (False, False), "links": (True, False), "responders": (False, True), "both": (True, True),
}  # fmt: skip
"""Whether links, and responders, are told truly."""


@dataclass(frozen=True)
class Watched:
    """A recording with what it shows and what was true; T actions, L seen links, M true ones, R responders.

    Attributes:
        links: int (T + 1, M), true states.
        shown: int (T + 1, R), the same of the responders that are seen.
        of: by seen link, the true one that it stands for.
    """

    seen: Seen
    perceived: Perceived
    links: np.ndarray
    shown: np.ndarray
    of: Mapping[int, int]

    @staticmethod
    def at(seen: Seen) -> "Watched":
        """Watch a recording.

        Raises:
            UsageError: it does not know states.
        """
        trace = trace_of(seen.episode)
        if trace is None:
            raise UsageError(f"board {seen.episode.board.index}: nobody knows its states", "record it with a simulator")
        perceived = perceive(seen.sequence, ENCODER)
        of = matched_links(perceived.links.clusters, held_links(seen.episode), trace[0].shape[1])
        return Watched(seen, perceived, trace[0], trace[1][:, perceived.responders], of)

    def told(self, links: bool, responders: bool) -> tuple[Trace, np.ndarray]:
        """The trace with what is told truly; and which true link each of its links is, int, -1 for none."""
        trace = self.perceived.trace
        states, which = trace.links, np.array([self.of.get(link, -1) for link in range(trace.links.shape[1])], int)
        if links:
            which = which[which >= 0]
            states = _as_seen(self.links[:, which], numbered)
        shown = _as_seen(self.shown, as_they_appear) if responders else trace.responders
        hidden = None if responders else trace.hidden
        return Trace(states, shown, tuple((states.max(0, initial=1) + 1).tolist()), hidden), which

    def counts(self, reasoner: MechanismReasoner, way: str) -> np.ndarray:
        """Links rightly claimed, claimed and true after each of `ACTIONS`, int (K, 3)."""
        (trace, which), facts = self.told(*WAYS[way]), reasoner.facts_of(self.seen.sequence)
        rising = facts.rising
        if rising is not None and WAYS[way][0]:
            rising = rising[[link for link in range(len(rising)) if link in self.of]]
        after = [min(actions, len(self.links) - 1) for actions in ACTIONS]
        found, shares, _ = reasoner.explain(trace, after, self.seen.sequence.world, rising, facts.unsteady)
        claimed = np.einsum("rhk,hi->kir", shares, found.inputs[:, : len(which)].astype(float)) > CLAIMED
        rows, names = [], link_names(self.seen.episode)[: self.links.shape[1]]  # of links alone
        for number, said in zip(after, claimed, strict=True):
            true = true_links(self.seen.episode.board, names, max(0, number - 1))
            right = said[which >= 0] & true[which[which >= 0]][:, self.perceived.responders]
            rows.append([right.sum(), said.sum(), true.sum()])
        return np.array(rows, int)

    def mistakes(self) -> dict[str, int]:
        """What is seen wrongly: of links and responders, states in all frames; and whole ones."""
        told: Counter[str] = Counter()
        for link, true in self.of.items():
            told["link states"] += len(self.links)
            told["link states wrong"] += wrong(self.perceived.trace.links[:, link], self.links[:, true])
        told["links that are none"] = self.perceived.trace.links.shape[1] - len(self.of)
        told["links"] = self.links.shape[1]
        moved = np.flatnonzero((self.links != self.links[0]).any(0))
        told["links moved"], told["links not seen"] = len(moved), len(set(moved.tolist()) - set(self.of.values()))
        for states, true in zip(self.perceived.trace.responders.T, self.shown.T, strict=True):
            told["responder states"] += len(true)
            told["responder states wrong"] += wrong(states, true)
            changed = bool((true != true[0]).any())
            told["responders changed"] += changed
            told["responders not seen to"] += changed and not (states != states[0]).any()
        return dict(told)


def _as_seen(states: np.ndarray, naming: Any) -> np.ndarray:
    """States (T + 1, n), each column with numbers as pictures give them."""
    return np.array([naming(column) for column in states.T], int).reshape(-1, len(states)).T


def wrong(seen: np.ndarray, true: np.ndarray) -> int:
    """In how many frames a seen state is not the true one that it mostly is."""
    return sum(len(own) - int(np.bincount(own).max()) for own in (true[seen == state] for state in np.unique(seen)))


def figures(dataset: Path, reasoners: Sequence[MechanismReasoner], assets: str, most: int) -> dict[str, Any]:
    """Of one dataset: what is seen wrongly, and F1 of links in each of `WAYS`, compared with what was seen."""
    mistakes: Counter[str] = Counter()
    counts: dict[str, list[np.ndarray]] = {way: [] for way in WAYS}
    recorded = Recorded.at(dataset, assets)
    for seen in recorded.boards(most):
        watched = Watched.at(seen)
        mistakes.update(watched.mistakes())
        for way, told in counts.items():
            told.append(np.sum([watched.counts(one, way) for one in reasoners], axis=0))
    found = {way: np.array(told) for way, told in counts.items()}
    ways = {way: compared(told, found[SEEN], SEED) for way, told in found.items()}
    return {"data": origin(recorded.dataset), "boards": len(found[SEEN]), "mistakes": dict(mistakes), "ways": ways}


def _reasoner(model: str) -> MechanismReasoner:
    reasoner = load_reasoner(model)
    if not isinstance(reasoner, MechanismReasoner):
        raise UsageError(f"{model}: a model {reasoner.name}", "name models `mechanism`")
    return reasoner


def main(words: Sequence[str] | None = None) -> None:
    options = runner.parser(__doc__)
    options.add_argument("--data", action="append", required=True, help="NAME=DATASET; several times")
    options.add_argument("--models", default="mechanism", help="shipped models' names and folders, comma-separated")
    options.add_argument("--boards", type=int, default=60, help="of each dataset, the first ones")
    arguments = options.parse_args(words)
    models = arguments.models.split(",")
    reasoners = [_reasoner(model) for model in models]
    named = runner.named(arguments.data, "--data")
    about = {"assets": runner.assets_name(arguments.assets)}
    rows = runner.told_rows(arguments.out, KIND, **about)
    hashes = {Path(model).name: file_hashes(find_folder(model, "reason")) for model in models}
    if rows.keys() - named.keys() and read_result(arguments.out, KIND)["hashes"]["models"] != hashes:
        raise UsageError(f"{arguments.out}: it has rows of other models", "name another file")
    for name, dataset in named.items():
        rows[name] = figures(Path(dataset), reasoners, arguments.assets, arguments.boards)
        print(name, rows[name]["mistakes"], {way: told["30"]["share"] for way, told in rows[name]["ways"].items()})
    runner.finish(KIND, arguments, {**about, "rows": rows}, hashes={"models": hashes}, seed=SEED)


if __name__ == "__main__":
    runner.one_of(main)
