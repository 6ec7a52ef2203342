"""Constants of the `mechanism` model and its training."""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from busybot.common.frozen_model import FrozenModel
from busybot.training.loop import LoopConfig


class MechanismNetConfig(FrozenModel):
    """Size of the network.

    Attributes:
        width: of hidden layers.
        worlds: that may be told, by name; what is told of others is not heard. Training takes those of its recordings.
        families: whether explanations that differ in how late inputs show, or in which way presses count, or that are
            by three inputs rather than two, are of one kind to it (`networks.families`): what training boards teach of
            some holds for the others, which they may not have. Trainings choose it.
        changes: whether it says which mechanisms changed. This and the next four are what labels teach: training with
            labels chooses them, training without does without, unless they are given.
        unseen: whether it says how probable it is that links decide a responder that nobody saw moving.
        apart: whether what is known of such a responder is weighed in each world in its own way, and may speak against
            what is believed of known links, too. Trainings choose it.
        rising: whether it hears which way round links are, as far as their looks tell.
        unsteady: whether it hears that the camera was not still.
    """

    width: Annotated[int, Field(ge=4, le=512)] = 32
    worlds: Annotated[tuple[Annotated[str, Field(pattern=r"^[a-z0-9-]{1,64}$")], ...], Field(max_length=64)] = ()
    families: bool = False
    changes: bool = True
    unseen: bool = False
    apart: bool = False
    rising: bool = False
    unsteady: bool = False


Share = Annotated[float, Field(ge=0, le=1)]


class Blur(FrozenModel):
    """What pictures of a board that is seen as badly as can be do not tell rightly, as shares.

    Attributes:
        unsteady: of the boards, that no still camera saw: between well and as badly as can be. Of the others a still
            camera tells nearly all.
        confused: of the moves, that are taken for another link's.
        missed: of the moves, that are not seen.
        hidden: of the links, that nothing tells the moves of.
        phantoms: of the boards, on which a link is seen that is none.
        still: of the responders, that seem never to change.
        flashes: of a responder's pictures, in which it seems to be in any of its states.
        covered: of a responder's pictures, from which on it is hidden for one to four and seems to stay as it was.
    """

    unsteady: Share = 0.4
    confused: Share = 0.02
    missed: Share = 0.06
    hidden: Share = 0.04
    phantoms: Share = 0.5
    still: Share = 0.15
    flashes: Share = 0.015
    covered: Share = 0.01


class MechanismConfig(FrozenModel):
    """Training the `mechanism` model.

    Attributes:
        labels: `parents`, the true ones, or `pictures`, none: what is seen later (`learner`).
        encoder: which features it reads of responders.
        drawn: boards of each world of the recordings that are drawn and moved without a simulator, to train on beside
            the recordings; none without labels.
        actions: random ones on each of these.
        blur: what is told wrongly of these, as pictures do; of each by a share of its own.
        iterations: at most so many.
        batch: boards per iteration.
        moments: numbers of actions after which each board is judged in one iteration, of six; drawn, small ones more
            often.
        learning_rate: at its highest; it rises over `warm_up` iterations and falls as a cosine to zero.
        weight_decay: of AdamW.
        clip: greatest norm of a gradient.
        rough: weight of the loss before messages were passed.
        changes: weight of the loss of what is said of mechanisms that changed. Few boards are rewired, so that a small
            weight leaves it to chance whether a training learns to see it.
        untold: share of the boards whose world is not told in training.
        masked: share of the links that are hidden in each iteration of a training without labels: what is seen later
            has to be foretold by the others.
    """

    model: Literal["mechanism"] = "mechanism"
    labels: Literal["parents", "pictures"] = "parents"
    encoder: str = "embedded"
    drawn: Annotated[int, Field(ge=0)] = 600
    actions: Annotated[int, Field(ge=1)] = 30
    blur: Blur = Blur()
    iterations: Annotated[int, Field(ge=0)] = 5000
    batch: Annotated[int, Field(ge=1)] = 8
    moments: Annotated[int, Field(ge=1, le=6)] = 3
    learning_rate: PositiveFloat = 3e-3
    warm_up: Annotated[int, Field(ge=1)] = 20
    weight_decay: NonNegativeFloat = 1e-3
    clip: PositiveFloat = 1.0
    rough: NonNegativeFloat = 0.3
    changes: NonNegativeFloat = 1.0
    untold: Share = 0.3
    masked: Share = 0.0
    net: MechanismNetConfig = MechanismNetConfig()
    loop: LoopConfig = LoopConfig(judge=100, patience=20)
