"""The paper's policy on one board (section 3.1 and appendix A.1): affordance with a bonus for new places, and epsilon.

What the paper leaves open: positions are pixels that lie above the board, because nothing else can be held; in the
first 10 epochs, and where epsilon says so, one of them is drawn, all alike. Where all directions are tried, each is
followed by its opposite, in a random order, until one works. For t and N of the bonus see `interact.ucb`.
"""

from typing import Annotated, Generic

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.episode import Image
from busybot.episodes.geometry import Rays
from busybot.interact.beliefs import ELEVATED, sigmoid
from busybot.interact.candidates import ActionModel, V
from busybot.interact.ucb import ucb_bonus
from busybot.sim.policies import Action, Forgetful

Share = Annotated[float, Field(ge=0, le=1)]


class PaperRules(BaseModel):
    """How the paper's policy chooses.

    Attributes:
        epsilon_position, epsilon_direction: share of random choices.
        all_directions: try all directions until one works, instead of one.
        ucb_c, ucb_window: of the bonus; c = 0 is the row "w/o exploration" of Table 1.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    epsilon_position: Share = 0.0
    epsilon_direction: Share = 0.0
    all_directions: bool = False
    ucb_c: Annotated[float, Field(ge=0)] = 0.5
    ucb_window: Annotated[int, Field(ge=2, le=200, multiple_of=2)] = 10

    def needs_model(self) -> bool:
        """Whether a network is asked at all."""
        return self.epsilon_position < 1 or (self.epsilon_direction < 1 and not self.all_directions)


class PaperPolicy(Forgetful, Generic[V]):
    """Reads depth (and RGB, if the model sees colours) and where it acted before.

    Args:
        model: None where the rules leave everything to chance.
    """

    oracle = False

    def __init__(self, model: ActionModel[V] | None, rays: Rays, rules: PaperRules, name: str):
        self.name = name
        self._model, self._rays, self._rules = model, rays, rules
        self._picks: list[tuple[int, int]] = []
        self._image: Image | None = None
        self._view: V | None = None

    def choose(self, image: Image, rng: np.random.Generator) -> Action:
        random_position, random_direction = rng.random(2) < (
            self._rules.epsilon_position,
            self._rules.epsilon_direction,
        )
        pixel = self._random_position(image, rng) if random_position else self._best_position(image, rng)
        self._picks.append(pixel)
        if self._rules.all_directions:
            return Action(pixel, tuple(map(int, rng.permutation(len(DIRECTIONS)))))
        if random_direction:
            return Action(pixel, (int(rng.integers(len(DIRECTIONS))),))
        view = self._look(image)
        assert self._model is not None
        _, scores = self._model.directions(view, np.array([pixel]))
        return Action(pixel, (int(np.asarray(scores)[0].argmax()),))

    def _best_position(self, image: Image, rng: np.random.Generator) -> tuple[int, int]:
        """The elevated pixel with the highest P + c sqrt(ln t / N)."""
        elevated = self._elevated(image)
        if not elevated.any():
            return self._random_position(image, rng)
        affordance = sigmoid(self._look(image).affordance)
        scores = affordance + ucb_bonus(affordance.shape, self._picks, self._rules.ucb_c, self._rules.ucb_window)
        row, column = divmod(int(np.where(elevated, scores, -1).argmax()), scores.shape[1])
        return column, row

    def _random_position(self, image: Image, rng: np.random.Generator) -> tuple[int, int]:
        elevated = np.flatnonzero(self._elevated(image))
        assert image.depth is not None
        chosen = int(rng.choice(elevated)) if len(elevated) else int(rng.integers(image.depth.size))
        row, column = divmod(chosen, image.depth.shape[1])
        return column, row

    def _elevated(self, image: Image) -> np.ndarray:
        assert image.depth is not None
        return np.nan_to_num(self._rays.heights(image.depth), nan=-1) > ELEVATED

    def _look(self, image: Image) -> V:
        assert self._model is not None
        if self._view is None or image is not self._image:
            self._image, self._view = image, self._model.look(image, self._rays)
        return self._view
