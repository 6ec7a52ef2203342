"""An agent on a board: it sees pictures as features, its acts become actions, its decisions are logged.

`OnlineFeatures` does for pictures as they come what `features_of` does for recorded episodes. Places of the objects
come from the first frame of the recorded interactions, and so does what an object looks like where something hides it.

Notes of the decisions are among a rollout's settings, one entry for each action and then perhaps one for the decision
to stop: the agent's words, and the contacts that it could choose from.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from busybot.boards.directions import DIRECTIONS
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel
from busybot.episodes.episode import Episode, Observation
from busybot.plan.contact_proposals import ContactProposals
from busybot.plan.interfaces import Act, Agent, Contact, DecisionState, PastAction, Stop, TaskContext
from busybot.reason.encoders.registry import FeatureExtractor
from busybot.reason.inputs.appearances import TrackedObject
from busybot.reason.inputs.object_masks import MaskConfig, ObjectMasks
from busybot.reason.inputs.observation import Frame, ObservedEpisode
from busybot.reason.inputs.sequence import CHANNELS
from busybot.reason.inputs.steady import Steady, steadied
from busybot.sim.policy import Action

WORDS, OFFERED = "decisions", "offered"
"""Names among the settings."""
LONGEST = 500
"""Of an agent's words no more characters are shown."""


class OnlineFeatures:
    """Watches the responders of one board.

    Args:
        observed: the recorded interactions; its first frame is seen first.
        chosen: an encoder that is no oracle.

    Attributes:
        calm: the last picture, comparable with the others (`Steady`).
    """

    calm: Frame

    def __init__(self, observed: ObservedEpisode, chosen: FeatureExtractor):
        self._steady = Steady(observed)
        self._pixels = ObjectMasks(steadied(observed), MaskConfig(depth=chosen.pixels == "own"))
        self._observed, self._chosen = observed, chosen
        regions = self._pixels.regions
        self._watched = {i: TrackedObject(region) for i, region in regions.items() if observed.roles[i] == "responder"}
        self._features = np.zeros((len(observed.roles), CHANNELS), np.float32)
        self._known: dict[int, list[np.ndarray]] = {index: [] for index in self._watched}
        self._see(observed.frame(0))

    def see(self, frame: Frame) -> np.ndarray:
        """Features float32 (N, 256) of the next picture; zeros for triggers and objects without a box."""
        self._see(frame)
        return self._features.copy()

    def _see(self, shown: Frame) -> None:
        frame = self.calm = self._steady.of(shown)
        if self._chosen.pixels == "centre":
            self._features = self._chosen.of_pictures(self._observed, [frame.rgb])[0].astype(np.float32)
            return
        for index, one in self._watched.items():
            if one.unchanged(frame):
                continue
            number = one.update(*self._pixels.masks_of(index, frame))
            known = self._known[index]
            if number == len(known):
                # as precise as what is stored of recorded episodes
                known.append(self._chosen.encoder.encode([one.look])[0].astype(np.float16).astype(np.float32))
            self._features[index] = known[number]


@dataclass
class Decision:
    """What an agent decided, and what it took.

    Attributes:
        answer: its answer.
        repeats: contacts of the history that it could choose; of those that changed no picture the one that it chose.
        proposed: candidates of the interaction model, None if it was not asked.
        cpu_ms: processor time from the picture to the answer, the model's part in it included.
        model_ms: of that, the interaction model's.
    """

    answer: Act | Stop
    repeats: tuple[Contact, ...]
    proposed: tuple[Contact, ...] | None
    cpu_ms: float
    model_ms: float


