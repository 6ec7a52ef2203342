"""Parameters of `busybot train interact`, with the values that were found to work."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from busybot.interact.explore import ExploreConfig
from busybot.interact.features import Inputs
from busybot.interact.fit_config import DirectionFitConfig, FitConfig
from busybot.interact.networks import CROP
from busybot.sim.interaction import InteractionConfig
from busybot.sim.render import RenderConfig

Iterations = Annotated[int, Field(ge=0, le=10_000_000)]


class _Plain(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class RecordConfig(_Plain):
    """How the data of a training are recorded, whatever learns from them.

    Attributes:
        inputs: what the networks see: `depth`, or `rgb` for the row "RGB" of Table 1.
        responders, interaction, render: of the simulator, as in `busybot collect`. Without responders a trigger's own
            motion is all that earns a reward (row "w/o responder"); `interaction.reward=joints` is the oracle's.
        group_size: boards that share one appearance. Reasoning wants 20 (paper section 3.2); here every board has its
            own, because where and how to act depends on nothing else.
        uniform: draw objects with equal probabilities instead of by their weights.
        images: encoding of recorded colours.
    """

    inputs: Inputs = "depth"
    responders: bool = True
    interaction: InteractionConfig = InteractionConfig()
    render: RenderConfig = RenderConfig()
    group_size: Annotated[int, Field(ge=1, le=10_000)] = 1
    uniform: bool = False
    images: Literal["jpeg", "png"] = "jpeg"


class Round(_Plain):
    """Collect with the current policy, then train on all that is there.

    Attributes:
        boards: new ones, of the training split.
        steps: proposed actions per board.
        position, direction: iterations of the two networks.
    """

    boards: Annotated[int, Field(ge=1, le=1_000_000)]
    steps: Annotated[int, Field(ge=1, le=1000)]
    position: Iterations
    direction: Iterations


ROUNDS = (
    Round(boards=240, steps=24, position=800, direction=1300),
    Round(boards=200, steps=14, position=800, direction=1300),
    Round(boards=200, steps=14, position=1400, direction=2400),
)
"""On two idle cores about half an hour, on a processor that multiplies bfloat16 half (docs/guides/interact.md)."""


STRICT = {"direction.augmentation.transposed": 0.0}
"""What has another default under `--strict`.

Switches are never turned (paper, appendix "Board Generation"), so no crop needs to be. Where one of 18 directions
counts, and not whatever moves the link, it tells a slider from a lever that the one lies and the other stands.
"""


class TrainConfig(RecordConfig):
    """A whole training of the `fast` variant.

    Attributes:
        variant: which networks.
        rounds: the first collects at random, each later one with the model of the one before.
        window: steps that the replay buffer holds; older ones are forgotten.
        validation: boards of the training split that are collected as in round 0 and never trained on; 0 for none.
        validation_steps: proposed actions on each.
        explore: who collects.
        position, direction: how the networks are trained.
    """

    variant: Literal["fast"] = "fast"
    rounds: Annotated[tuple[Round, ...], Field(min_length=1, max_length=1000)] = ROUNDS
    window: Annotated[int, Field(ge=1)] = 1_000_000
    validation: Annotated[int, Field(ge=0, le=100_000)] = 40
    validation_steps: Annotated[int, Field(ge=1, le=1000)] = 24
    explore: ExploreConfig = ExploreConfig()
    position: FitConfig = FitConfig()
    direction: DirectionFitConfig = DirectionFitConfig()

    @model_validator(mode="after")
    def _sides(self) -> "TrainConfig":
        if self.direction.side != CROP:
            raise ValueError(f"direction.side: the direction network takes crops of {CROP} pixels")
        if self.direction.jitter:
            raise ValueError("direction.jitter: the direction network looks at the middle of its crop; leave it at 0")
        for name in ("dropout", "direction_weight"):
            if getattr(self.position, name) != FitConfig.model_fields[name].default:
                raise ValueError(f"position.{name}: only the direction network has it; set direction.{name}")
        return self
