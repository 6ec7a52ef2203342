"""Proposes contacts to agents: those that worked in the history, and those of the interaction model on a picture."""

import time
from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import Generic, Protocol

import numpy as np

from busybot.boards.directions import DIRECTIONS, OPPOSITE
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Episode, Observation, Step
from busybot.interact.policy.board_memory import BoardMemory, Failure
from busybot.interact.policy.candidates import ActionModel, V, find_candidates, pairs_at
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.direction_pairs import PAIR_OF, pair_scores
from busybot.interact.policy.noisy_pictures import least_depth
from busybot.interact.policy.policy_trace import remember
from busybot.plan.interfaces import Contact, TaskContext
from busybot.reason.inputs.observation import ObservedEpisode, trigger_at

SURE = 0.97
"""Belief in a contact that has worked."""


class ContactProposals(Protocol):
    """Offers contacts on one board, and is told what came of them."""

    proposing_s: float = 0.0
    """CPU seconds that were spent in models that look at pictures."""

    def repeats(self, seen: Observation) -> tuple[Contact, ...]:
        """What worked in the history."""
        return ()

    def unrewarded(self, seen: Observation) -> tuple[Contact, ...]:
        """What changed no picture in the history."""
        return ()

    def propose(self, seen: Observation) -> tuple[Contact, ...]:
        """What seems possible now."""
        ...

    def observe(
        self, contact: Contact, executed: tuple[int, ...], reward: bool, before: Observation, after: Observation
    ) -> None:
        """What came of an action."""
        return


class LearnedProposals(ContactProposals, Generic[V]):
    """From an interaction model and a memory that has seen the history.

    Args:
        observed: the recorded interactions.
        briefing: says which of them worked.
        memory: it is copied.
    """

    def __init__(
        self,
        model: ActionModel[V],
        config: PolicyConfig,
        rays: Rays,
        observed: ObservedEpisode,
        briefing: TaskContext,
        memory: BoardMemory,
    ):
        self._model, self._config, self._rays, self._observed = model, config, rays, observed
        self._briefing, self._memory = briefing, deepcopy(memory)
        self._view: tuple[Observation, V] | None = None

    def repeats(self, seen: Observation) -> tuple[Contact, ...]:
        return tuple(self._again(step, seen.depth) for step in np.flatnonzero(self._briefing.worked >= 0).tolist())

    def unrewarded(self, seen: Observation) -> tuple[Contact, ...]:
        steps = np.flatnonzero(self._briefing.worked < 0).tolist()
        return tuple(replace(self._again(step, seen.depth), belief=0.0) for step in steps)

    def propose(self, seen: Observation) -> tuple[Contact, ...]:
        """The interaction model's candidates, the most promising first."""
        began = time.process_time()
        if self._view is None or self._view[0] is not seen:
            earlier = None if self._view is None else self._view[1]
            self._view = (seen, self._model.look(seen, self._rays, earlier))
        found = find_candidates(self._model, seen, self._rays, self._memory, self._config, self._view[1])
        self.proposing_s += time.process_time() - began
        best = found.best_of_regions()
        pixels = [(int(u), int(v)) for u, v in best.pixels]
        return tuple(
            Contact(
                pixel=pixels[i],
                position=best.positions[i],
                trigger=trigger_at(self._observed, pixels[i]),
                region=int(best.regions[i]),
                belief=float(best.beliefs[i]),
                directions=best.directions[i],
                pairs=best.pairs[i],
            )
            for i in np.argsort(-best.scores, kind="stable")
        )

    def observe(
        self, contact: Contact, executed: tuple[int, ...], reward: bool, before: Observation, after: Observation
    ) -> None:
        if reward:
            self._memory.succeeded(contact.pixel, executed[-1], before, after)
        else:
            pair = int(PAIR_OF[executed[0]])
            self._memory.failed(Failure(contact.pixel, {pair: float(contact.pairs[pair])}))

    def _again(self, step: int, depth: np.ndarray) -> Contact:
        """What was done in a step of the history, as the picture shows its pixel now."""
        directions, worked = np.zeros(len(DIRECTIONS)), int(self._briefing.worked[step])
        first = worked if worked >= 0 else int((DIRECTIONS @ self._briefing.history.actions[step, 3:]).argmax())
        directions[first], directions[OPPOSITE[first]] = SURE, SURE / 2
        u, v = self._briefing.pixels[step].tolist()
        region = int(self._memory.links[v, u])
        return sure_contact(self._observed, (u, v), self._rays.point(depth, (u, v)), region, directions, step)


def sure_contact(
    observed: ObservedEpisode,
    pixel: tuple[int, int],
    position: np.ndarray,
    region: int,
    directions: np.ndarray,
    step: int = -1,
) -> Contact:
    """A contact of which it is known that something can be moved there."""
    return Contact(
        pixel, position, trigger_at(observed, pixel), region, SURE, directions, pair_scores(directions), step
    )


def memory_of(history: Episode, model: ActionModel[V], rays: Rays, config: PolicyConfig) -> BoardMemory:
    """The memory of whoever recorded the history: which links moved, what failed where.

    Raises:
        BusybotError: the history was recorded without depth.
    """
    seen = [history.observation(number) for number in range(len(history.steps) + 1)]
    memory = BoardMemory(rays.heights(seen[0].depth), config, least_depth(seen[0].depth))

    def asked(step: Step, before: Observation) -> np.ndarray:
        return pairs_at(model, model.look(before, rays), step.pixel, memory, config)

    for step, before, after in zip(history.steps, seen, seen[1:], strict=False):
        remember(memory, step, before, after, partial(asked, step, before))
    return memory