class AgentPolicy:
    """Lets an agent act where `sim.recorder` wants a policy.

    Args:
        agent: not started yet.
        sight: that has seen the history's first frame only.
        name: in tables; by default the agent's.

    Attributes:
        decisions: one for each action, then perhaps the one to stop.
        start_ms: processor time that the agent took to start.
        features: (N, 256), of the last picture.
    """

    def __init__(
        self,
        agent: Agent,
        briefing: TaskContext,
        contacts: ContactProposals,
        sight: OnlineFeatures,
        name: str | None = None,
    ):
        self.name = name or agent.name
        self._agent, self._contacts, self._sight = agent, contacts, sight
        began = time.process_time()
        agent.start(briefing)
        self.start_ms = _ms_since(began)
        self.decisions: list[Decision] = []
        self._attempts: list[PastAction] = []
        self._seen: Observation | None = None
        self.features = briefing.history.features[0]

    def select_action(self, observation: Observation, rng: np.random.Generator) -> Action | None:
        began, asked = time.process_time(), self._contacts.proposing_s
        self._look(observation)
        situation = DecisionState(
            features=self.features,
            attempts=tuple(self._attempts),
            repeats=self._contacts.repeats(observation),
            propose=lambda: self._contacts.propose(observation),
            rng=rng,
            look_again=lambda: self._contacts.unrewarded(observation),
        )
        answer = self._agent.decide(situation)
        if not isinstance(answer, Act | Stop):
            what = f"agent {self.name} answered {str(answer)[:80]!r}, which is neither an Act nor a Stop"
            raise BusybotError(what, "answer with one of these, of busybot.plan.interfaces")
        proposed: tuple[Contact, ...] | None = vars(situation).get("candidates")
        looked: tuple[Contact, ...] = vars(situation).get("unrewarded", ())
        repeats = (*situation.repeats, *(one for one in looked if isinstance(answer, Act) and answer.contact is one))
        if isinstance(answer, Act) and answer.contact not in (*repeats, *(proposed or ())):
            what = f"agent {self.name} took hold of a contact that it was not offered"
            raise BusybotError(what, "answer with one of `repeats`, `unrewarded` or `candidates` of the same situation")
        model_ms = 1000 * (self._contacts.proposing_s - asked)
        self.decisions.append(Decision(answer, repeats, proposed, _ms_since(began), model_ms))
        return None if isinstance(answer, Stop) else Action(answer.contact.pixel, (answer.direction,))

    def observe(self, action: Action, executed: tuple[int, ...], reward: int, after: Observation) -> None:
        answer, before, seen = self.decisions[-1].answer, self.features, self._seen
        assert isinstance(answer, Act) and seen is not None
        began = time.process_time()
        self._contacts.observe(answer.contact, executed, bool(reward), seen, after)
        self._look(after)
        self._attempts.append(
            PastAction(answer.contact, answer.direction, executed, bool(reward), before, self.features)
        )
        # what is learned from an action belongs to the decision for it
        self.decisions[-1].cpu_ms += _ms_since(began)

    def _look(self, observation: Observation) -> None:
        if observation is not self._seen:
            self._seen, self.features = observation, self._sight.see(Frame(observation.rgb, observation.depth))


def _ms_since(began: float) -> float:
    """Processor time of this process since then, milliseconds."""
    return 1000 * (time.process_time() - began)


class LoggedContact(FrozenModel):
    """A contact that an agent could choose.

    Attributes:
        pixel: (u, v).
        position: board frame, board units.
        direction: of the best direction pair the likelier one, index into DIRECTIONS.
        score: expected success of that pair.
        step: of the history that worked there, -1 if the interaction model proposed the contact.
    """

    pixel: tuple[int, int]
    position: tuple[float, float, float]
    direction: int = Field(ge=0, lt=len(DIRECTIONS))
    score: float = Field(ge=0, le=1)
    step: int = Field(ge=-1)


_LOGGED = TypeAdapter(list[LoggedContact])


def notes(decisions: Sequence[Decision]) -> dict[str, Any]:
    """Settings that tell of the decisions, JSON values."""
    answers = [decision.answer for decision in decisions]
    choices = [(*decision.repeats, *(decision.proposed or ())) for decision in decisions]
    return {
        WORDS: [f"stop: {answer.why}" if isinstance(answer, Stop) else answer.why for answer in answers],
        OFFERED: [[_logged(contact).model_dump(mode="json") for contact in contacts] for contacts in choices],
    }


def _logged(contact: Contact) -> LoggedContact:
    x, y, z = (round(float(value), 4) for value in contact.position)
    return LoggedContact(
        pixel=contact.pixel,
        position=(x, y, z),
        direction=contact.choices[0],
        score=round(min(max(contact.score, 0.0), 1.0), 4),
        step=contact.step,
    )


def is_rollout(episode: Episode) -> bool:
    """Whether an agent's decisions are recorded."""
    return isinstance(episode.settings.get(WORDS), list)


def reason(episode: Episode, step: int) -> str:
    """What an agent said about a step, or why it stopped before it; empty if nothing was recorded."""
    words = episode.settings.get(WORDS)
    if not isinstance(words, list) or step >= len(words) or not words[step]:
        return ""
    return str(words[step])[:LONGEST]


def offered(episode: Episode, step: int) -> list[LoggedContact]:
    """What an agent could choose from at a step; empty if it was not recorded, or cannot be understood."""
    told = episode.settings.get(OFFERED)
    if not isinstance(told, list) or step >= len(told):
        return []
    try:
        return _LOGGED.validate_python(told[step])
    except ValidationError:
        return []
