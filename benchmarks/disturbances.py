"""The disturbances of `benchmarks/reason_robustness.py`: what is done, and how strongly."""

from dataclasses import dataclass

from benchmarks import disturb
from benchmarks.disturb import Disturb


@dataclass(frozen=True)
class Disturbance:
    """One thing that goes wrong.

    Attributes:
        title: in a few words.
        what: exactly what is done.
        unit: of the strengths.
        strengths: growing.
        apply: None for noise on the features, which are not part of a recording (`noisy`).
    """

    title: str
    what: str
    unit: str
    strengths: tuple[float, ...]
    apply: Disturb | None


SHARES = (0.1, 0.2, 0.3)
DISTURBANCES = {
    "features": Disturbance(
        "noise on features",
        "Gaussian noise on the features of every responder in every frame, of this length",
        "smallest changes",
        (0.2, 0.4, 0.8),
        None,
    ),
    "camera": Disturbance(
        "noise of the camera",
        "Gaussian noise of this standard deviation on every channel of every picture, another one in every frame; "
        "depth stays as it is",
        "of 255",
        (2, 5, 10),
        disturb.camera_noise,
    ),
    "patch": Disturbance(
        "a responder hidden",
        "in this share of the frames a random responder's box is grey and has no depth",
        "of frames",
        SHARES,
        disturb.patch,
    ),
    "hand": Disturbance(
        "a hand in the picture",
        "in this share of the frames an arm, 70 pixels wide, reaches from a random place of the picture's border to a "
        "random object, above everything else",
        "of frames",
        SHARES,
        disturb.hand,
    ),
    "slips": Disturbance(
        "failing: the gripper slips",
        "before a step its own action is made without effect, so that this share of all actions fails in addition",
        "of actions",
        SHARES,
        disturb.slips,
    ),
    "misses": Disturbance(
        "failing: beside the link",
        "before a step its action is made at a random place of the same trigger that does not move, without effect, so "
        "that this share of all actions fails in addition",
        "of actions",
        SHARES,
        disturb.misses,
    ),
    "missing": Disturbance(
        "missing frames",
        "this share of the pictures is lost, the one before is seen once more: the next change shows both effects",
        "of frames",
        SHARES,
        disturb.missing_frames,
    ),
    "boxes": Disturbance(
        "inaccurate boxes",
        "every side of every first-frame box is displaced by Gaussian noise of this standard deviation",
        "pixels",
        (5, 10, 20),
        disturb.wrong_boxes,
    ),
    "swapped": Disturbance(
        "two boxes exchanged",
        "on this share of the boards two random responders have each other's box",
        "of boards",
        (0.5, 1.0),
        disturb.swapped_boxes,
    ),
    "jpeg": Disturbance(
        "JPEG",
        "every picture, recorded as JPEG of quality 90, is encoded again with less quality",
        "quality lost",
        (20, 50, 80),
        disturb.compressed,
    ),
}
