"""The constants of the learned policy, in one place.

They were chosen on boards of training objects, `caution`, `temperature`, `explore`, `insist` and `trigger_bonus` on
further ones that the model had not seen (`benchmarks/studies/policy_constants.py`), because there it is surer than it
is right. That there is a `responder_penalty` was thought of after failures on novel objects (docs/results/interact.md
tells it). A model's card may carry other values (`thresholds` in model.json), and `--set learned.NAME=VALUE` overrides
both.

Those in `FIXED` were parameters until the same benchmark showed that no other value changes anything.
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationError

from busybot.common.frozen_model import FrozenModel
from busybot.training.model_cards import ModelCard

Share = Annotated[float, Field(ge=0, le=1)]
Inner = Annotated[float, Field(gt=0, lt=1)]
Logit = Annotated[float, Field(ge=-50, le=50)]
PairRow = Annotated[tuple[Logit, ...], Field(min_length=9, max_length=9)]
Pixels = Annotated[int, Field(ge=0, le=200)]
PairTable = Annotated[tuple[PairRow, ...], Field(min_length=9, max_length=9)]

Inputs = Literal["depth", "rgb"]
"""What an interaction model sees."""
Threshold = bool | float | str
"""A constant's value on a model's card."""

STRICT_POLICY: dict[str, Threshold] = {"explore": 0.35, "insist": 0.1, "trigger_bonus": 0.0}
"""What goes with a model that was trained under the veto. It knows the directions of new objects less well, and where
one failed, another is likely to work; trying more places would find it no more links."""


OPENING = 5
"""What a known link leaves over must hold a square of this side to have a peak, pixels."""
SAME_LINK = 0.25
"""A motion is of a known link when it overlaps more than this share of the smaller of both regions."""
EFFECT = 150
"""So many pixels of an object look otherwise when it responds to an action on another one; lamps, doors and toys change
several hundred."""
FAILURE_SIGMA = 6.0
"""How far around it a failure speaks of the candidate itself, pixels (Gaussian)."""
FIXED: dict[str, float] = {
    "opening": OPENING,
    "same_link": SAME_LINK,
    "effect": EFFECT,
    "failure_sigma": FAILURE_SIGMA,
}
"""Parameters of former versions: cards may still name them, with these values, and provenance still tells them."""


class PolicyConfig(FrozenModel):
    """How affordances become actions.

    Attributes:
        candidates: `peaks` of the affordance per region, or the paper's `kmeans` clusters.
        peak_radius: of two peaks nearer than this in rows and columns only the higher one is a candidate.
        peak_logit: lower peaks are no candidates.
        most: peaks per look, the highest first; once a link is known, as many again of what known links leave over.
            What a caller knows of places (`within` and `triggers` of `find_candidates`) adds further candidates.
        blur: width of the Gaussian over the affordance before peaks are sought, pixels, odd.
        region_logit: pixels above it form the connected regions of affordance.
        dense_weight: share of the position network's logit in a candidate's belief; the rest is the crop network's.
        prior: share of working positions among the candidates; training sees half and half.
        caution: logits taken from the belief in every candidate that has not moved yet.
        temperature: the logits of its directions are divided by it.
        after_failure: (9, 9), logits that direction pair j gains where pair i failed; None for nothing. Comes with the
            model (`interact.training.fast`).
        change: depth that differs by more than this has moved, board units.
        reach: a link's motion is looked for this far around the action, pixels.
        disc: so far around the action the link is taken as moved whatever the depth says, pixels.
        component_penalty: logits that every failure takes from untouched candidates farther away on the same elevated
            component.
        failure_penalty: logits that every failure on the board takes from all untouched candidates farther away; where
            a reasoner chooses, this and the penalty above as far as success was expected.
        responder_penalty: logits taken from candidates on an object that responded and of which nothing has moved.
        trigger_bonus: logits given to new candidates on an elevated component of which a link has moved, until an
            action fails there: it is a trigger, and many have further links.
        known_pair: least belief in the direction pair that moved a known link before.
        explore: new links are tried while the best one's expected success exceeds this; then known ones are repeated.
        insist: where a pair has failed already, others are tried while their expected success exceeds this. Physics
            alone lets most pairs work, so that a failure says that the place is wrong.
        collect: least expected success of a new candidate when data for reasoning are collected by chance. Low, because
            a link that is never touched has no relations that could be found; what fails soon promises less
            (`benchmarks/studies/policy_constants.py coverage`: so many places elsewhere promise as much).
        untried_first: when data for reasoning are collected by chance, candidates that were neither moved nor tried
            come before the others. Without it the draw is among all candidates, as in the paper: of six links, one in
            55 is not among 22 draws.
        persist: when data for reasoning are collected by chance, share of the actions that go to what has not moved
            yet, however little it promises: to what promises most for the actions that its object had. Where there is
            much to try, failures would else take the belief in what was hardly tried, and links that give be moved all
            the time.
        ucb_c, ucb_window: the paper's bonus and the side of its window, pixels, even.
        clusters: k of the K-means candidates: no board has more movable links.
        cluster_belief: least affordance of a pixel that takes part in the clusters; `middle` for what lies between the
            picture's highest and lowest.
    """

    candidates: Literal["peaks", "kmeans"] = "peaks"
    peak_radius: Pixels = 3
    peak_logit: Logit = -4.0
    most: Annotated[int, Field(ge=1, le=1000)] = 40
    blur: Annotated[int, Field(ge=1, le=31)] = 3
    region_logit: Logit = 0.0
    dense_weight: Share = 0.65
    prior: Inner = 0.15
    caution: Logit = 1.25
    temperature: Annotated[float, Field(ge=0.1, le=100)] = 3.0
    after_failure: PairTable | None = None
    change: Annotated[float, Field(gt=0)] = 2e-4
    reach: Pixels = 36
    disc: Pixels = 2
    component_penalty: Logit = 1.0
    failure_penalty: Logit = 0.7
    responder_penalty: Logit = 3.0
    trigger_bonus: Logit = 1.2
    known_pair: Share = 0.97
    explore: Share = 0.25
    insist: Share = 0.35
    collect: Share = 0.005
    untried_first: bool = True
    persist: Share = 0.0
    ucb_c: Annotated[float, Field(ge=0)] = 0.5
    ucb_window: Annotated[int, Field(ge=2, le=200, multiple_of=2)] = 10
    clusters: Annotated[int, Field(ge=1, le=100)] = 7
    cluster_belief: Share | Literal["middle"] = 0.5

    def provenance(self) -> dict[str, Any]:
        """All constants, JSON values, as results and recordings tell them; equal to those of former versions."""
        absent: set[str] = set() if self.persist else {"persist"}  # former versions had none
        return {**self.model_dump(mode="json", exclude=absent), **FIXED}


def without_fixed(values: dict[str, Any]) -> dict[str, Any]:
    """The values that `PolicyConfig` knows; ValueError names a fixed constant that is given another value."""
    for name, fixed in FIXED.items():
        if name in values and values[name] != fixed:
            raise ValueError(f"{name}: it is {fixed:g} in every model now, not {values[name]}")
    return {name: value for name, value in values.items() if name not in FIXED}


def check_thresholds(thresholds: dict[str, Threshold]) -> dict[str, Threshold]:
    """The constants of a card as they are; ValueError names the one that does not exist or has no allowed value."""
    try:
        PolicyConfig.model_validate(without_fixed(thresholds))
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    return thresholds


class AffordanceInfo(ModelCard):
    """What `model.json` says.

    Attributes:
        variant: which networks.
        inputs: what they see; the height is always known to the policy.
        prior: share of elevated pixels that work, as training batches (half of each) do not show it.
        after_failure: what to try where a direction failed, see `interact.training.fast`.
        thresholds: constants of the policy that go with this model.
    """

    variant: Literal["fast", "paper"] = "fast"
    inputs: Inputs = "depth"
    prior: Annotated[float, Field(gt=0, lt=1)] = 0.15
    after_failure: PairTable | None = None
    thresholds: Annotated[dict[str, Threshold], AfterValidator(check_thresholds)] = {}
