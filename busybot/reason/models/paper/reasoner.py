"""The trained `paper` networks as a `Reasoner`, with inference and without."""

from collections.abc import Iterator
from typing import Protocol

import numpy as np
import torch
from torch import Tensor, nn

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.base import InferredGraph
from busybot.reason.models.paper.config import PaperNetworkConfig
from busybot.reason.models.paper.data import Boards, Frames, boards_of, states_of
from busybot.reason.models.paper.networks import PaperHistoryNetwork, PaperNetwork


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
    def graph(self, seen: BoardSequence) -> InferredGraph:
        """Edge probabilities after each step, and from the first frame alone: the prior. Zeros but for candidates."""
        boards = board_of(seen, self.network)
        beliefs = np.zeros((seen.steps + 1, *seen.candidates.shape))
        if boards.edge_index.shape[1]:
            frames = boards.observed(seen.steps + 1)
            nodes, edges = self.network.spatial(boards.edge_index, frames.states, None)
            for step in range(seen.steps + 1):
                known = slice(0, step + 1)
                relations = self.network.relate(
                    boards.edge_index, frames.first(step + 1), nodes[:, known], edges[:, known]
                )
                beliefs[step] = _matrix(boards, relations.probabilities, seen)
        return InferredGraph(self.name, beliefs[1:] if seen.steps else beliefs, self.threshold, beliefs[0])

    @torch.no_grad()
    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Features after each of S steps, as `Reasoner.predict`; what is no responder stays as it is."""
        return predicted_features(self.network, seen, current, actions, acted)


class PaperHistoryReasoner:
    """The ablation as a `Reasoner`: claims no relation.

    Args:
        network: trained.
        encoder: which features it was trained on.
    """

    name = "paper without inference"

    def __init__(self, network: PaperHistoryNetwork, encoder: str):
        self.network, self.encoder = network.eval(), encoder

    def graph(self, seen: BoardSequence) -> InferredGraph:
        """No relations."""
        return InferredGraph(self.name, np.zeros((max(1, seen.steps), *seen.candidates.shape)))

    @torch.no_grad()
    def predict(self, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> np.ndarray:
        """Features after each of S steps, as `Reasoner.predict`; what is no responder stays as it is."""
        return predicted_features(self.network, seen, current, actions, acted)


class StepPredictor(Protocol):
    """A network that predicts steps (S of them on one board) from what was observed and the frames before them."""

    config: PaperNetworkConfig

    def foresee(self, edge_index: Tensor, observed: Frames, frames: Frames) -> Tensor:
        """Features after each frame's action, (M, S, 256)."""
        ...

    def parameters(self) -> Iterator[nn.Parameter]:
        """As every module has them."""
        ...


def predicted_features(
    network: StepPredictor, seen: BoardSequence, current: np.ndarray, actions: np.ndarray, acted: np.ndarray
) -> np.ndarray:
    """What `Reasoner.predict` returns: predictions for responders, everything else as it is in `current`."""
    after = np.array(current, np.float32)
    boards = board_of(seen, network)
    if not boards.edge_index.shape[1] or not len(actions):
        return after
    frames = imagined(boards, after, actions, acted)
    predicted = network.foresee(boards.edge_index, boards.observed(seen.steps + 1), frames)  # (M, S, 256)
    after[:, seen.responders] = predicted.transpose(0, 1).cpu().numpy()[:, np.flatnonzero(seen.responders)]
    return after


def board_of(seen: BoardSequence, network: StepPredictor) -> Boards:
    """One board, where the network is."""
    return boards_of([seen], network.config).to(next(network.parameters()).device)


def imagined(boards: Boards, current: np.ndarray, actions: np.ndarray, acted: np.ndarray) -> Frames:
    """Steps on one board: features before each, float32 (S, N, 256), actions (S, 6) and what is acted on (S,)."""
    on = boards.features.device
    features = boards.features.new_zeros(len(boards.positions), len(actions), current.shape[-1])
    features[: current.shape[1]] = torch.from_numpy(current).to(on).transpose(0, 1)
    return Frames(
        states_of(features, boards.positions),
        torch.from_numpy(np.array(actions, np.float32)).to(on)[None],
        torch.from_numpy(np.array(acted, np.int64)).to(on)[None],
    )


def _matrix(boards: Boards, values: Tensor, seen: BoardSequence) -> np.ndarray:
    """(P,) of one board as (N, N), trigger in the row and responder in the column; zeros but for candidates."""
    count = len(seen.positions)
    matrix = np.zeros((len(boards.positions), len(boards.positions)))
    matrix[tuple(boards.edge_index.cpu().numpy())] = values.cpu().numpy()
    return np.where(seen.candidates, matrix[:count, :count], 0)
