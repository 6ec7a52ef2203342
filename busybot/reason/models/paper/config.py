"""Parameters of the `paper` model of relations; the defaults are the paper's (section 4.2 and appendix A.1).

What the paper leaves open, and what is chosen here. The paper builds on V-CDN; where its text is silent, the choice
follows V-CDN (docs/reference/departures.md has what the authors' program is known to do):

- `hidden`, `convolution`, `recurrent`: widths inside of the networks.
- `kernel`: the convolution over time looks at one frame; pooling and the maximum over time bring frames together.
- `normalise`: batch normalisation closes every group of layers (after the ReLU). The text names linear layers and ReLU
  only.
- `dropout`: between the two layers of the recurrent network.
- `temperature`: Gumbel-softmax edges are soft, at temperature 1.
- `explosion`: an iteration is left out when its loss is not below twice the loss of the last one that was not.

The paper's schedule in figures: 10,000 boards, 200 epochs of 157 batches.
"""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from busybot.common.frozen_model import FrozenModel
from busybot.training.loop import LoopConfig

Width = Annotated[int, Field(ge=1, le=65_536)]
Images = Annotated[int, Field(ge=2, le=10_000)]


class PaperNetworkConfig(FrozenModel):
    """The graph networks.

    Attributes:
        objects: a board with fewer has so many nodes; the vacant ones are zeros.
        pairs: `all` connects all nodes, as the paper does; `candidates` only triggers to responders, which is what
            relations are between. That leaves about a sixth of the pairs, and no vacant nodes.
        embedding: numbers of a spatial embedding, and of all others within.
        edge_embedding: numbers that say how an edge acts.
        action: width of the three layers that embed an action.
        hidden: width of the graph networks' layers.
        edge_layers: linear layers for edges in a propagation step.
        node_layers: for nodes.
        convolution: channels within the convolution over time.
        kernel: frames that it looks at, odd.
        recurrent: width of the recurrent network.
        dropout: share of its numbers left out in training.
        normalise: normalise batches.
        temperature: of the Gumbel-softmax.
        residual: predict the change of the features instead of the features. Not the paper's.
    """

    objects: Annotated[int, Field(ge=0, le=1000)] = 10
    pairs: Literal["all", "candidates"] = "all"
    embedding: Width = 128
    edge_embedding: Width = 32
    action: Width = 256
    hidden: Width = 384
    edge_layers: Annotated[int, Field(ge=1, le=16)] = 4
    node_layers: Annotated[int, Field(ge=1, le=16)] = 2
    convolution: Width = 512
    kernel: Annotated[int, Field(ge=1, le=99)] = 1
    recurrent: Width = 256
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.2
    normalise: bool = True
    temperature: Annotated[float, Field(gt=0)] = 1.0
    residual: bool = False

    @field_validator("kernel")
    @classmethod
    def _odd(cls, kernel: int) -> int:
        if not kernel % 2:
            raise ValueError("must be odd, so that the middle is a frame")
        return kernel


class PaperLoopConfig(LoopConfig):
    """The paper trains on all boards to the end of the schedule. Iterations take seconds, so fewer lie between reports.

    A share held out gives a curve on boards that were not trained on, and keeps the best weights instead of the last.
    """

    held_out: Annotated[float, Field(ge=0, lt=1)] = 0.0
    report: Annotated[int, Field(ge=1)] = 5
    judge: Annotated[int, Field(ge=1)] = 20
    patience: Annotated[int, Field(ge=0)] = 0


class PaperReasonConfig(FrozenModel):
    """A whole training of the `paper` model.

    Attributes:
        encoder: which features it reads; `resnet50` are the paper's, `resnet50-centre` those of its authors' program.
        threads: of PyTorch on a CPU; the order of sums, and so the last bits of the weights, depend on it.
        loop: how the schedule is reported and judged.
        network: the graph networks.
        inference: False is the ablation "w/o inference" (`PaperHistoryNetwork`).
        images: the graph is inferred from so many first frames; the steps after the last of them are predicted.
        observed: in training it is inferred from one of these numbers of frames, drawn for each iteration; none for
            `images` in all of them. The authors' program has 22 and 23.
        steps: in training so many steps after these frames are predicted, each from its true frame; 0 for all that were
            recorded. The authors' program has 6.
        epochs: times that every board is seen.
        batch: boards per iteration.
        learning_rate: of Adam.
        explosion: an iteration's loss must be below so many times that of the last iteration that was not left out.
        prior: share of pairs expected to be related.
        prior_weight: of the edges' divergence from that prior, beside the mean squared error; 0 in the paper.
        bfloat16: multiply matrices in bfloat16 on a CPU, too; GPUs that can do so anyway.
    """

    model: Literal["paper"] = "paper"
    encoder: str = "resnet50"
    network: PaperNetworkConfig = PaperNetworkConfig()
    inference: bool = True
    images: Images = 23
    observed: tuple[Images, ...] = ()
    steps: Annotated[int, Field(ge=0, le=10_000)] = 0
    epochs: Annotated[int, Field(ge=1, le=1_000_000)] = 200
    batch: Annotated[int, Field(ge=2, le=65_536)] = 64
    learning_rate: Annotated[float, Field(gt=0)] = 5e-4
    explosion: Annotated[float, Field(gt=1)] = 2.0
    prior: Annotated[float, Field(gt=0, lt=1)] = 0.5
    prior_weight: Annotated[float, Field(ge=0)] = 0.0
    bfloat16: bool = False
    threads: Annotated[int, Field(ge=1, le=1024)] = 2
    loop: PaperLoopConfig = PaperLoopConfig()
