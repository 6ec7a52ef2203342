"""Constants of the `event` model and its training."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
Weight = Annotated[float, Field(ge=0)]


class _Plain(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class NetConfig(_Plain):
    """Size and structure of the networks.

    Attributes:
        width: of hidden layers.
        heads: of the attention over past contacts.
        exclusive: at most one trigger per responder, as on the paper's boards.
    """

    width: Annotated[int, Field(ge=4, le=512)] = 32
    heads: Annotated[int, Field(ge=1, le=16)] = 4
    exclusive: bool = True


class LossConfig(_Plain):
    """What is minimised (`event_loss`). Distances are in units of the smallest change.

    Attributes:
        blur: standard deviation of the bell around a look that is copied.
        unknown: likelihood of a look that nothing before resembles, if the model says that it will be new.
        floor: likelihood of what the model calls impossible.
        prior: probability of an edge that nothing is known of.
        divergence: weight of the edges' divergence from it.
    """

    blur: Positive = 0.5
    unknown: Positive = 0.02
    floor: Positive = 1e-4
    prior: Annotated[float, Field(gt=0, lt=1)] = 0.2
    divergence: Weight = 0.01
