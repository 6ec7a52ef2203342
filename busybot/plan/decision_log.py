"""Logs a rollout's decisions: the agent's words, and the contacts that it could choose from.

Notes are among an episode's settings, one entry for each action and then perhaps one for the decision to stop.
"""

from collections.abc import Sequence
from typing import Any

from pydantic import Field, TypeAdapter, ValidationError

from busybot.boards.directions import DIRECTIONS
from busybot.common.frozen_model import FrozenModel
from busybot.episodes.episode import Episode
from busybot.plan.agent_policy import Decision
from busybot.plan.interfaces import Contact, Stop

WORDS, OFFERED = "decisions", "offered"
"""Names among the settings."""
LONGEST = 500
"""Of an agent's words no more characters are shown."""


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


def notes(decisions: Sequence[Decision]) -> dict[str, Any]:
    """Settings that tell of the decisions, JSON values."""
    return {
        WORDS: [_words(decision) for decision in decisions],
        OFFERED: [
            [_offered(contact).model_dump(mode="json") for contact in (*one.repeats, *(one.proposed or ()))]
            for one in decisions
        ],
    }


def _words(decision: Decision) -> str:
    return f"stop: {decision.answer.why}" if isinstance(decision.answer, Stop) else decision.answer.why


def _offered(contact: Contact) -> LoggedContact:
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
        return _SEVERAL.validate_python(told[step])
    except ValidationError:
        return []


_SEVERAL = TypeAdapter(list[LoggedContact])
