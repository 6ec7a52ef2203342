"""Connected nodes, and the linear algebra that makes the paper's graph networks fast.

A linear map of (receiver, sender, edge) falls into three parts,

    W [n_i; n_j; e_ij] = W_r n_i + W_s n_j + W_e e_ij

so that nodes are multiplied once each, not once for every edge.
"""

from torch import Tensor
from torch.nn import functional
from torch_geometric.utils import scatter


class Pairs:
    """Connected nodes.

    Args:
        receivers: int64 (P,).
        senders: int64 (P,).
        nodes: how many nodes there are.
    """

    def __init__(self, receivers: Tensor, senders: Tensor, nodes: int):
        self.receivers, self.senders, self.nodes = receivers, senders, nodes

    def ends(self, received: Tensor, sent: Tensor) -> Tensor:
        """What every pair's receiver and sender have, added: (M, ...), (M, ...) -> (P, ...)."""
        return received.index_select(0, self.receivers) + sent.index_select(0, self.senders)

    def gather(self, messages: Tensor) -> Tensor:
        """Sum of the messages that reach each node: (P, ...) -> (M, ...)."""
        return scatter(messages, self.receivers, dim=0, dim_size=self.nodes, reduce="sum")

    def linear(self, weight: Tensor, bias: Tensor, nodes: Tensor, edges: Tensor | None) -> Tensor:
        """A linear map of (receiver, sender, edge).

        Shapes:
            weight: (H, 2 D + E).
            nodes: (M, F, D).
            edges: (P, F, E).
            output: (P, F, H).
        """
        width = nodes.shape[-1]
        received, sent, own = weight.split([width, width, weight.shape[1] - 2 * width], 1)
        result = self.ends(functional.linear(nodes, received, bias), functional.linear(nodes, sent))
        return result if edges is None else result + functional.linear(edges, own)
