"""The record of one episode as plain data: the common tongue of recording, training and viewing.

Frames: the board frame of `boards.spec`; pixels are (column u, row v) from the upper left corner. The camera frame is
OpenCV's: x right, y down, z forward; depth is the distance along z in board units.

Frame 0 is the initial observation; step k (from 0) leads from frame k to frame k + 1. Images that did not change are
stored once: `Episode.frame_of[k]` is the index of the stored image that shows frame k.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, overload

import numpy as np

from busybot.boards.directions import DIRECTIONS
from busybot.boards.spec import BoardSpec
from busybot.common.errors import BusybotError, naming

SALVAGED = "salvaged"
"""Among the settings of an episode that was saved in part: {"of": steps that were recorded}."""
ENDED = "ended"
"""Among the settings of an episode that its policy ended before its last step: {"of": steps that it might have had}."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Attributes:
        matrix: intrinsics, shape (3, 3), pixels.
        pose: camera frame to board frame, shape (4, 4), board units.
    """

    width: int
    height: int
    matrix: np.ndarray
    pose: np.ndarray


@dataclass(frozen=True)
class Link:
    """A link that segmentation can name: `object` indexes the board's objects."""

    object: int
    name: str
    trigger: bool


@dataclass(frozen=True, eq=False)
class Observation:
    """What a robot has of a frame; nothing in it is privileged.

    Attributes:
        rgb: uint8 (H, W, 3).
        depth: float32 (H, W), board units, 0 where nothing was hit.
        camera: that saw it, the same for all frames of a board.
    """

    rgb: np.ndarray
    depth: np.ndarray
    camera: Camera

    def differs(self, other: "Observation") -> bool:
        """Whether a pixel is another one."""
        return not (np.array_equal(self.rgb, other.rgb) and np.array_equal(self.depth, other.depth))


@dataclass
class Image:
    """One stored observation.

    Attributes:
        rgb: uint8 (H, W, 3).
        depth: float32 (H, W), board units, 0 where nothing was hit; None if not recorded.
        segmentation: uint16 (H, W), 0 for board and background, else 1 + index into `Episode.links`; None if not
            recorded. Privileged.
        boxes: int16 (N, 4), u0, v0, u1, v1 (exclusive) of each object; -1 where not visible. N objects.
    """

    rgb: np.ndarray
    depth: np.ndarray | None
    segmentation: np.ndarray | None
    boxes: np.ndarray

    def observation(self, camera: Camera) -> Observation:
        """What a robot with this camera has of the image.

        Raises:
            BusybotError: it has no depth.
        """
        if self.depth is None:
            raise BusybotError("an image without depth", "record it with `busybot collect`, which records depth")
        return Observation(self.rgb, self.depth, camera)


@dataclass(frozen=True)
class Step:
    """One proposed action and what came of it. A proposed action executes a direction, then its opposite.

    What each value means, its unit and frame, and whether it is privileged stands in `schema.STEP_FIELDS`. Positions
    are float32-representable. States and joint positions of trigger links stand in the order of these links among
    `Episode.links`, joint positions in radians or object units x scale.
    """

    pixel: tuple[int, int]
    position: tuple[float, float, float]
    direction: int
    executed: tuple[int, ...]
    distance: float
    changed_pixels: int
    reward: int
    acted_object: int
    acted_link: str
    trigger_states_before: tuple[int, ...]
    trigger_states_after: tuple[int, ...]
    responder_states_before: tuple[int, ...]
    responder_states_after: tuple[int, ...]
    joint_positions_before: tuple[float, ...]
    joint_positions_after: tuple[float, ...]
    success: bool
    vetoed: bool = False
    memory_after: tuple[int, ...] = ()


