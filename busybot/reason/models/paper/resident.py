"""All boards of a training on its device, in one list of nodes and one of pairs; batches are gathered there.

Reading 64 recordings and joining their graphs takes longer than a GPU takes to learn from them. Here the features of
all frames lie where the networks are (10,000 boards of 30 steps: 3.2 GB), and what an iteration needs of the host are
the numbers of its rows.
"""

from collections.abc import Iterable

import numpy as np
import torch
from torch import Tensor

from busybot.reason.models.paper.data import Boards


class ResidentBoards:
    """Boards, of which batches can be asked for.

    Args:
        parts: all of them in their order, some at once, where they are to stay.
    """

    def __init__(self, parts: Iterable[Boards]):
        boards = self._boards = joined(list(parts))
        self._nodes = np.array(boards.sizes, np.int64)
        board_of = torch.from_numpy(np.repeat(np.arange(len(self._nodes)), self._nodes))
        pairs = board_of[boards.edge_index[1].cpu()]
        self._pairs = np.bincount(pairs.numpy(), minlength=len(self._nodes))

    def batch(self, chosen: np.ndarray) -> Boards:
        """The chosen boards in their order, equal to what `data.boards_of` makes of them."""
        whole, on = self._boards, self._boards.features.device
        nodes, _, moved = rows_of(self._nodes, chosen)
        pairs, board_of_pair, _ = rows_of(self._pairs, chosen)

        def there(values: np.ndarray) -> Tensor:
            return torch.from_numpy(values).to(on)

        at_nodes, boards = there(nodes), there(np.asarray(chosen, np.int64))
        actors = whole.actors[boards]
        return Boards(
            features=whole.features[at_nodes],
            positions=whole.positions[at_nodes],
            actions=whole.actions[boards],
            actors=actors - (actors >= 0) * there(moved)[:, None],
            responders=whole.responders[at_nodes],
            edge_index=whole.edge_index[:, there(pairs)] - there(moved[board_of_pair]),
            sizes=tuple(self._nodes[chosen].tolist()),
        )


def joined(parts: list[Boards]) -> Boards:
    """The boards of all parts in one list."""
    starts = np.cumsum([0, *(len(part.positions) for part in parts)])

    def together(name: str) -> Tensor:
        return torch.cat([getattr(part, name) for part in parts])

    actors = [part.actors + (part.actors >= 0) * int(start) for part, start in zip(parts, starts, strict=False)]
    pairs = [part.edge_index + int(start) for part, start in zip(parts, starts, strict=False)]
    return Boards(
        features=together("features"),
        positions=together("positions"),
        actions=together("actions"),
        actors=torch.cat(actors),
        responders=together("responders"),
        edge_index=torch.cat(pairs, dim=1),
        sizes=tuple(size for part in parts for size in part.sizes),
    )


def rows_of(counts: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of the chosen boards in a list in which each board has so many rows, one board after the other.

    Returns:
        int64 (R,), the rows; int64 (R,), the place in `chosen` of each row's board; int64 (B,), how far the rows of
        each chosen board move to the front when only the chosen ones are listed.
    """
    many = counts[chosen]
    place = np.repeat(np.arange(len(chosen)), many)
    moved = (np.cumsum(counts) - counts)[chosen] - (np.cumsum(many) - many)
    return moved[place] + np.arange(len(place)), place, moved
