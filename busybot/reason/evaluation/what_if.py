"""Questions "what if" that a board's law answers and a model is asked; for evaluators only.

Both kinds of questions are asked in terms of recorded contacts, and of the directions that worked there, so that a
model needs no names of links or states.

- A *tour* (`tour`) goes on where the observed images end: one link after the other moves, so that the inputs of every
  mechanism come in all combinations that recorded contacts lead to, least seen ones first. A mechanism is known when
  all that its responder shows on the tour is foretold: that is functional equality, whatever the model calls it. Luck
  plays no part: what may fail succeeds, and nothing moves by itself.
- *Pairs* (`pairs`) ask about what was observed: the next states as it was, and had one link not been moved. Both have
  to be told rightly. The truth is the board run again, with the same luck. Luck that made no difference as it was may
  make one had that link not been moved: nobody can know it, whatever he knows of the board (`Hindsight`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from busybot.boards.directions import DIRECTIONS, OPPOSITE
from busybot.boards.dynamics import Bound, Dynamics, DynamicState, Triggers
from busybot.boards.mechanisms.base import Luck
from busybot.common.errors import BusybotError
from busybot.episodes.episode import Episode, Step
from busybot.reason.evaluation.hypotheses import Branches, paths

TOUR = 40
"""A tour has so many actions."""
PAIRS, HORIZON = 8, 4
"""So many pairs a board, over so many actions: one more than the longest delay."""


class Recalled(Branches):
    """Luck that goes the ways that it went once; beyond them, and where it cannot go there, the likeliest."""

    def pick(self, weights: Sequence[float]) -> int:
        number = len(self.taken)
        if number >= len(self.path) or not weights[self.path[number]]:
            self.path = (*self.path[:number], int(np.argmax(weights)), *self.path[number + 1 :])
        return super().pick(weights)


@dataclass(frozen=True)
class Contacts:
    """Recorded actions that move trigger links, by number of link, state before and state after.

    Attributes:
        actions: float32 (6,), as of `BoardSequence`.
        acted: index of the trigger acted on.
    """

    actions: dict[tuple[int, int, int], np.ndarray]
    acted: dict[tuple[int, int, int], int]

    def __contains__(self, move: tuple[int, int, int]) -> bool:
        return move in self.actions


def contacts_of(episode: Episode, actions: np.ndarray, acted: np.ndarray, sizes: Sequence[int]) -> Contacts:
    """A contact for every move of a link that was seen moving: recorded ones, else the nearest with the direction
    that this move needs.

    Args:
        actions, acted: of all steps, as of `causes.Watched`.
        sizes: number of states of each link.
    """
    exact: dict[tuple[int, int, int], tuple[int, np.ndarray]] = {}
    found: dict[tuple[int, int, int], tuple[int, np.ndarray]] = {}
    for number, step in enumerate(episode.steps):
        moved = moved_link(step)
        if moved is not None:
            link, before, after = moved, step.trigger_states_before[moved], step.trigger_states_after[moved]
            exact[link, before, after] = (number, actions[number])
            rising, done = after > before, (step.direction, *step.executed)[-1]
            for low in range(sizes[link] - 1):
                for move in ((link, low, low + 1), (link, low + 1, low)):
                    worked = done if (move[2] > move[1]) == rising else OPPOSITE[done]
                    other = np.array([*actions[number][:3], *DIRECTIONS[worked]], np.float32)
                    found.setdefault(move, (number, other))
    found |= exact
    return Contacts(
        {move: action for move, (_, action) in found.items()},
        {move: int(acted[number]) for move, (number, _) in found.items()},
    )


def moved_link(step: Step) -> int | None:
    """The number of the link that an action moved, None if it moved none."""
    differing = np.flatnonzero(np.array(step.trigger_states_before) != np.array(step.trigger_states_after))
    return int(differing[0]) if len(differing) == 1 else None


@dataclass(frozen=True)
class Questions:
    """What a model is asked, and the truth. Q questions of K actions, L links, N objects.

    Attributes:
        steps: int (Q,), how many recorded actions come before.
        actions: float32 (Q, K, 6).
        acted: int (Q, K).
        triggers: int (Q, K + 1, L), states of the links, before and after each action.
        shown: int (Q, K + 1, N), the same of the responders.
        asked: bool (Q, K), which actions' outcomes are judged.
    """

    steps: np.ndarray
    actions: np.ndarray
    acted: np.ndarray
    triggers: np.ndarray
    shown: np.ndarray
    asked: np.ndarray


def tour(
    dynamics: Dynamics,
    triggers: Triggers,
    state: DynamicState,
    contacts: Contacts,
    steps: int,
    rng: np.random.Generator,
) -> Questions:
    """One question of `TOUR` actions.

    Args:
        dynamics: of the board, without luck and without what is rewired later.
        triggers, state: after the observed actions.
        steps: how many were observed.
    """
    reads = [bound.inputs for bound in dynamics.bound_at(state.tick)]
    visits: dict[tuple[int, tuple[int, ...]], int] = {}
    path, shown, actions, acted = [triggers], [state.shown], [], []
    for _ in range(TOUR):
        moves = [(move, one) for move in dynamics.moves(triggers, state) if (one := _move(triggers, move)) in contacts]
        options: list[tuple[Triggers, tuple[int, int, int] | None]] = [*moves, (triggers, None)]
        keys = [
            [(number, _read(inputs, there, state.shown)) for number, inputs in enumerate(reads)] for there, _ in options
        ]
        # to do nothing tells least
        worth = [
            sum(visits.get(key, 0) for key in own) + (one is None) for own, (_, one) in zip(keys, options, strict=True)
        ]
        best = np.flatnonzero(np.array(worth) == min(worth))
        chosen = int(best[int(rng.integers(len(best)))])
        triggers, move = options[chosen]
        for key in keys[chosen]:
            visits[key] = visits.get(key, 0) + 1
        state = dynamics.step(triggers, state)
        path.append(triggers)
        shown.append(state.shown)
        actions.append(np.zeros(6, np.float32) if move is None else contacts.actions[move])
        acted.append(-1 if move is None else contacts.acted[move])
    return Questions(
        np.array([steps]), np.stack(actions)[None], np.array([acted]),
        np.array([path]), np.array([shown]), np.ones((1, TOUR), bool),
    )  # fmt: skip


def _move(before: Triggers, after: Triggers) -> tuple[int, int, int]:
    for link, (here, there) in enumerate(zip(before, after, strict=True)):
        if here != there:
            return link, here, there
    return -1, 0, 0


def _read(inputs: Sequence[tuple[int, bool]], triggers: Triggers, shown: Sequence[int]) -> tuple[int, ...]:
    return tuple(shown[place] if responder else triggers[place] for place, responder in inputs)


@dataclass(frozen=True)
class Pairs:
    """Pairs of questions about what was observed. P pairs, N objects.

    Attributes:
        happened: as it was.
        otherwise: the same, had the first action moved nothing.
        unlucky: bool (P, N), responders whose answers to the latter depend on luck that did not show, and came out less
            likely: who knows the board's law and all states, and guesses the likeliest, answers wrongly.
    """

    happened: Questions
    otherwise: Questions
    unlucky: np.ndarray

    def after(self, action: int) -> np.ndarray:
        """Which ask about the action of that number, from 0, or a later one, bool (P,)."""
        asked = self.happened.asked
        return np.asarray(self.happened.steps + np.where(asked, np.arange(1, asked.shape[1] + 1), 0).max(1) > action)


class Hindsight(Dynamics):
    """A board's law as somebody knows it who has seen all its states: luck that showed is known, other luck is guessed.

    Args:
        dynamics: of the board, with its luck.
        triggers: int (T + 1, L), as observed, on the new board and after each action.
        states: the T + 1 states of the board that they led to.
    """

    def __init__(self, dynamics: Dynamics, triggers: np.ndarray, states: Sequence[DynamicState]):
        super().__init__(dynamics.board, dynamics.links, dynamics.lucky)
        self._triggers, self._states = triggers.tolist(), states

    def chance(self, bound: Bound, tick: int) -> Luck:
        """The likeliest luck after which the responder would have shown what it showed then; the true one of mechanisms
        that draw it in ways that nobody can list."""
        before, after = self._states[tick : tick + 2]
        number, shown = self.bound_at(tick).index(bound), after.shown[bound.responder]
        inputs, memory = bound.read(self._triggers[tick + 1], before.shown), before.memories[number]
        try:
            might = paths(lambda luck: bound.mechanism.step(inputs, memory, luck)[0])
        except BusybotError:
            return super().chance(bound, tick)
        showing = [(path, weight) for path, weight, state in might if state == shown]
        path, _ = max(showing, key=lambda one: one[1], default=((), 0.0))
        return cast(Luck, Recalled(path))


def pairs(
    dynamics: Dynamics,
    episode: Episode,
    actions: np.ndarray,
    acted: np.ndarray,
    triggers: np.ndarray,
    states: Sequence[DynamicState],
    judged: np.ndarray,
) -> Pairs | None:
    """Pairs of questions about the observed actions: as it was, and had the first of these actions moved nothing.

    A question ends before the next action of which nobody knows what it would have done: on the same link, or on one
    that is held in one of the two cases alone. Pairs with equal answers are left out.

    Args:
        dynamics: of the board, with its luck.
        actions, acted: of the observed steps, as of `causes.Watched`.
        triggers, states: of all recorded steps, as of `Hindsight`.
        judged: bool (N,), the responders whose answers are compared.

    Returns:
        None if there are none.
    """
    known = Hindsight(dynamics, triggers, states)
    moved = [moved_link(step) for step in episode.steps]
    found = []
    for place in (step for step in range(len(actions)) if moved[step] is not None):
        paths, shown, guessed = _without(dynamics, known, episode.steps[: len(actions)], moved, states, place)
        length, rows = len(paths) - 1, slice(place, place + len(paths))
        real = [one.shown for one in states[rows]]
        if np.array_equal(np.array(real)[:, judged], np.array(shown)[:, judged]):
            continue
        done, on = np.zeros((HORIZON, 6), np.float32), np.full(HORIZON, -1)
        done[:length], on[:length] = actions[place : place + length], acted[place : place + length]
        without, nobody = done.copy(), on.copy()
        without[0], nobody[0] = 0, -1
        asked = np.arange(HORIZON) < length
        happened = _question(place, done, on, triggers[rows], real, asked)
        otherwise = _question(place, without, nobody, paths, shown, asked)
        found.append(Pairs(happened, otherwise, (np.array(guessed) != np.array(shown)).any(0)[None]))
    if not found:
        return None
    kept = [found[k] for k in np.unique(np.linspace(0, len(found) - 1, min(PAIRS, len(found))).round().astype(int))]
    happened, otherwise = (_together([getattr(one, name) for one in kept]) for name in ("happened", "otherwise"))
    return Pairs(happened, otherwise, np.concatenate([one.unlucky for one in kept]))


def _without(
    dynamics: Dynamics,
    known: Hindsight,
    steps: Sequence[Step],
    moved: Sequence[int | None],
    states: Sequence[DynamicState],
    place: int,
) -> tuple[list[Triggers], list[tuple[int, ...]], list[tuple[int, ...]]]:
    """States of the trigger links and of the responders had that action moved nothing, and what hindsight makes of the
    latter, before and after each action until nobody knows what the next one would have done."""
    link, triggers, state = moved[place], steps[place].trigger_states_before, states[place]
    assert link is not None
    guess, paths, shown, guessed = state, [triggers], [state.shown], [state.shown]
    for number, step in enumerate(steps[place : place + HORIZON], start=place):  # what was not observed is not asked
        now, name = moved[number], (step.acted_object, step.acted_link)
        if number > place and name in dynamics.links.names:
            touched = dynamics.links.names.index(name)
            held = [dynamics.locked(touched, one.shown) for one in (state, states[number])]
            if touched == link or held[0] != held[1]:
                break
        if number > place and now is not None:
            triggers = (*triggers[:now], step.trigger_states_after[now], *triggers[now + 1 :])
        state, guess = dynamics.step(triggers, state), known.step(triggers, guess)
        paths.append(triggers)
        shown.append(state.shown)
        guessed.append(guess.shown)
    return paths, shown, guessed


def _question(
    place: int,
    actions: np.ndarray,
    acted: np.ndarray,
    triggers: Sequence[Sequence[int]] | np.ndarray,
    shown: Sequence[Sequence[int]],
    asked: np.ndarray,
) -> Questions:
    """One question; states after its end repeat the last ones."""
    rows = np.minimum(np.arange(HORIZON + 1), len(triggers) - 1)
    return Questions(
        np.array([place]), actions[None], acted[None],
        np.array(triggers)[rows][None], np.array(shown)[rows][None], asked[None],
    )  # fmt: skip


def _together(questions: Sequence[Questions]) -> Questions:
    return Questions(*(np.concatenate([vars(one)[name] for one in questions]) for name in vars(questions[0])))


def told_rightly(read: np.ndarray, questions: Questions) -> np.ndarray:
    """Whether each responder is told rightly after all judged actions, bool (Q, N).

    Args:
        read: int (Q, K, N), the states that a model's answers show.
    """
    right = (read == questions.shown[:, 1:]) | ~questions.asked[..., None]
    return np.asarray(right.all(axis=1))
