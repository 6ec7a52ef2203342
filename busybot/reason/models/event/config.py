"""Constants of the `event` model and its training."""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from busybot.common.frozen_model import FrozenModel
from busybot.training.loop import LoopConfig


class EventNetConfig(FrozenModel):
    """Size and structure of the networks.

    Attributes:
        width: of hidden layers.
        heads: of the attention over past contacts.
        exclusive: at most one trigger per responder, as on the paper's boards.
        inference: False is the ablation "w/o inference": no graph, every trigger is taken to control every responder,
            and what past contacts on it did says whether the next one changes anything.
    """

    width: Annotated[int, Field(ge=4, le=512)] = 32
    heads: Annotated[int, Field(ge=1, le=16)] = 4
    exclusive: bool = True
    inference: bool = True


class LossConfig(FrozenModel):
    """What is minimised (`loss`). Distances are in units of the smallest change.

    Attributes:
        blur: standard deviation of the bell around a look that is copied.
        unknown: likelihood of a look that nothing before resembles, if the model says that it will be new.
        floor: likelihood of what the model calls impossible.
        prior: probability of an edge that nothing is known of.
        divergence: weight of the edges' divergence from it.
    """

    blur: PositiveFloat = 0.5
    unknown: PositiveFloat = 0.02
    floor: PositiveFloat = 1e-4
    prior: Annotated[float, Field(gt=0, lt=1)] = 0.2
    divergence: NonNegativeFloat = 0.001


class EventConfig(FrozenModel):
    """Training the `event` model.

    Attributes:
        encoder: which features it reads.
        iterations: at most so many.
        batch: boards per iteration.
        learning_rate: at its highest; it rises over `warm_up` iterations and falls as a cosine to zero.
        weight_decay: of AdamW.
        clip: greatest norm of a gradient.
        images: how many are seen before steps are predicted: in half of the iterations, and when boards are judged. The
            other iterations draw a number, small ones more often.
        questions: at most so many of the following steps are predicted.
        noise: standard deviation of noise added to looks, drawn from 0 to this for each responder, in units of the
            smallest change.
    """

    model: Literal["event"] = "event"
    encoder: str = "embedded"
    iterations: Annotated[int, Field(ge=0)] = 1200
    batch: Annotated[int, Field(ge=1)] = 48
    learning_rate: PositiveFloat = 3e-3
    warm_up: Annotated[int, Field(ge=1)] = 20
    weight_decay: NonNegativeFloat = 1e-3
    clip: PositiveFloat = 1.0
    images: Annotated[int, Field(ge=2)] = 23
    questions: Annotated[int, Field(ge=1)] = 8
    noise: NonNegativeFloat = 0.2
    net: EventNetConfig = EventNetConfig()
    loss: LossConfig = LossConfig()
    loop: LoopConfig = LoopConfig()
