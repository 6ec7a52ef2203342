"""The trained `paper` networks as a `Reasoner`."""

import numpy as np
import torch
from torch import Tensor

from busybot.reason.paper_boards import Boards, Frames, boards_of, states_of
from busybot.reason.paper_networks import PaperNetwork
from busybot.reason.result import InferredGraph
from busybot.reason.sequence import Sequence


class PaperReasoner:
    """Judges one board at a time.

    Args:
        network: trained.
        encoder: which features it was trained on.
        threshold: an edge is claimed beyond this probability. 0.5 is the likelier type, as the authors have it.
    """

    name = "paper"

    def __init__(self, network: PaperNetwork, encoder: str, threshold: float = 0.5):
        self.network, self.encoder, self.threshold = network.eval(), encoder, threshold

    @torch.no_grad()
    def graph(self, seen: Sequence) -> InferredGraph:
        """Edge probabilities after each step, and from the first frame alone: the prior. Zeros but for candidates."""
        boards = self._boards(seen)
        beliefs = np.zeros((seen.steps + 1, *seen.candidates.shape))
        if len(boards.receivers):
            frames = boards.observed(seen.steps + 1)
            nodes, edges = self.network.spatial(boards.pairs, frames.states, None)
            for step in range(seen.steps + 1):
                known = slice(0, step + 1)
                relations = self.network.relate(boards.pairs, frames.first(step + 1), nodes[:, known], edges[:, known])
                beliefs[step] = self._matrix(boards, relations.probabilities, seen)
        return InferredGraph(self.name, beliefs[1:] if seen.steps else beliefs, self.threshold, beliefs[0])

    @torch.no_grad()
    def predict(self, seen: Sequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Features after each of S steps, as `Reasoner.predict`; what is no responder stays as it is."""
        boards = self._boards(seen)
        after = np.array(current, np.float32)
        if not len(boards.receivers) or not len(actions):
            return after
        on = boards.features.device
        features = boards.features.new_zeros(len(boards.positions), *current.shape[::2])
        features[: current.shape[1]] = torch.from_numpy(after).to(on).transpose(0, 1)
        frames = Frames(
            states_of(features, boards.positions),
            torch.from_numpy(np.asarray(actions, np.float32)).to(on)[None],
            torch.from_numpy(np.asarray(acted, np.int64)).to(on)[None],
        )
        relations = self.network.infer(boards.pairs, boards.observed(seen.steps + 1))
        predicted = self.network.predict(boards.pairs, frames, relations).transpose(0, 1).cpu().numpy()
        after[:, seen.responders] = predicted[:, : current.shape[1]][:, seen.responders]
        return after

    def _boards(self, seen: Sequence) -> Boards:
        return boards_of([seen], self.network.config).to(next(self.network.parameters()).device)

    @staticmethod
    def _matrix(boards: Boards, values: Tensor, seen: Sequence) -> np.ndarray:
        """(P,) as (N, N), trigger in the row, responder in the column."""
        count = sum(boards.sizes)
        matrix = np.zeros((count, count))
        matrix[boards.senders.cpu().numpy(), boards.receivers.cpu().numpy()] = values.cpu().numpy()
        return np.where(seen.candidates, matrix[: len(seen.positions), : len(seen.positions)], 0)
