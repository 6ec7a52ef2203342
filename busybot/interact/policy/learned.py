"""Policies that act on one board by a trained model (paper section 4.1, and section 4.2 "Data collection").

Modes of the learned policy:

- `evaluate`: try new links while the best candidate's expected success exceeds a threshold, then repeat known ones.
- `greedy`: always the highest affordance and its best direction (Table 1, row "w/o exploration").
- `ucb`: the paper's Upper Confidence Bound, P + c sqrt(ln t / N) at every elevated pixel (`ucb_bonus`).
- `collect`: a random one of the candidates, one per region, for data to reason from. The paper draws among all of them;
  here those that were not tried yet come first (`PolicyConfig.untried_first`).

With a model of the paper's networks the paper's own policy acts in all modes but `evaluate` (`interact.policy.paper`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, Literal, get_args

import numpy as np

from busybot.boards.directions import DIRECTIONS, OPPOSITE
from busybot.common.errors import BusybotError
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.interact.policy.board_memory import BoardMemory, Failure
from busybot.interact.policy.candidates import ActionModel, Candidates, V, find_candidates, held, prior_shift, smoothed
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.direction_pairs import (
    ELEVATED,
    PAIR_OF,
    better_of_pairs,
    pair_scores,
    pixel_at,
    random_pixel,
    sigmoid,
)
from busybot.interact.policy.noisy_pictures import least_depth
from busybot.interact.policy.paper import ucb_bonus
from busybot.sim.policy import Action

Mode = Literal["evaluate", "greedy", "ucb", "collect"]
MODES: tuple[Mode, ...] = get_args(Mode)
Worth = Callable[[Candidates, np.ndarray], np.ndarray]
"""What trying K candidates in the two directions of their best pairs, int (K, 2), is worth: float (K, 2), below 0 if
that is not wanted at all."""


@dataclass(frozen=True)
class ActionChoice:
    """An action and why it was chosen.

    Attributes:
        why: `new` (a link that was not moved yet), `known`, `best` (greedy and UCB) or `guess` (no candidate at all).
        belief: that something can be moved at the pixel.
        pair_belief: that the direction or its opposite does it.
    """

    pixel: tuple[int, int]
    direction: int
    why: str
    belief: float
    pair_belief: float


class LearnedPolicy(Generic[V]):
    """Chooses actions on one board by a model's affordance and by what happened before.

    It reads depth (and RGB, if the model sees colours), its own actions, their reward and which pixels they changed.

    Attributes:
        view, candidates, choice: of the last decision, for pictures. `candidates` is None in modes that have none.
        memory: what was learnt about the board.
        worth: if somebody sets it, it decides in mode `collect` instead of chance.
        within, triggers: if somebody sets them, what is known of where links are, as of `find_candidates`.
    """

    def __init__(
        self,
        model: ActionModel[V],
        rays: Rays,
        config: PolicyConfig | None = None,
        mode: Mode = "evaluate",
    ) -> None:
        self.name = policy_name(mode)
        self.worth: Worth | None = None
        self.within: np.ndarray | None = None
        self.triggers: np.ndarray | None = None
        self._model, self._rays, self._mode = model, rays, mode
        self._config = config or PolicyConfig()
        self._seen: Observation | None = None
        self._picks: list[tuple[int, int]] = []
        self.view: V | None = None
        self.memory: BoardMemory | None = None
        self.candidates: Candidates | None = None
        self.choice: ActionChoice | None = None

    def select_action(self, observation: Observation, rng: np.random.Generator) -> Action:
        view, memory = self._look(observation)
        if self._mode == "evaluate":
            choice = self._best(self._find(view, observation, memory), memory)
        elif self._mode == "collect":
            found = self._find(view, observation, memory)
            choice = self._worthiest(found, rng) if self.worth else self._random(found, memory, rng)
        else:
            choice = self._highest(view, with_bonus=self._mode == "ucb")
        self.choice = choice = choice or _guess(view.height, rng)
        self._picks.append(choice.pixel)
        return Action(choice.pixel, (choice.direction,))

    def observe(self, action: Action, executed: tuple[int, ...], reward: int, after: Observation) -> None:
        before, memory, choice = self._seen, self.memory, self.choice
        assert before is not None and memory is not None and choice is not None
        if reward:
            memory.succeeded(action.pixel, executed[-1], before, after)
        else:
            pairs = {int(PAIR_OF[choice.direction]): choice.pair_belief}
            # a failure that was expected tells little of other places
            weight = 1.0 if self.worth is None else choice.belief * choice.pair_belief
            memory.failed(Failure(action.pixel, pairs, weight))

    def _look(self, observation: Observation) -> tuple[V, BoardMemory]:
        if self.view is None or observation is not self._seen:
            self._seen, self.view = observation, self._model.look(observation, self._rays, self.view)
        if self.memory is None:
            self.memory = BoardMemory(self.view.height, self._config, least_depth(observation.depth))
        return self.view, self.memory

    def _find(self, view: V, seen: Observation, memory: BoardMemory) -> Candidates:
        self.candidates = find_candidates(
            self._model, seen, self._rays, memory, self._config, view, self.within, self.triggers
        )
        return self.candidates

    def _best(self, found: Candidates, memory: BoardMemory) -> ActionChoice | None:
        """The most promising new link while that promises enough, else the safest known one, else any."""
        new, known = found.take(found.regions < 0), found.take(found.regions > 0)
        enough = np.where(memory.tried(new.pixels), self._config.insist, self._config.explore)
        promising = new.take(new.scores >= enough) if len(known) else new
        if len(promising):
            return _chosen(promising, int(promising.scores.argmax()), "new")
        return _chosen(known, int(known.scores.argmax()), "known") if len(known) else None

    def _random(self, found: Candidates, memory: BoardMemory, rng: np.random.Generator) -> ActionChoice | None:
        """Any new candidate of enough promise or known link; of its pair, the directions by their probabilities."""
        if not len(found):
            return None
        known, config = found.regions > 0, self._config
        if config.persist and not known.all() and rng.random() < config.persist:
            new = found.take(~known)
            return _chosen(new, int((new.scores / (1 + memory.visits(self._picks, new.pixels))).argmax()), "new")
        good = known | (found.scores >= config.collect)
        untried = good & ~known & ~memory.tried_here(found.pixels)
        if config.untried_first and untried.any():
            good = untried
        if not good.any():
            good = found.scores >= found.scores.max()
        found = found.take(good)
        if config.candidates == "peaks":  # of the paper's clusters each has one
            found = found.best_of_regions()
        index = int(rng.integers(len(found)))
        choice = _any(found, index)
        two = [choice.direction, int(OPPOSITE[choice.direction])]
        weights = found.directions[index, two] + 1e-6
        direction = two[int(rng.random() * weights.sum() > weights[0])]
        return replace(choice, direction=direction)

    def _worthiest(self, found: Candidates, rng: np.random.Generator) -> ActionChoice | None:
        """What is worth most; chance decides among equals."""
        assert self.worth is not None
        ways = np.stack([found.best_directions, np.asarray(OPPOSITE)[found.best_directions]], axis=1)
        values = self.worth(found, ways)
        if values.max(initial=-1) < 0:
            return None
        index, way = rng.permutation(np.argwhere(values >= values.max()))[0].tolist()
        return replace(_any(found, index), direction=int(ways[index, way]))

    def _highest(self, view: V, with_bonus: bool) -> ActionChoice | None:
        """The pixel with the highest affordance, with the paper's bonus or without."""
        scores = sigmoid(smoothed(view.affordance, self._config.blur) + prior_shift(self._config))
        if with_bonus:
            scores = scores + ucb_bonus(scores.shape, self._picks, self._config.ucb_c, self._config.ucb_window)
        scores[~held(view.affordance)] = -1
        if scores.max() < 0:
            return None
        pixel = pixel_at(scores.argmax(), scores.shape)
        _, answer = self._model.directions(view, np.array([pixel]))
        directions = np.asarray(answer, float)
        pairs = pair_scores(directions)
        direction = int(better_of_pairs(directions, pairs.argmax(axis=1))[0])
        return ActionChoice(pixel, direction, "best", float(scores.max()), float(pairs.max()))


def mode_named(name: str) -> Mode:
    """The mode of that name, or an error that lists them."""
    if name not in MODES:
        raise BusybotError(f"the learned policy has no mode {name!r}", f"choose {', '.join(MODES)}")
    return name


def policy_name(mode: Mode) -> str:
    """Name of the policy in episodes."""
    return "learned" if mode == "collect" else f"learned-{mode}"


def _chosen(found: Candidates, index: int, why: str) -> ActionChoice:
    column, row = map(int, found.pixels[index])
    direction, pair = int(found.best_directions[index]), found.best_pairs[index]
    return ActionChoice((column, row), direction, why, float(found.beliefs[index]), float(found.pairs[index, pair]))


def _any(found: Candidates, index: int) -> ActionChoice:
    return _chosen(found, index, "known" if found.regions[index] > 0 else "new")


def _guess(height: np.ndarray, rng: np.random.Generator) -> ActionChoice:
    """Any elevated pixel, any direction."""
    pixel = random_pixel(height > ELEVATED, rng)
    return ActionChoice(pixel, int(rng.integers(len(DIRECTIONS))), "guess", 0.1, 0.1)
