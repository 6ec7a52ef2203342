"""Parameters of `busybot train interact --model paper`; the defaults are the paper's (appendix A.1 "Training detail").

What the paper leaves open, and what is chosen here:

- Epochs are counted from 0: "the first 10" are 0 to 9, "training starts at the 10th" is epoch 10.
- From epoch 100 to 119 nothing is trained: the text has the position network trained "in the first 100 epochs" and
  both "starting from the 120th epoch", and in between data are collected.
- Learning rates stay as they are: the text calls them initial and names no schedule.
- A reward is more than 500 changed pixels, as everywhere here (the paper: 1000), and every board has an appearance of
  its own (`group_size`): where and how to act depends on nothing else.
- While the buffer has no action with reward, or none without, no batch can be half positive: the iterations of that
  epoch are left out.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from busybot.common.frozen_model import FrozenModel
from busybot.interact.affordance.fast_networks import KINDS, Kind
from busybot.interact.training.config import RecordConfig

Epochs = Annotated[int, Field(ge=0, le=100_000)]


class LearnConfig(FrozenModel):
    """How one network is trained.

    Attributes:
        batch: samples per iteration, half of them with reward.
        iterations: per epoch.
        learning_rate: of Adam.
        epsilon_epochs: the share of random choices falls from 1 to its lowest value in so many epochs, from the one in
            which the training starts.
    """

    batch: Annotated[int, Field(ge=2, le=4096, multiple_of=2)]
    iterations: Annotated[int, Field(ge=0, le=100_000)]
    learning_rate: Annotated[float, Field(gt=0)]
    epsilon_epochs: Annotated[int, Field(ge=1, le=100_000)]


POSITION = LearnConfig(batch=16, iterations=8, learning_rate=5e-4, epsilon_epochs=40)
DIRECTION = LearnConfig(batch=32, iterations=24, learning_rate=1e-4, epsilon_epochs=80)


class PaperConfig(RecordConfig):
    """A whole training of the `paper` variant.

    Attributes:
        variant: which networks.
        epochs: each collects data, then trains.
        boards: new ones in each epoch.
        steps: proposed actions per board.
        random_epochs: so many epochs choose random positions; then the position network's training starts.
        all_directions_epochs: until this epoch all directions are tried at a position, and only the position network
            is trained; from then on one direction is executed (with its opposite).
        joint_epochs: until this epoch the direction is random; from then on both networks are trained.
        epsilon_lowest: the share of random choices that remains.
        buffer: steps that the replay buffer holds, first in, first out.
        ucb_c, ucb_window: of the bonus for places that were not picked yet; the window's side in pixels, even.
        position, direction: how the networks are trained.
        checkpoint: iterations after which a checkpoint is written, beside the one at the end of an epoch.
        threads: of PyTorch on a CPU; the order of sums, and so the last bits of the weights, depend on it.
    """

    variant: Literal["paper"] = "paper"
    epochs: Annotated[int, Field(ge=1, le=100_000)] = 400
    boards: Annotated[int, Field(ge=1, le=1_000_000)] = 16
    steps: Annotated[int, Field(ge=1, le=1000)] = 10
    random_epochs: Epochs = 10
    all_directions_epochs: Epochs = 100
    joint_epochs: Epochs = 120
    epsilon_lowest: Annotated[float, Field(ge=0, le=1)] = 0.1
    buffer: Annotated[int, Field(ge=2)] = 6400
    ucb_c: Annotated[float, Field(ge=0)] = 0.5
    ucb_window: Annotated[int, Field(ge=2, le=200, multiple_of=2)] = 10
    position: LearnConfig = POSITION
    direction: LearnConfig = DIRECTION
    checkpoint: Annotated[int, Field(ge=1)] = 8
    threads: Annotated[int, Field(ge=1, le=1024)] = 2

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, values: object) -> object:
        """`--set position.batch=4` leaves the network's other values at the paper's."""
        if not isinstance(values, dict):
            return values
        named = {"position": POSITION, "direction": DIRECTION}
        given = {kind: values[kind] for kind in named if isinstance(values.get(kind), dict)}
        return values | {kind: named[kind].model_dump() | value for kind, value in given.items()}

    @model_validator(mode="after")
    def _in_order(self) -> "PaperConfig":
        if not self.random_epochs <= self.all_directions_epochs <= self.joint_epochs:
            raise ValueError("random_epochs, all_directions_epochs and joint_epochs must not fall")
        return self

    def learn(self, kind: Kind) -> LearnConfig:
        """How a network is trained."""
        return self.position if kind == "position" else self.direction

    def trained(self, epoch: int) -> tuple[Kind, ...]:
        """The networks that are trained in an epoch."""
        if epoch >= self.joint_epochs:
            return KINDS
        return ("position",) if self.random_epochs <= epoch < self.all_directions_epochs else ()

    def tries_all_directions(self, epoch: int) -> bool:
        """Whether an epoch's actions try all directions until one works."""
        return epoch < self.all_directions_epochs

    def epsilon(self, kind: Kind, epoch: int) -> float:
        """Share of random positions or directions while an epoch's data are collected."""
        since = epoch - (self.random_epochs if kind == "position" else self.joint_epochs)
        fallen = 1 - (1 - self.epsilon_lowest) * since / self.learn(kind).epsilon_epochs
        return min(1.0, max(self.epsilon_lowest, fallen))
