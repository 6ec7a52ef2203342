"""The base of all networks that pass messages: PyTorch Geometric's, kept from writing files."""

from busybot.reason.pyg import MessagePassing


class GraphModule(MessagePassing):
    """`MessagePassing` along edges (2, P), sources in the first row and targets in the second.

    Nodes and edges stand in the first axis; frames, steps and numbers follow. Messages are summed by `scatter`, which
    adds them in the order of the edges on a CPU, so that equal inputs give equal sums in every run.

    PyTorch Geometric specialises `propagate` for every class by writing generated source to the folder for temporary
    files, and leaves it there. What it writes computes the same; here nothing is written, and no file is run that
    others may have put there.
    """

    def __init__(self, aggr: str | None = "sum"):
        super().__init__(aggr=aggr, node_dim=0)

    def _set_jittable_templates(self, raise_on_error: bool = False) -> None:
        """Do not generate source; a test looks whether files appear."""
