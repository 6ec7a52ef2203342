"""The channels of a recording: topics, schemas and what may be known from each.

Everything under /truth is privileged: what no camera shows, or what the simulator alone knows exactly.
"""

from typing import NamedTuple

RGB = "/camera/rgb"
DEPTH = "/camera/depth"
CALIBRATION = "/camera/calibration"
TRANSFORMS = "/tf"
OBJECTS = "/objects"
SCENE = "/scene"
STEP = "/step"
LOG = "/log"
SEGMENTATION = "/truth/segmentation"
BOXES = "/truth/boxes"
LINKS = "/truth/links"
RELATIONS = "/truth/relations"
JOINTS = "/truth/joints"
STEP_TRUTH = "/truth/step"
GOAL_RGB = "/goal/rgb"
GOAL_DEPTH = "/goal/depth"
GOAL_SEGMENTATION = "/truth/goal/segmentation"
GOAL_BOXES = "/truth/goal/boxes"


class Pictures(NamedTuple):
    """Where the parts of an image go."""

    rgb: str
    depth: str
    segmentation: str
    boxes: str


CAMERA = Pictures(RGB, DEPTH, SEGMENTATION, BOXES)
GOAL = Pictures(GOAL_RGB, GOAL_DEPTH, GOAL_SEGMENTATION, GOAL_BOXES)

FOXGLOVE = {
    RGB: "CompressedImage",
    DEPTH: "CompressedImage",
    CALIBRATION: "CameraCalibration",
    TRANSFORMS: "FrameTransforms",
    SCENE: "SceneUpdate",
    LOG: "Log",
    SEGMENTATION: "CompressedImage",
    JOINTS: "JointStates",
    GOAL_RGB: "CompressedImage",
    GOAL_DEPTH: "CompressedImage",
    GOAL_SEGMENTATION: "CompressedImage",
}
OWN = {
    OBJECTS: "Objects",
    STEP: "Step",
    BOXES: "Boxes",
    LINKS: "Links",
    RELATIONS: "Relations",
    STEP_TRUTH: "StepTruth",
    GOAL_BOXES: "Boxes",
}

BOARD_FRAME, CAMERA_FRAME = "board", "camera"
METADATA = "busybot"
BOARD_FILE, RECORDING_FILE = "board.json", "recording.json"

SECOND = 1_000_000_000
"""Simulation time in ns between two frames: frame k is at k seconds, and so is step k, which starts from it."""
