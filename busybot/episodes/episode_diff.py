"""Differences between two recordings of one episode: board, actions, states, images.

Two images are *equal* when all of their values are. They are *close* when at most 0.1 % of the pixels differ by more
than 2/255 in a colour channel, at most as many show another link, and at most as many lie more than 0.001 board units
nearer or farther. Equality is asked for where one renderer made both images, closeness where two did.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
import pyarrow as pa

from busybot.episodes.episode import Episode, Image, Step
from busybot.episodes.schema import STEP_FIELDS, Compared

Rule = Literal["equal", "close"]

COLOUR_TOLERANCE = 2
"""Of 255."""
DEPTH_TOLERANCE = 1e-3
"""Board units."""
PIXEL_SHARE = 1e-3
_COMPARED = {part: [one for one in STEP_FIELDS if one.compared == part] for part in get_args(Compared)}
JOINT_TOLERANCE = max(one.tolerance for one in _COMPARED["joints"])
"""Radians or board units."""


@dataclass(frozen=True)
class ImageDifference:
    """Shares of pixels beyond the tolerances; `equal` if nothing differs at all, boxes among it."""

    equal: bool = True
    colour: float = 0.0
    depth: float = 0.0
    links: float = 0.0

    def holds(self, rule: Rule) -> bool:
        return self.equal if rule == "equal" else max(self.colour, self.depth, self.links) <= PIXEL_SHARE

    def worst(self, other: "ImageDifference") -> "ImageDifference":
        pairs = ((getattr(self, name), getattr(other, name)) for name in ("colour", "depth", "links"))
        return ImageDifference(self.equal and other.equal, *(max(pair) for pair in pairs))


UNLIKE = ImageDifference(False, 1.0, 1.0, 1.0)
"""Of images that cannot be compared."""


@dataclass(frozen=True)
class Difference:
    """How an episode's second recording differs from its first.

    Attributes:
        board: whether the boards are equal; likewise `scene` (camera and links) and `positions` (of the objects, as
            seen).
        steps: how many steps each has.
        action, state, reward: the first step in which it differs, None if there is none. Of an action: pixel, place,
            directions, distance. Of a state: what was held, success, veto, discrete states before and after.
        joints: the largest difference of a joint's position, radians or board units.
        frames: frames whose images differ at all.
        image: the worst over all frames and the goal.
        goal: whether the goal images are equal, or both absent.
    """

    board: bool
    scene: bool
    positions: bool
    steps: tuple[int, int]
    action: int | None
    state: int | None
    reward: int | None
    joints: float
    frames: list[int] = field(default_factory=list)
    image: ImageDifference = field(default_factory=ImageDifference)
    goal: bool = True

    @property
    def same_states(self) -> bool:
        """Boards, scenes, actions and discrete states equal, joints within the tolerance."""
        same = self.board and self.scene and self.steps[0] == self.steps[1]
        return same and self.action is self.state is None and self.joints <= JOINT_TOLERANCE

    @property
    def nothing(self) -> bool:
        """Whether the recordings are equal in everything."""
        return self.holds("equal") and self.joints == 0

    def holds(self, rule: Rule) -> bool:
        """States as they must be, and images as the rule says; what is counted in images belongs to `equal`."""
        exact = self.positions and self.reward is None
        return self.same_states and self.image.holds(rule) and (exact or rule == "close")


def rule_for(first: Episode, second: Episode) -> Rule:
    """`equal` for one renderer (by its fingerprint) and one codec; pictures of others may differ a little."""
    codecs = [episode.versions.get("opencv-python") for episode in (first, second)]
    return "equal" if first.renderer == second.renderer and codecs[0] == codecs[1] else "close"


def compare_episodes(first: Episode, second: Episode) -> Difference:
    """Compare all of two episodes, image by image."""
    pairs = list(zip(first.steps, second.steps, strict=False))
    frames, worst = [], ImageDifference()
    seen: dict[tuple[int, int], ImageDifference] = {}
    goal = ImageDifference()
    if first.camera.width == second.camera.width and first.camera.height == second.camera.height:
        goal = _compare_goals(first.goal, second.goal)
        for frame, images in enumerate(zip(first.frame_of, second.frame_of, strict=False)):
            if images not in seen:
                seen[images] = compare_images(first.images[images[0]], second.images[images[1]])
            worst = worst.worst(seen[images])
            frames += [] if seen[images].equal else [frame]
    else:
        frames, worst = list(range(len(first.frame_of))), UNLIKE
        goal = UNLIKE if len(first.goals) or len(second.goals) else goal
    return Difference(
        board=first.board.digest() == second.board.digest(),
        scene=_same_scene(first, second),
        positions=np.array_equal(first.positions, second.positions, equal_nan=True),
        steps=(len(first.steps), len(second.steps)),
        action=_first(pairs, "action"),
        state=_first(pairs, "state"),
        reward=_first(pairs, "reward"),
        joints=max((_joints(*pair) for pair in pairs), default=0.0),
        frames=frames,
        image=worst.worst(goal),
        goal=goal.equal,
    )


def _compare_goals(first: Image | None, second: Image | None) -> ImageDifference:
    if first is None or second is None:
        return ImageDifference() if first is second else UNLIKE
    return compare_images(first, second)


def compare_images(first: Image, second: Image) -> ImageDifference:
    """Compare two images of one size."""
    colour = (np.abs(first.rgb.astype(np.int16) - second.rgb) > COLOUR_TOLERANCE).any(axis=-1)
    depth_equal, depth = _compare(first.depth, second.depth, DEPTH_TOLERANCE)
    links_equal, links = _compare(first.segmentation, second.segmentation, 0)
    equal = depth_equal and links_equal and np.array_equal(first.rgb, second.rgb)
    equal = equal and np.array_equal(first.boxes, second.boxes)
    return ImageDifference(equal, float(colour.mean()), depth, links)


def _compare(first: np.ndarray | None, second: np.ndarray | None, tolerance: float) -> tuple[bool, float]:
    if first is None or second is None:
        return first is second, float(first is not second)
    beyond = np.abs(first.astype(np.float64) - second) > tolerance
    return np.array_equal(first, second), float(beyond.mean())


def _first(pairs: Sequence[tuple[Step, Step]], part: Compared) -> int | None:
    unlike = (k for k, (first, second) in enumerate(pairs) if _values(first, part) != _values(second, part))
    return next(unlike, None)


def _values(step: Step, part: Compared) -> list[Any]:
    """What must be equal: floats as the table stores them; how many joints there are belongs to the state."""
    values = [_as_stored(getattr(step, one.name), one.stored) for one in _COMPARED[part]]
    return values + [len(getattr(step, one.name)) for one in _COMPARED["joints"] if part == "state"]


def _as_stored(value: Any, kind: pa.DataType) -> Any:
    return np.float32(value).tolist() if kind == pa.float32() else value


def _joints(first: Step, second: Step) -> float:
    worst = 0.0
    for one in _COMPARED["joints"]:
        a, b = np.array(getattr(first, one.name)), np.array(getattr(second, one.name))
        if a.shape == b.shape:
            worst = max(worst, float(np.abs(a - b).max(initial=0.0)))
    return worst


def _same_scene(first: Episode, second: Episode) -> bool:
    views = (first.camera, second.camera)
    cameras = [(view.width, view.height, view.matrix.tolist(), view.pose.tolist()) for view in views]
    return cameras[0] == cameras[1] and first.links == second.links
