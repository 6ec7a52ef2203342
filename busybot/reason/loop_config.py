"""What the trainings of all models of relations share."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field


class LoopConfig(BaseModel):
    """How long a model of relations is trained (`fit`).

    Attributes:
        boards: train on the first so many that are not held out; None for all.
        held_out: share of the appearance groups that is never trained on.
        report: a line of metrics every so many iterations.
        judge: held-out boards are judged, and a checkpoint is written, every so many iterations.
        patience: the training ends when so many judgements in a row brought no better loss; 0 for never.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    boards: Annotated[int, Field(ge=1)] | None = None
    held_out: Annotated[float, Field(ge=0, lt=1)] = 0.1
    report: Annotated[int, Field(ge=1)] = 25
    judge: Annotated[int, Field(ge=1)] = 50
    patience: Annotated[int, Field(ge=0)] = 10
