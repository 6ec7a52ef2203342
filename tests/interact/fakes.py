"""Models that know the truth, for tests of the policy: affordance from the segmentation, directions from the joints."""

from dataclasses import dataclass

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.common.rng import generator
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.interact.policy.config import PolicyConfig
from busybot.interact.policy.learned import LearnedPolicy, Mode
from busybot.sim.interaction import InteractionConfig, permitted, pull
from busybot.sim.policy import OracleObservation, Policy, privileged
from busybot.sim.scene.board_scene import BoardScene


@dataclass
class FakeView:
    height: np.ndarray
    affordance: np.ndarray
    seen: OracleObservation
    rays: Rays


class OracleModel:
    """Sees which pixels show a trigger link and finds out by pulling which directions work; with noise on both.

    Args:
        noise: standard deviation of the logits' noise, smooth over some pixels.
    """

    def __init__(self, scene: BoardScene, config: InteractionConfig, noise: float = 0.0, seed: int = 0):
        self._scene, self._config, self._noise = scene, config, noise
        self._rng = generator(seed, "", scene.spec.index, "oracle model")
        self._known: dict[tuple[object, ...], np.ndarray] = {}

    def look(self, seen: Observation, rays: Rays, earlier: FakeView | None = None) -> FakeView:
        seen = privileged(seen)
        height = np.nan_to_num(rays.heights(seen.depth), nan=-1)
        codes = [code for code in range(int(seen.segmentation.max()) + 1) if self._scene.trigger_at(code) is not None]
        logits = np.where(np.isin(seen.segmentation, codes), 4.0, -4.0)
        coarse = self._rng.normal(0, self._noise, (height.shape[0] // 4 + 1, height.shape[1] // 4 + 1))
        logits += np.kron(coarse, np.ones((4, 4)))[: height.shape[0], : height.shape[1]]
        return FakeView(height, np.where(height > 0.002, logits, -20).astype(np.float32), seen, rays)

    def directions(self, view: FakeView, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        works = np.stack([self._works(view, (int(u), int(v))) for u, v in pixels])
        noise = self._rng.normal(0, self._noise, works.shape)
        return view.affordance[pixels[:, 1], pixels[:, 0]], 1 / (1 + np.exp(-(np.where(works, 4, -4) + noise)))

    def _works(self, view: FakeView, pixel: tuple[int, int]) -> np.ndarray:
        number = self._scene.trigger_at(int(view.seen.segmentation[pixel[1], pixel[0]]))
        if number is None:
            return np.zeros(len(DIRECTIONS), bool)
        state = self._scene.triggers[number].state
        key = (number, pixel, state)
        if key not in self._known:
            point = view.rays.point(view.seen.depth, pixel)
            works = []
            for index, direction in enumerate(DIRECTIONS):
                reached = pull(self._scene, number, point, direction, self._config, None)[1] != state
                works.append(
                    reached and (not self._config.strict or permitted(self._scene, number, index, self._config))
                )
            self._known[key] = np.array(works)
        return self._known[key]


@dataclass(frozen=True)
class TruthFactory:
    """Makes the learned policy with a model that knows the truth."""

    mode: Mode = "evaluate"
    noise: float = 0.0
    config: PolicyConfig = PolicyConfig()
    name: str = "learned-evaluate"

    def make_oracle(self, scene: BoardScene, rays: Rays, config: InteractionConfig) -> Policy:
        return LearnedPolicy(OracleModel(scene, config, self.noise), rays, self.config, self.mode)
