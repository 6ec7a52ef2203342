"""The channels of a recording: topics, schemas and what may be known from each.

Everything under /truth is privileged: what no camera shows, or what the simulator alone knows exactly.
"""

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

FOXGLOVE = {
    RGB: "CompressedImage",
    DEPTH: "CompressedImage",
    CALIBRATION: "CameraCalibration",
    TRANSFORMS: "FrameTransforms",
    SCENE: "SceneUpdate",
    LOG: "Log",
    SEGMENTATION: "CompressedImage",
    JOINTS: "JointStates",
}
OWN = {
    OBJECTS: "Objects",
    STEP: "Step",
    BOXES: "Boxes",
    LINKS: "Links",
    RELATIONS: "Relations",
    STEP_TRUTH: "StepTruth",
}

BOARD_FRAME, CAMERA_FRAME = "board", "camera"
METADATA = "busybot"
BOARD_FILE, RECORDING_FILE = "board.json", "recording.json"

SECOND = 1_000_000_000
"""Simulation time in ns between two frames: frame k is at k seconds, and so is step k, which starts from it."""
