"""Parameters of `busybot train interact`, plain data that worker processes get.

Those of the `fast` variant have the values that were found to work, those of the `paper` variant the paper's (appendix
A.1 "Training detail"). What the paper leaves open, and what is chosen here:

- Epochs are counted from 0: "the first 10" are 0 to 9, "training starts at the 10th" is epoch 10.
- From epoch 100 to 119 nothing is trained: the text has the position network trained "in the first 100 epochs" and
  both "starting from the 120th epoch", and in between data are collected.
- The learning rates that the text calls initial fall as the authors' do, counted from the epoch in which a network's
  training starts.
- A reward is more than 500 changed pixels, as everywhere here (the authors' program: 1000), and every board has an
  appearance of its own (`group_size`): where and how to act depends on nothing else.
- While the buffer has no action with reward, or none without, no batch can be half positive: the iterations of that
  epoch are left out.

docs/reference/departures.md has all of them, with what the authors' program does.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from busybot.common.frozen_model import FrozenModel
from busybot.interact.affordance.networks import CROP, KINDS, LEAST_SIDE, Kind, Networks
from busybot.interact.policy.config import Inputs, Share
from busybot.interact.policy.exploration import ExplorationConfig
from busybot.interact.policy.paper import PaperRules
from busybot.sim.interaction import InteractionConfig
from busybot.sim.scene.render import RenderConfig

Positive = Annotated[float, Field(gt=0)]


class Augmentation(FrozenModel):
    """How crops are varied.

    Attributes:
        scaled: share of batches that are scaled by exp(uniform(-log_scale, log_scale)) and stretched along one axis at
            the other's cost by exp(uniform(-log_stretch, log_stretch)).
        log_height: heights of each crop are multiplied by exp(uniform(-log_height, log_height)) (depth).
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


class ReplayConfig(FrozenModel):
    """Which samples are shown (`interact.training.fast_learner`).

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


class FitConfig(FrozenModel):
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
    replay: ReplayConfig = ReplayConfig()


class DirectionFitConfig(FitConfig):
    """The direction network's training: the position stays in the middle of the crop."""

    batch: Annotated[int, Field(ge=2, le=4096)] = 64
    side: Annotated[int, Field(ge=16, le=128, multiple_of=16)] = 64
    jitter: Annotated[int, Field(ge=0, le=64)] = 0
    weight_decay: Annotated[float, Field(ge=0)] = 1e-2
    dropout: Annotated[float, Field(ge=0, lt=1)] = 0.2


Iterations = Annotated[int, Field(ge=0, le=10_000_000)]


class RecordConfig(FrozenModel):
    """How the data of a training are recorded, whatever learns from them.

    Attributes:
        inputs: what the networks see: `depth`, or `rgb` for the row "RGB" of Table 1.
        responders, interaction, render: of the simulator, as in `busybot collect`. Without responders a trigger's own
            motion is all that earns a reward (row "w/o responder"); `interaction.reward=joints` is the oracle's.
        group_size: boards that share one appearance. Reasoning wants 20 (paper section 4.2); here every board has its
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

    @model_validator(mode="after")
    def _one_camera(self) -> Self:
        drawn = self.render.randomise
        if drawn.pose or drawn.fov:  # it is told only once there are recordings, which take long
            raise ValueError("render.randomise.pose and fov draw a camera for each board, and the networks know of one")
        return self


class Round(FrozenModel):
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
    Round(boards=240, steps=24, position=800, direction=900),
    Round(boards=200, steps=14, position=800, direction=900),
    Round(boards=200, steps=14, position=1400, direction=1600),
)
"""On two cores a quarter of an hour on a processor that multiplies bfloat16 (docs/results/interact.md)."""


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
        networks: how large the position network is: `lean`, or `wide` as in the models before it.
        position, direction: how the networks are trained.
    """

    variant: Literal["fast"] = "fast"
    networks: Networks = "lean"
    rounds: Annotated[tuple[Round, ...], Field(min_length=1, max_length=1000)] = ROUNDS
    window: Annotated[int, Field(ge=1)] = 1_000_000
    validation: Annotated[int, Field(ge=0, le=100_000)] = 40
    validation_steps: Annotated[int, Field(ge=1, le=1000)] = 24
    explore: ExplorationConfig = ExplorationConfig()
    position: FitConfig = FitConfig()
    direction: DirectionFitConfig = DirectionFitConfig()

    def learn(self, kind: Kind) -> FitConfig:
        """How a network is trained."""
        return self.position if kind == "position" else self.direction

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

    @model_validator(mode="after")
    def _seen(self) -> "TrainConfig":
        unseen, what = ("colour", "no colours") if self.inputs == "depth" else ("log_height", "no heights")
        for kind in KINDS:
            if getattr(self.learn(kind).augmentation, unseen) != Augmentation.model_fields[unseen].default:
                name = f"{kind}.augmentation.{unseen}"
                raise ValueError(f"{name}: with inputs={self.inputs} the networks see {what}; leave it out")
        return self


Epochs = Annotated[int, Field(ge=0, le=100_000)]


