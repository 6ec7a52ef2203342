"""The base of all networks that pass messages: PyTorch Geometric's, kept from writing files."""

from torch import Tensor

from busybot.reason.pyg import MessagePassing


class GraphModule(MessagePassing):
    """`MessagePassing` along edges (2, P), sources in the first row and targets in the second.

    Nodes and edges stand in the first axis; frames, steps and numbers follow. Messages are added in the order of the
    edges, so that equal inputs give equal sums in every run.

    PyTorch Geometric specialises `propagate` for every class by writing generated source to the folder for temporary
    files, and leaves it there. What it writes computes the same; here nothing is written, and no file is run that
    others may have put there.
    """

    def __init__(self, aggr: str | None = "sum"):
        super().__init__(aggr=aggr, node_dim=0)

    def aggregate(self, inputs: Tensor, index: Tensor, dim_size: int) -> Tensor:
        """Sums of whole rows: PyTorch Geometric's `scatter` gives the same, but number by number, which takes twice as
        long on a CPU, and on a GPU whose sums are to repeat a sort of all the numbers."""
        return inputs.new_zeros(dim_size, *inputs.shape[1:]).index_add_(0, index, inputs)

    def _set_jittable_templates(self, raise_on_error: bool = False) -> None:
        """Do not generate source; a test looks whether files appear."""
