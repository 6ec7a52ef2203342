"""Constants of the learned agents' trainings."""

from typing import Annotated, Literal, Self

from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, model_validator

from busybot.common.frozen_model import FrozenModel
from busybot.plan.learning.explore import BoardGraphConfig
from busybot.plan.learning.network import PolicyNetworkConfig
from busybot.training.loop import LoopConfig

Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(ge=0, le=1)]


class _Common(FrozenModel):
    """What both share.

    Attributes:
        iterations: at most so many.
        minutes: the training ends after so much time, those of interrupted runs counted as far as they are kept.
        learning_rate: at first; it falls linearly to zero.
        clip: greatest norm of a gradient.
        shuffle: whether objects come in another order in every rollout, so that boards cannot be told by it.
        explore: how boards are explored.
    """

    iterations: NonNegativeInt
    minutes: PositiveFloat = 45.0
    learning_rate: PositiveFloat
    clip: PositiveFloat
    shuffle: bool = True
    net: PolicyNetworkConfig = PolicyNetworkConfig()
    explore: BoardGraphConfig = BoardGraphConfig()

    def rate(self, iteration: int) -> float:
        """Learning rate of an iteration."""
        return self.learning_rate * (1 - iteration / self.iterations)


class BcConfig(_Common):
    """Behaviour cloning.

    Attributes:
        batch: rollouts per iteration.
        weight_decay: of AdamW.
        noise: share of the steps in which something else is done than the oracle says. What it says is imitated all the
            same: without noise an agent would never see what comes of a mistake.
    """

    agent: Literal["bc"] = "bc"
    iterations: NonNegativeInt = 8000
    learning_rate: PositiveFloat = 2e-3
    clip: PositiveFloat = 1.0
    batch: Count = 32
    weight_decay: NonNegativeFloat = 1e-3
    noise: Share = 0.2
    loop: LoopConfig = LoopConfig(judge=100, patience=15)


class PpoConfig(_Common):
    """Proximal policy optimisation. Constants that the paper does not tell are those of Stable-Baselines3, except for
    the sizes, the learning rate and the entropy.

    Attributes:
        iterations: each collects experience and learns from it.
        envs: environments that are played at once.
        steps: of each, per iteration; an episode has 31 for the history and at most 8 decisions.
        batch, epochs: how they are learned from.
        discount: of the reward per step.
        gae: lambda of the advantage estimates.
        clip_range: of the ratio of new and old policy.
        entropy, value: weights in the loss.
    """

    agent: Literal["ppo"] = "ppo"
    iterations: NonNegativeInt = 1300
    learning_rate: PositiveFloat = 5e-4
    clip: PositiveFloat = 0.5
    envs: Count = 16
    steps: Annotated[int, Field(ge=2)] = 156
    batch: Annotated[int, Field(ge=2)] = 624
    epochs: Count = 4
    discount: Share = 0.99
    gae: Share = 0.95
    clip_range: PositiveFloat = 0.2
    entropy: NonNegativeFloat = 0.02
    value: NonNegativeFloat = 0.5
    loop: LoopConfig = LoopConfig(report=5, judge=10, patience=0)

    @model_validator(mode="after")
    def _no_batch_of_one(self) -> Self:
        if self.envs * self.steps % self.batch == 1:  # advantages are normalised in each batch
            what = f"envs * steps = {self.envs * self.steps} leaves a last batch of one step, which has no spread"
            raise ValueError(f"{what}; choose another batch than {self.batch}")
        return self