class LearnConfig(FrozenModel):
    """How one network is trained; the defaults are the position network's.

    Attributes:
        batch: samples per iteration, half of them with reward.
        iterations: per epoch.
        learning_rate: of Adam, at first.
        rate_factor, rate_epochs: it is multiplied by this every so many epochs, from the one in which the training
            starts; the authors' values.
        epsilon_epochs: the share of random choices falls from 1 to its lowest value in so many epochs, from the one in
            which the training starts.
    """

    batch: Annotated[int, Field(ge=2, le=4096, multiple_of=2)] = 16
    iterations: Epochs = 8
    learning_rate: Positive = 5e-4
    rate_factor: Annotated[float, Field(gt=0, le=1)] = 0.5
    rate_epochs: Annotated[int, Field(ge=1, le=100_000)] = 90
    epsilon_epochs: Annotated[int, Field(ge=1, le=100_000)] = 40


class DirectionLearnConfig(LearnConfig):
    """How the direction network is trained."""

    batch: Annotated[int, Field(ge=2, le=4096, multiple_of=2)] = 32
    iterations: Epochs = 24
    learning_rate: Positive = 1e-4
    rate_factor: Annotated[float, Field(gt=0, le=1)] = 0.7
    rate_epochs: Annotated[int, Field(ge=1, le=100_000)] = 75
    epsilon_epochs: Annotated[int, Field(ge=1, le=100_000)] = 80


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
        settled_rate: the position network's learning rate once all directions are no longer tried (the authors').
        epsilon_lowest: the share of random choices that remains.
        buffer: steps that the replay buffer holds, first in, first out.
        ucb_c, ucb_window: of the bonus for places that were not picked yet; the window's side in pixels, even.
        position, direction: how the networks are trained.
        checkpoint: iterations after which a checkpoint is written, beside the one at the end of an epoch.
        threads: of PyTorch on a CPU; the order of sums, and so the last bits of the weights, depend on it.
        bfloat16: multiply matrices in bfloat16 (autocast), twice as fast on processors that can; None: where they can.
    """

    variant: Literal["paper"] = "paper"
    epochs: Annotated[int, Field(ge=1, le=100_000)] = 400
    boards: Annotated[int, Field(ge=1, le=1_000_000)] = 16
    steps: Annotated[int, Field(ge=1, le=1000)] = 10
    random_epochs: Epochs = 10
    all_directions_epochs: Epochs = 100
    joint_epochs: Epochs = 120
    settled_rate: Positive = 1e-6
    epsilon_lowest: Share = 0.1
    buffer: Annotated[int, Field(ge=2)] = 6400
    ucb_c: Annotated[float, Field(ge=0)] = 0.5
    ucb_window: Annotated[int, Field(ge=2, le=200, multiple_of=2)] = 10
    position: LearnConfig = LearnConfig()
    direction: DirectionLearnConfig = DirectionLearnConfig()
    checkpoint: Annotated[int, Field(ge=1)] = 8
    threads: Annotated[int, Field(ge=1, le=1024)] = 2
    bfloat16: bool | None = None

    @model_validator(mode="after")
    def _in_order(self) -> "PaperConfig":
        if not self.random_epochs <= self.all_directions_epochs <= self.joint_epochs:
            raise ValueError("random_epochs, all_directions_epochs and joint_epochs must not fall")
        return self

    @model_validator(mode="after")
    def _large_enough(self) -> "PaperConfig":
        if min(self.render.width, self.render.height) < LEAST_SIDE:  # the direction network is asked epochs later
            raise ValueError(f"render: networks of the paper variant need pictures of {LEAST_SIDE} pixels a side")
        return self

    def learn(self, kind: Kind) -> LearnConfig:
        """How a network is trained."""
        return self.position if kind == "position" else self.direction

    def trained(self, epoch: int) -> tuple[Kind, ...]:
        """The networks that are trained in an epoch."""
        if epoch >= self.joint_epochs:
            return KINDS
        return ("position",) if self.random_epochs <= epoch < self.all_directions_epochs else ()

    def since(self, kind: Kind, epoch: int) -> int:
        """Epochs since a network's training started."""
        return epoch - (self.random_epochs if kind == "position" else self.joint_epochs)

    def rate(self, kind: Kind, epoch: int) -> float:
        """A network's learning rate in an epoch."""
        if kind == "position" and epoch >= self.all_directions_epochs:
            return self.settled_rate
        learn = self.learn(kind)
        return learn.learning_rate * learn.rate_factor ** (max(0, self.since(kind, epoch)) // learn.rate_epochs)

    def epsilon(self, kind: Kind, epoch: int) -> float:
        """Share of random positions or directions while an epoch's data are collected."""
        since = self.since(kind, epoch)
        fallen = 1 - (1 - self.epsilon_lowest) * since / self.learn(kind).epsilon_epochs
        return min(1.0, max(self.epsilon_lowest, fallen))

    def rules(self, epoch: int) -> PaperRules:
        """How an epoch's data are collected."""
        return PaperRules(
            epsilon_position=self.epsilon("position", epoch),
            epsilon_direction=self.epsilon("direction", epoch),
            all_directions=epoch < self.all_directions_epochs,
            ucb_c=self.ucb_c,
            ucb_window=self.ucb_window,
        )
