"""Boards of coloured boxes seen from above, drawn pixel by pixel, for tests of reasoning."""

from dataclasses import dataclass, field, replace

import numpy as np

from busybot.episodes.episode import Image
from busybot.reason.inputs.observation import NO_BOXES, ObservedAction, ObservedEpisode
from tests.episodes.synthetic import make_camera

BOARD_DEPTH = 4.0


@dataclass(frozen=True)
class Patch:
    """A flat thing: its pixels u0, v0, u1, v1, its colour and its height above the board, board units."""

    area: tuple[int, int, int, int]
    color: tuple[int, int, int]
    height: float = 0.2


@dataclass
class Scene:
    """Objects with roles and first-frame boxes, and frames of patches drawn in order."""

    roles: tuple[str, ...]
    boxes: list[tuple[int, int, int, int]]
    frames: list[list[Patch]]
    pixels: list[tuple[int, int]] = field(default_factory=list)
    depth: bool = True

    def observed(self) -> ObservedEpisode:
        images = [self._draw(patches) for patches in self.frames]
        pixels = self.pixels or [(0, 0)] * (len(self.frames) - 1)
        return ObservedEpisode(
            camera=make_camera(),
            roles=self.roles,
            boxes=np.array(self.boxes, np.int16),
            positions=np.zeros((len(self.roles), 3), np.float32),
            actions=tuple(ObservedAction(pixel, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)) for pixel in pixels),
            images=images,
            image_of=tuple(range(len(images))),
        )

    def without_depth(self) -> "Scene":
        return replace(self, depth=False)

    def _draw(self, patches: list[Patch]) -> Image:
        rgb = np.full((120, 160, 3), 128, np.uint8)
        depth = np.full((120, 160), BOARD_DEPTH, np.float32)
        for patch in patches:
            u0, v0, u1, v1 = patch.area
            rgb[v0:v1, u0:u1] = patch.color
            depth[v0:v1, u0:u1] = BOARD_DEPTH - patch.height
        return Image(rgb, depth if self.depth else None, None, NO_BOXES)
