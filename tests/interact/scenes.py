"""A board of boxes seen from straight above, as depth; and a model that finds buttons by their height."""

from dataclasses import dataclass

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from tests.episodes.synthetic import make_camera

WIDTH, HEIGHT = 160, 120
RAYS = Rays(make_camera(WIDTH, HEIGHT))
BODY, BUTTON, PRESSED = 0.2, 0.3, 0.25

Box = tuple[int, int, int, int]
"""u0, v0, u1, v1 (exclusive)."""


def picture(*boxes: tuple[Box, float]) -> Observation:
    """What is seen of boxes of some height on the board."""
    heights = np.zeros((HEIGHT, WIDTH), np.float32)
    for (u0, v0, u1, v1), height in boxes:
        heights[v0:v1, u0:u1] = height
    rgb = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    return Observation(rgb, (4 - heights).astype(np.float32), RAYS.camera)


@dataclass
class HeightView:
    height: np.ndarray
    affordance: np.ndarray


class ButtonModel:
    """Takes everything higher than a switch's body for a button that moves along z."""

    def look(self, seen: Observation, rays: Rays, earlier: HeightView | None = None) -> HeightView:
        height = rays.heights(seen.depth)
        logits = np.where(height > (BODY + PRESSED) / 2, 5.0, -5.0)
        return HeightView(height, np.where(height > 0.002, logits, -20).astype(np.float32))

    def directions(self, view: HeightView, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        works = np.where(np.abs(DIRECTIONS[:, 2]) > 0.9, 0.95, 0.05)
        return view.affordance[pixels[:, 1], pixels[:, 0]], np.tile(works, (len(pixels), 1))