@dataclass
class Episode:
    """A board and all that was done on it.

    Attributes:
        board: the spec; its relations and states are privileged.
        camera: one static camera.
        links: what segmentation names, trigger links among them.
        positions: float32 (N, 3), visible centre of each object in the first image, board frame; NaN if not visible.
        images: the stored images, each different from the one before.
        frame_of: index into `images` for frames 0..len(steps).
        steps: one per proposed action.
        goals: what the board shows in the goal of its task: one image, or none. Decoded on demand like `images`.
        policy: name of the policy, e.g. "random".
        oracle: whether the policy knew what only the simulator knows.
        settings: everything else that decided the outcome (delta, strict, stop rule, physics), JSON values.
        renderer: fingerprint of the renderer, JSON values (device, driver, shader pack).
        versions: package versions at recording, JSON values.
    """

    board: BoardSpec
    camera: Camera
    links: tuple[Link, ...]
    positions: np.ndarray
    images: Sequence[Image]
    frame_of: list[int]
    steps: list[Step]
    policy: str
    oracle: bool
    settings: dict[str, Any] = field(default_factory=dict)
    renderer: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, Any] = field(default_factory=dict)
    goals: Sequence[Image] = ()

    def __repr__(self) -> str:
        """A line: pictures alone would be megabytes of it."""
        board, camera = self.board, self.camera
        return (
            f"<Episode of board {board.index}, seed {board.seed}, split {board.split!r}: {len(board.objects)} objects, "
            f"{len(self.steps)} actions by {self.policy!r}, frames of {camera.width} x {camera.height}>"
        )

    @property
    def rgb(self) -> "Pictures":
        """RGB of frames 0..len(steps), uint8 (H, W, 3) each; only what is asked for is decoded."""
        return Pictures(self, "rgb")

    @property
    def depth(self) -> "Pictures":
        """Depth of frames 0..len(steps), float32 (H, W) each, board units; only what is asked for is decoded.

        Asking for one raises BusybotError if the episode was recorded without depth.
        """
        return Pictures(self, "depth")

    @property
    def boxes(self) -> np.ndarray:
        """Boxes of all objects in frames 0..len(steps), int16 (T + 1, N, 4), as in `Image`; nothing is decoded."""
        return np.stack([image.boxes for image in self.images])[self.frame_of]

    @property
    def actions(self) -> np.ndarray:
        """Where each step acted and the unit vector of its proposed direction, board frame, float32 (T, 6)."""
        rows = [(*step.position, *DIRECTIONS[step.direction]) for step in self.steps]
        return np.array(rows, np.float32).reshape(-1, 6)

    @property
    def goal(self) -> Image | None:
        """The goal image, None if there is no goal."""
        return self.goals[0] if len(self.goals) else None

    def values(self, index: int) -> dict[str, Any]:
        """All that is recorded of step `index`, by the names of `schema.STEP_FIELDS`."""
        before, after = self.frame_of[index : index + 2]
        return {"index": index, "image_before": before, "image_after": after, **vars(self.steps[index])}

    def image(self, frame: int) -> Image:
        """The image that shows frame `frame` (0 is the initial observation)."""
        return self.images[self.frame_of[frame]]

    def observation(self, frame: int) -> Observation:
        """What a robot had of frame `frame`.

        Raises:
            BusybotError: the episode was recorded without depth.
        """
        with naming(f"board {self.board.index}"):
            return self.image(frame).observation(self.camera)


@dataclass(frozen=True, eq=False)
class Pictures(Sequence[np.ndarray]):
    """Pictures of one kind, by frame: `pictures[t]` shows frame t, a slice gives a list."""

    episode: Episode
    part: Literal["rgb", "depth"]

    def __len__(self) -> int:
        return len(self.episode.frame_of)

    @overload
    def __getitem__(self, frame: int) -> np.ndarray: ...

    @overload
    def __getitem__(self, frame: slice) -> list[np.ndarray]: ...

    def __getitem__(self, frame: int | slice) -> np.ndarray | list[np.ndarray]:
        if isinstance(frame, slice):
            return [self[one] for one in range(len(self))[frame]]
        picture: np.ndarray | None = getattr(self.episode.image(frame), self.part)
        if picture is None:
            raise BusybotError(f"board {self.episode.board.index}: an image without {self.part}")
        return picture
