"""Other shapes of the environment's actions and observations, as libraries for learning agents want them.

They wrap `busybot/Board-v0` (`sim.env.BusyBoardEnv`), one around the other; Gymnasium's own wrappers go around them.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs

from busybot.boards.directions import DIRECTIONS
from busybot.common.errors import BusybotError
from busybot.sim.env import BusyBoardEnv

Observation = dict[str, Any]
Core = dict[str, Any]


class PixelActions(gymnasium.ActionWrapper[Observation, np.ndarray, Core], RecordConstructorArgs):
    """Act on a pixel: the position is what the depth image shows there.

    ## Action space
    `MultiDiscrete([H, W, 18])`: row and column of the image, and the direction's index.
    """

    def __init__(self, env: gymnasium.Env[Observation, Core]):
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        height, width = _board(env).observation_space["depth"].shape  # type: ignore[index]
        self.action_space = spaces.MultiDiscrete([height, width, len(DIRECTIONS)])

    def action(self, action: np.ndarray) -> Core:
        """The core environment's action. A pixel where the camera sees nothing lies at the camera: a miss."""
        if not self.action_space.contains(np.asarray(action, np.int64)):
            raise BusybotError(f"the action {action} is not one", f"it must lie in {self.action_space}")
        row, column, direction = (int(value) for value in action)
        return {"position": _board(self.env).position_at(row, column), "direction": direction}


class ImageObservations(gymnasium.ObservationWrapper[np.ndarray, Any, Observation], RecordConstructorArgs):
    """One array instead of a dictionary, with the channels first, as convolutions want it.

    ## Observation space
    `rgb`: uint8 (3, H, W). `depth`: float32 (1, H, W), board units. `rgbd`: float32 (4, H, W), colours from 0 to 1,
    then depth.
    """

    def __init__(self, env: gymnasium.Env[Observation, Any], kind: str = "rgb"):
        RecordConstructorArgs.__init__(self, kind=kind)
        super().__init__(env)
        if kind not in ("rgb", "depth", "rgbd"):
            raise BusybotError(f"there are no observations {kind!r}", "choose rgb, depth or rgbd")
        self.kind = kind
        assert isinstance(env.observation_space, spaces.Dict)
        colours, depth = env.observation_space["rgb"], env.observation_space["depth"]
        assert isinstance(depth, spaces.Box) and colours.shape is not None
        shape, far = depth.shape, float(depth.high.max())
        shown: dict[str, spaces.Space[np.ndarray]] = {
            "rgb": spaces.Box(0, 255, (3, *shape), np.uint8),
            "depth": spaces.Box(0, far, (1, *shape), np.float32),
            "rgbd": spaces.Box(0, max(far, 1.0), (4, *shape), np.float32),
        }
        self.observation_space = shown[kind]

    def observation(self, observation: Observation) -> np.ndarray:
        """The wrapped environment's observation as one array."""
        colours, depth = np.moveaxis(observation["rgb"], -1, 0), observation["depth"][None]
        if self.kind == "rgb":
            return np.ascontiguousarray(colours)
        if self.kind == "depth":
            return np.asarray(depth)
        return np.concatenate([colours.astype(np.float32) / 255, depth])


def _board(env: gymnasium.Env[Any, Any]) -> BusyBoardEnv:
    core = env.unwrapped
    if not isinstance(core, BusyBoardEnv):
        raise BusybotError(f"{core} is not a BusyBoard", "wrap busybot/Board-v0")
    return core
