"""Constants of training the `fast` networks: plain data that worker processes get."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]


class _Plain(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Augmentation(_Plain):
    """How crops are varied.

    Attributes:
        scaled: share of batches that are scaled by exp(uniform(-log_scale, log_scale)) and stretched along one axis at
            the other's cost by exp(uniform(-log_stretch, log_stretch)).
        log_height: heights of each crop are multiplied by exp(uniform(-log_height, log_height)).
        transposed: share of crops with rows and columns swapped; with the mirrors, of which each happens to half of the
            crops, this gives all quarter turns.
        colour: standard deviation of the gain per colour channel, and of twice its offset (RGB variant).
    """

    scaled: Share = 0.7
    log_scale: Annotated[float, Field(ge=0, le=0.5)] = 0.25
    log_stretch: Annotated[float, Field(ge=0, le=0.5)] = 0.3
    log_height: Annotated[float, Field(ge=0, le=1)] = 0.3
    transposed: Share = 0.35
    colour: Annotated[float, Field(ge=0, le=1)] = 0.2


class Replay(_Plain):
    """Which samples are shown (`interact.replay`).

    Attributes:
        positives: share of a batch with reward.
        initial: priority of a sample that was never shown, as a loss.
        memory: share of the old priority that stays when a new loss is seen.
        highest_loss: losses are clipped to this before they enter the priority.
        lowest, highest: priorities are clipped to this range when samples are drawn.
        later_rounds: weight of failures of later rounds beside those of the first one: the current policy's own
            mistakes.
    """

    positives: Annotated[float, Field(gt=0, lt=1)] = 0.5
    initial: Positive = 0.4
    memory: Share = 0.5
    highest_loss: Positive = 3.0
    lowest: Positive = 0.04
    highest: Positive = 1.5
    later_rounds: Positive = 5.0


class FitConfig(_Plain):
    """One network's training; the defaults are the position network's.

    Attributes:
        batch: samples per iteration.
        side: of the crops, pixels.
        jitter: crops are moved by up to so many pixels along each axis.
        learning_rate: at its highest; it rises over `warm_up` iterations and falls as a cosine to zero, in each round.
        weight_decay: of AdamW.
        dropout: of the direction network's hidden layer.
        direction_weight: of the directions' loss beside the position's (direction network).
        bfloat16: multiply matrices in bfloat16 (autocast), twice as fast on processors that can; None: where they can.
        report: a line of metrics every so many iterations.
        checkpoint: a checkpoint every so many iterations.
    """

    batch: Annotated[int, Field(ge=2, le=4096)] = 32
    side: Annotated[int, Field(ge=16, le=128, multiple_of=16)] = 96
    jitter: Annotated[int, Field(ge=0, le=64)] = 24
    learning_rate: Positive = 2e-3
    warm_up: Annotated[int, Field(ge=1)] = 30
    weight_decay: Annotated[float, Field(ge=0)] = 1e-3
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.0
    direction_weight: Annotated[float, Field(ge=0)] = 2.0
    bfloat16: bool | None = None
    report: Annotated[int, Field(ge=1)] = 50
    checkpoint: Annotated[int, Field(ge=1)] = 250
    augmentation: Augmentation = Augmentation()
    replay: Replay = Replay()


class DirectionFitConfig(FitConfig):
    """The direction network's training: the position stays in the middle of the crop."""

    batch: Annotated[int, Field(ge=2, le=4096)] = 64
    side: Annotated[int, Field(ge=16, le=128, multiple_of=16)] = 64
    jitter: Annotated[int, Field(ge=0, le=64)] = 0
    weight_decay: Annotated[float, Field(ge=0)] = 1e-2
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.2
