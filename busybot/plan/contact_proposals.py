"""Proposes contacts to agents: those that worked in the history, and those of the interaction model on a picture."""

import time
from collections.abc import Sequence as Several
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from typing import Generic, Protocol

import numpy as np

from busybot.boards.directions import DIRECTIONS, OPPOSITE
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Episode, Observation
from busybot.interact.policy.board_memory import BoardMemory, Failure
from busybot.interact.policy.candidates import ActionModel, Candidates, V, find_candidates, pairs_at
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.direction_pairs import PAIR_OF, pair_scores
from busybot.interact.policy.policy_trace import remember
from busybot.plan.interfaces import Contact
from busybot.reason.inputs.observation import ObservedEpisode, trigger_at

SURE = 0.97
"""Belief in a contact that has worked."""


@dataclass(frozen=True)
class SuccessfulAction:
    """An action of the history that changed the picture: its step, pixel (u, v) and the direction that did it."""

    step: int
    pixel: tuple[int, int]
    direction: int


class ContactProposals(Protocol):
    """Offers contacts on one board, and is told what came of them."""

    proposing_s: float
    """CPU seconds that were spent in models that look at pictures."""

    def repeats(self, seen: Observation) -> tuple[Contact, ...]:
        """What worked in the history."""
        ...

    def propose(self, seen: Observation) -> tuple[Contact, ...]:
        """What seems possible now."""
        ...

    def observe(
        self, contact: Contact, executed: tuple[int, ...], reward: bool, before: Observation, after: Observation
    ) -> None:
        """What came of an action."""
        ...


class LearnedProposals(Generic[V]):
    """From an interaction model and a memory that has seen the history.

    Args:
        observed: the recorded interactions.
        worked: those of them that changed the picture.
        memory: it is copied.
    """

    def __init__(
        self,
        model: ActionModel[V],
        config: PolicyConfig,
        rays: Rays,
        observed: ObservedEpisode,
        worked: Several[SuccessfulAction],
        memory: BoardMemory,
    ):
        self._model, self._config, self._rays, self._observed = model, config, rays, observed
        self._worked, self._memory = tuple(worked), deepcopy(memory)
        self._view: tuple[Observation, V] | None = None
        self.proposing_s = 0.0

    def repeats(self, seen: Observation) -> tuple[Contact, ...]:
        return tuple(self._again(one, seen.depth) for one in self._worked)

    def propose(self, seen: Observation) -> tuple[Contact, ...]:
        began = time.process_time()
        if self._view is None or self._view[0] is not seen:
            earlier = None if self._view is None else self._view[1]
            self._view = (seen, self._model.look(seen, self._rays, earlier))
        found = find_candidates(self._model, seen, self._rays, self._memory, self._config, self._view[1])
        self.proposing_s += time.process_time() - began
        return contacts_of(found.best_of_regions(), self._observed)

    def observe(
        self, contact: Contact, executed: tuple[int, ...], reward: bool, before: Observation, after: Observation
    ) -> None:
        if reward:
            self._memory.succeeded(contact.pixel, executed[-1], before, after)
        else:
            pair = int(PAIR_OF[executed[0]])
            self._memory.failed(Failure(contact.pixel, {pair: float(contact.pairs[pair])}))

    def _again(self, one: SuccessfulAction, depth: np.ndarray) -> Contact:
        directions = np.zeros(len(DIRECTIONS))
        directions[one.direction], directions[OPPOSITE[one.direction]] = SURE, SURE / 2
        u, v = one.pixel
        return Contact(
            pixel=one.pixel,
            position=self._rays.point(depth, one.pixel),
            trigger=trigger_at(self._observed, one.pixel),
            region=int(self._memory.links[v, u]),
            belief=SURE,
            directions=directions,
            pairs=pair_scores(directions),
            step=one.step,
        )


def contacts_of(found: Candidates, observed: ObservedEpisode) -> tuple[Contact, ...]:
    """The candidates one by one, the most promising first."""
    order = np.argsort(-found.scores, kind="stable")
    pixels = [(int(u), int(v)) for u, v in found.pixels]
    return tuple(
        Contact(
            pixel=pixels[i],
            position=found.positions[i],
            trigger=trigger_at(observed, pixels[i]),
            region=int(found.regions[i]),
            belief=float(found.beliefs[i]),
            directions=found.directions[i],
            pairs=found.pairs[i],
        )
        for i in order
    )


def successful_actions(history: Episode) -> list[SuccessfulAction]:
    """The history's actions that changed the picture, as the agent itself perceived it."""
    steps = enumerate(history.steps)
    return [SuccessfulAction(number, step.pixel, step.executed[-1]) for number, step in steps if step.reward]


def memory_of(history: Episode, model: ActionModel[V], rays: Rays, config: PolicyConfig) -> BoardMemory:
    """The memory of whoever recorded the history: which links moved, what failed where.

    Raises:
        BusybotError: the history was recorded without depth.
    """
    seen = [history.observation(number) for number in range(len(history.steps) + 1)]
    memory = BoardMemory(rays.heights(seen[0].depth), config)
    for step, before, after in zip(history.steps, seen, seen[1:], strict=False):
        remember(memory, step, before, after, partial(_asked, model, before, rays, step.pixel, memory, config))
    return memory


def _asked(
    model: ActionModel[V],
    seen: Observation,
    rays: Rays,
    pixel: tuple[int, int],
    memory: BoardMemory,
    config: PolicyConfig,
) -> np.ndarray:
    return pairs_at(model, model.look(seen, rays), pixel, memory, config)
