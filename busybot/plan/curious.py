"""Chooses the actions that tell most about what causes what: `busybot collect --policy curious`.

Every candidate of the interaction model on a trigger is worth what it is expected to tell. Of moving a known link, this
way or that, the reasoner tells what would be learned about all responders, as far as the interaction model believes
that the link goes there; it may go on to where nobody has seen it. A link that nobody has seen is worth as much as the
first few actions on a known one, as far as the model believes that there is one, and every trigger has one: while none
of a trigger's links is known, what its candidates promise is counted among each other. So links are found first, and
places of little promise are tried when known links tell little more: while none of a trigger's links is known, peaks
are candidates however little the model sees there, and on all triggers so is what is beside an action that failed.

What moves where it is taken hold of is a link, though so few pixels change, because nothing responds, that there is no
reward; a noisy camera does not tell that. What did not move may be held by how a responder is (`held_links`), and is
tried again when responders look as they never did when it was tried. Moving a known link is worth what that opens, too:
what may be tried then, for each of the actions that it takes. Of a link that moved at times and at times did not, the
reasoner tells whether it would now. What there is to go by are the pictures so far, with the objects' boxes and roles
in the first of them, as in a recording; not the world: told of `time` the reasoner expects so much of known links that
fewer are found, and validation boards are known less well.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.common.errors import UsageError
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Image, Observation
from busybot.interact.policy.candidates import ASIDE, Candidates
from busybot.interact.policy.colour_patches import PATCHES
from busybot.interact.policy.direction_pairs import PAIR_OF
from busybot.interact.policy.learned import LearnedPolicy
from busybot.interact.policy.policy_factory import (
    LearnedPolicyFactory,
    candidates_config,
    card_of,
    fingerprint,
    load_once,
)
from busybot.plan.agent_policy import OnlineFeatures
from busybot.plan.held_links import LEAST, NONE_HELD, SAME, SUREST, HeldLinks
from busybot.reason.encoders.registry import FeatureExtractor, make_extractor
from busybot.reason.inputs.observation import NO_BOXES, Frame, ObservedAction, ObservedEpisode, trigger_at
from busybot.reason.inputs.sequence import BoardSequence, sequence_of
from busybot.reason.inputs.trigger_links import LinkWatch
from busybot.reason.models.base import Curious
from busybot.reason.models.registry import reasoner_of
from busybot.sim.policy import Action, Detections
from busybot.training.model_cards import file_hashes, find_folder

NAME = "curious"
REASONER = "mechanism"
"""The shipped reasoner that is asked if none is named."""
NEW = 3.0
"""A link that nobody has seen moving would tell so much, nats: what the first few actions on a known one do."""
ELSEWHERE = 0.02
"""A trigger's links are so probably none of its candidates, or held, before any was tried: this share of what these
promised together, for what a model promises on objects unlike those that it learned from is too little for all."""
PROMISING = 0.005
"""While a new candidate promises so much, expected success, nobody knows all that there is to know."""
NEGLIGIBLE = 0.02
"""What a way leads to is not asked about if it works less probably than that."""
CERTAIN = 0.95
"""The policy knows what there is to know when it is so sure of every responder's parents (`--until-known`); chosen on
900 boards of the training split, drawn ones and recorded ones, on which it is then seldom wrong."""


class Watched:
    """A recording that grows: what a reasoner may know of it, after every action."""

    def __init__(self, first: Observation, detections: Detections, extractor: FeatureExtractor):
        image = Image(first.rgb, first.depth, None, NO_BOXES)
        found = detections.roles, detections.boxes, detections.positions
        self.observed = ObservedEpisode(first.camera, *found, actions=(), images=[image], image_of=(0,))
        self._extractor, self._latest, self._steadied = extractor, first, False
        self._features: list[np.ndarray] = []
        self._calm: list[Image] = []
        self._watch = LinkWatch(self.observed)
        self._look_anew()

    def _look_anew(self) -> None:
        self._sight, self._features, self._calm = OnlineFeatures(self.observed, self._extractor), [], []
        for number in range(len(self.observed.image_of)):
            self._see(self.observed.frame(number))

    def _see(self, frame: Frame) -> None:
        self._features.append(self._sight.see(frame))
        self._calm.append(Image(self._sight.calm.rgb, self._sight.calm.depth, None, NO_BOXES))

    @property
    def still(self) -> bool:
        """Whether the camera was still so far; before the first action nobody can tell."""
        return bool(self.observed.actions) and not self._steadied

    def changed(self, after: Observation) -> bool:
        """Whether something was seen to change: else an observation is the same object as before."""
        return after is not self._latest

    def add(self, action: ObservedAction, after: Observation) -> None:
        """What an action led to."""
        images, observed = list(self.observed.images), self.observed
        if self.changed(after):
            images.append(Image(after.rgb, after.depth, None, NO_BOXES))
        self._latest = after
        image_of, actions = (*observed.image_of, len(images) - 1), (*observed.actions, action)
        self.observed = replace(observed, actions=actions, images=images, image_of=image_of)
        self._watch = LinkWatch(self.observed, shorter=self._watch)
        if not self._steadied and not self._watch.still:  # one picture alone does not tell
            self._steadied = True
            self._look_anew()
        else:
            self._see(Frame(after.rgb, after.depth))

    def sequence(self) -> BoardSequence:
        watch = self._watch
        if self._steadied:
            calm = replace(self.observed, images=self._calm, image_of=tuple(range(len(self._calm))))
            watch = LinkWatch(self.observed, calm, watch)
        return sequence_of(self.observed, np.stack(self._features), watch)


@dataclass(frozen=True)
class Done:
    """An action: where it took hold, the direction pair that was tried last, and whether a link moved there; None if
    nobody can tell."""

    pixel: tuple[int, int]
    pair: int
    moved: bool | None


class CuriousPolicy:
    """See the module.

    Args:
        inner: finds links, and asks what its actions are worth.
        reasoner: of `curious_reasoner`; expects to learn something of them.
        until_known: end the episode when every candidate was tried that may be one and the reasoner is sure of all
            parents.
    """

    name = NAME

    def __init__(
        self, inner: LearnedPolicy[Any], rays: Rays, detections: Detections, reasoner: Any, until_known: bool = False
    ):
        self._inner, self._rays, self._detections = inner, rays, detections
        self._reasoner, self._extractor = reasoner, make_extractor(reasoner.encoder)
        self._until_known = until_known
        self._watched: Watched | None = None
        self._seen: Observation | None = None
        self._sequence: BoardSequence | None = None  # what is known, where this decision asked for it
        self._untried = False  # whether something new that was not tried promises anything, at the last decision
        self._done: list[Done] = []
        self._promised: dict[int, float] = {}  # that a link of a trigger moves, by its candidates' first scores
        self._moving: set[int] = set()  # triggers of which a link was seen moving
        self._held = HeldLinks()
        self._chances: dict[tuple[int, int], tuple[float, float]] = {}  # of the last decision, see `HeldLinks.tried`

    def select_action(self, observation: Observation, rng: np.random.Generator) -> Action | None:
        if self._watched is None:
            self._watched = Watched(observation, self._detections, self._extractor)
        self._seen, self._sequence, self._untried, self._chances = observation, None, False, {}
        if (memory := self._inner.memory) is not None:
            memory.explain([self._held_at(one.pixel) for one in memory.failures])
        self._inner.within = self._within(observation.depth.shape)
        observed = self._watched.observed
        self._inner.triggers = observed.boxes[observed.triggers].astype(int) if self._watched.still else None
        action = self._inner.select_action(observation, rng)
        return None if self._knows(self._watched) and not self._untried else action

    def observe(self, action: Action, executed: tuple[int, ...], reward: int, after: Observation) -> None:
        watched, seen = self._watched, self._seen
        assert watched is not None and seen is not None
        memory = self._inner.memory
        assert memory is not None
        moved = self._moved(action.pixel, seen, after, bool(reward))
        trigger, known = trigger_at(watched.observed, action.pixel), len(memory.pairs)
        nothing = not memory.links[action.pixel[1], action.pixel[0]]
        self._done.append(Done(action.pixel, int(PAIR_OF[executed[-1]]), moved))
        if moved:
            self._moving.add(trigger)
        self._inner.observe(action, executed, int(bool(moved)), after)
        if trigger >= 0 and nothing and (not moved or len(memory.pairs) > known):  # else it was a known link after all
            chances = self._chances.get(action.pixel, (0.0, 0.0))
            self._held.tried(len(self._done) - 1, action.pixel, trigger, chances, moved)
        x, y, z = map(float, self._rays.point(seen.depth, action.pixel))
        proposed, tried = DIRECTIONS[action.directions[0]].tolist(), DIRECTIONS[executed[-1]].tolist()
        pushed = tuple(tried) if watched.changed(after) else None
        watched.add(ObservedAction(action.pixel, (x, y, z), tuple(proposed), pushed), after)

    def _moved(self, pixel: tuple[int, int], seen: Observation, after: Observation, rewarded: bool) -> bool | None:
        """Whether a link moved where an action took hold: a reward alone may be for something that changed late, or by
        chance. None if nobody can tell: before a noisy camera a link may move without a reward."""
        assert self._watched is not None and self._inner.memory is not None
        if not self._watched.changed(after):
            return False
        told = self._inner.memory.moved_at(pixel, seen, after)
        return (rewarded or None) if told is None else told

    def _knows(self, watched: Watched) -> bool:
        """Whether somebody who ends when all is known is sure of all parents; known links have nothing to tell then."""
        if not self._until_known:
            return False
        self._sequence = self._sequence or watched.sequence()
        return bool(self._reasoner.certainty(self._sequence) >= CERTAIN)

    def _held_at(self, pixel: tuple[int, int]) -> float:
        """How probable it is that a link is held there where an action failed."""
        assert self._watched is not None
        place = self._held.at(pixel, trigger_at(self._watched.observed, pixel))
        return 0.0 if place is None else self._held.held(place) * place.promised

    def _within(self, shape: tuple[int, ...]) -> np.ndarray:
        """Where to try what the model sees little in, bool (H, W): on triggers of which no link is known, and on others
        beside failures."""
        assert self._watched is not None
        told, beside = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
        for failure in [] if self._inner.memory is None else self._inner.memory.failures:
            cv2.circle(beside, failure.pixel, 2 * ASIDE, 1, -1)
        for trigger in self._watched.observed.triggers.tolist():
            u0, v0, u1, v1 = np.maximum(self._watched.observed.boxes[trigger], 0).astype(int).tolist()
            told[v0:v1, u0:u1] |= beside[v0:v1, u0:u1] if trigger in self._moving else 1
        return told > 0

    def worth(self, found: Candidates, directions: np.ndarray) -> np.ndarray:
        """Expected information, see `interact.policy.learned.Worth`; less than none where there is no trigger."""
        assert self._watched is not None and self._inner.memory is not None
        triggers = np.array([trigger_at(self._watched.observed, (int(u), int(v))) for u, v in found.pixels], int)
        known = found.regions > 0
        new, moving = (np.flatnonzero((triggers >= 0) & one) for one in (~known, known))
        moving = moving[found.take(moving).best_in_regions()]
        told = np.full(directions.shape, -1.0)
        told[new] = self._of_new(found.take(new), triggers[new])[:, None]
        told[moving] = 0
        if len(moving) and not self._knows(self._watched):
            told[moving] = self._of_moving(found.take(moving), directions[moving], triggers[moving])
        promising = found.take((triggers >= 0) & (found.regions < 0) & (found.scores >= PROMISING))
        self._untried = not self._inner.memory.tried_here(promising.pixels).all()
        return told

    def _of_new(self, places: Candidates, triggers: np.ndarray) -> np.ndarray:
        """What trying places is worth where no link is known, float (K,)."""
        scores, held = places.scores, self._held
        pixels = list(zip(*places.pixels.T.tolist(), strict=True))
        for trigger in set(triggers.tolist()) - set(self._promised):
            first = places.take(triggers == trigger).best_of_regions()
            self._promised[trigger] = 1 - float(np.prod(1 - first.scores))
        tried = [held.at(pixel, trigger) for pixel, trigger in zip(pixels, triggers.tolist(), strict=True)]
        new = np.array([one is None for one in tried], bool)
        locked = np.array([0.0 if one is None else held.held(one) for one in tried])
        waiting = locked * np.array([0.0 if one is None else one.promised for one in tried])
        free = (1 - locked) * scores
        released = self._released([() if one is None else one.actions for one in tried])
        moves = waiting * released + free
        best = places.best_in_regions(moves)
        links = np.zeros(len(places))
        links[best] = on_triggers((waiting + free)[best], triggers[best], self._moving, self._promised)
        chances = zip(np.where(new, links, scores).tolist(), released.tolist(), strict=True)
        self._chances = dict(zip(pixels, chances, strict=True))
        moves /= np.maximum(waiting + free, LEAST)
        told = self._of_a_link() * links * np.where(new, 1 - held.share, moves)
        told[np.setdiff1d(np.arange(len(places)), best)] = -1
        return told

    def _of_a_link(self) -> float:
        """What it is worth to find one: if links hold each other, every one that is found is the way to others."""
        return NEW / (1 - self._held.share)

    def _released(self, tries: Sequence[Sequence[int]]) -> np.ndarray:
        """See `Curious.released`; ones where nothing was tried."""
        assert self._watched is not None
        told, some = np.ones(len(tries)), [k for k, actions in enumerate(tries) if actions]
        if some:
            self._sequence = self._sequence or self._watched.sequence()
            told[some] = self._reasoner.released(self._sequence, [tries[k] for k in some])
        return told

    def _of_moving(self, links: Candidates, directions: np.ndarray, triggers: np.ndarray) -> np.ndarray:
        """What known links (K,) would tell this way and that, float (K, 2), or open; where one way does not work the
        other is tried."""
        assert self._watched is not None
        self._sequence = self._sequence or self._watched.sequence()
        works = np.take_along_axis(links.directions, directions, axis=1)
        asked = (works > NEGLIGIBLE) | (works >= works.max(axis=1, keepdims=True))
        places, ways = np.nonzero(asked)
        actions = np.concatenate([links.positions[places], DIRECTIONS[directions[places, ways]]], axis=1)
        told, actions = np.zeros(directions.shape), actions.astype(np.float32)
        told[asked] = self._reasoner.expected_information(self._sequence, actions, triggers[places])
        yields = self._yields(links.regions)[:, None]
        told = yields * (works * told + (1 - works) * (works * told)[:, ::-1])
        told[asked] = self._with_what_opens(told[asked], (yields * works)[asked], actions, triggers[places])
        return told

    def _with_what_opens(
        self, told: np.ndarray, works: np.ndarray, actions: np.ndarray, triggers: np.ndarray
    ) -> np.ndarray:
        """What S actions on known links are worth, together with what they open, float (S,)."""
        assert self._inner.memory is not None
        known = self._inner.memory.links
        held = [one for one in self._held.places if not (one.moved or known[one.pixel[::-1]])]
        if not held:
            return told
        opened = self._reasoner.released(self._sequence, [one.actions for one in held], actions, triggers)
        return self._held.with_what_opens(told, works, np.full(len(held), self._of_a_link()), held, opened)

    def _yields(self, regions: np.ndarray) -> np.ndarray:
        """How far to believe that known links (K,) move as things are now, by when each did and did not; float (K,)."""
        assert self._inner.memory is not None
        links, pairs = self._inner.memory.links, self._inner.memory.pairs
        tries: dict[int, list[tuple[int, bool, bool]]] = {region: [] for region in regions.tolist()}
        for step, one in enumerate(self._done):
            link = int(links[one.pixel[::-1]])
            if link in tries and one.moved is not None:
                tries[link].append((step, one.moved, one.moved or one.pair == pairs[link]))
        return np.asarray(self._reasoner.yields(self._sequence, list(tries.values())))


def on_triggers(
    scores: np.ndarray, triggers: np.ndarray, moving: Collection[int], promised: Mapping[int, float]
) -> np.ndarray:
    """Expected success of candidates for new links, where every trigger has a link: before one was seen moving, one of
    the candidates on it works, or none does for another reason, however little a model promises that knows no such
    trigger.

    Args:
        scores: float (K,), expected success of each by itself.
        triggers: int (K,), where each is.
        moving: triggers of which a link was seen moving.
        promised: how probable it seemed at first, by such scores, that any candidate on a trigger works.

    Returns:
        float (K,).
    """
    told = scores.copy()
    for trigger in set(triggers.tolist()) - set(moving):
        here = triggers == trigger
        told[here] /= max(1 - (1 - ELSEWHERE * promised[trigger]) * np.prod(1 - scores[here]), LEAST)
    return told


def curious_reasoner(name_or_path: str) -> Any:
    """A reasoner that is `Curious`.

    Raises:
        BusybotError: there is no such model, or it does not tell what it would learn.
    """
    reasoner = reasoner_of(name_or_path)
    if not isinstance(reasoner, Curious):
        what = f"--policy {NAME} asks what would be learned, which the reasoner {reasoner.name} does not tell"
        raise UsageError(what, f"give --reasoner {REASONER}, or a model of that variant")
    return reasoner


@dataclass(frozen=True)
class CuriousFactory:
    """Makes the policy of an interaction model and a reasoner.

    Attributes:
        learned: the interaction model, in mode `collect`.
        reasoner: name of a shipped model, or a folder.
        until_known: see `CuriousPolicy`.
    """

    learned: LearnedPolicyFactory
    reasoner: str = REASONER
    until_known: bool = False
    name: str = field(default=NAME, init=False)

    def make_detecting(self, rays: Rays, detections: Detections) -> CuriousPolicy:
        model, reasoner = load_once(self.learned.model), curious_reasoner(self.reasoner)
        inner = LearnedPolicy(model, rays, candidates_config(model.info, self.learned.overrides), "collect")
        policy = CuriousPolicy(inner, rays, detections, reasoner, self.until_known)
        inner.worth = policy.worth
        return policy

    def provenance(self) -> dict[str, Any]:
        """Everything that decides the choices, JSON values.

        Raises:
            BusybotError: there is no such model; or an override is of what only another policy's choice reads.
        """
        policy = candidates_config(card_of(self.learned.model), self.learned.overrides).provenance()
        reasoner = file_hashes(find_folder(self.reasoner, "reason"))
        numbers = {"new": NEW, "elsewhere": ELSEWHERE, "promising": PROMISING, "negligible": NEGLIGIBLE}
        numbers |= {"certain": CERTAIN, "aside": ASIDE, "same": SAME, "none_held": NONE_HELD, "surest": SUREST}
        return {
            "mode": self.learned.mode,
            "policy": policy,
            "model": fingerprint(self.learned.model),
            "reasoner": reasoner,
            "until_known": self.until_known,
            "constants": {**numbers, "patches": PATCHES},
        }
