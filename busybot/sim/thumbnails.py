"""Portraits of single objects, for contact sheets: from obliquely above, on a plain ground with a soft shadow.

Objects of one category are seen from equal or nearly equal distances, so that their sizes can be compared. Triggers
rest in their first state; what has a colour to show is lit, other doors are ajar, and toys where they start.
"""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from pydantic import ValidationError

from busybot.boards.spec import BoardSpec, PlacedObject
from busybot.common.errors import BusybotError
from busybot.objects.library import Library
from busybot.objects.model import ObjectModel
from busybot.sim.scene.board_scene import Simulator
from busybot.sim.scene.joints import Responder, rest_at
from busybot.sim.scene.render import RenderConfig

GROUND = (243, 241, 237)
"""RGB of the plain ground."""
VIEW = np.array([0.0, -0.64, 0.77])
"""From the object to the camera, board frame."""
FOV_DEG = 24.0
CLOSEST = 0.72
"""Small objects are shown from this share of the distance of their category's largest at least."""
AJAR = 0.3
"""How far doors stand open, as a share of their way."""
SUPERSAMPLING = 3
SHADOW, SHADOW_SHIFT, SHADOW_BLUR = 0.30, 0.012, 0.022
"""Darkness of the shadow; its shift and blur as shares of the picture's side."""


def lone_board(model: ObjectModel, states: tuple[int, ...] | None = None) -> BoardSpec:
    """A board with one object in its middle.

    Args:
        states: of its trigger links; all 0 by default.
    """
    placed = PlacedObject(
        key=model.key,
        role=model.role,
        position=(0, 0, model.offset_z),
        yaw=0,
        scale=model.scale,
        states=states if states is not None else (0,) * len(model.trigger_links),
    )
    return BoardSpec(
        index=0,
        seed=0,
        split="test",
        appearance_group=0,
        texture="felt",
        color=(0.9, 0.9, 0.9),
        objects=(placed,),
        relations=(),
    )


def thumbnails(library: Library, keys: Sequence[str], size: int) -> Iterator[np.ndarray]:
    """A picture of each object, uint8 RGB (size, size, 3), in the order of the keys."""
    largest: dict[str, float] = {}
    for key in keys:
        model = library.get(key)
        largest[model.category] = max(largest.get(model.category, 0.0), _radius(model))
    previous: Simulator | None = None
    for key in keys:
        model = library.get(key)
        radius = max(_radius(model), CLOSEST * largest[model.category])
        simulator = Simulator(library, _camera(model, radius, SUPERSAMPLING * size))
        yield _portrait(simulator, model, size)
        previous = simulator  # keeps a scene alive: SAPIEN compiles its shaders again when the last one goes
    del previous


def _radius(model: ObjectModel) -> float:
    """Half the diagonal of the object's box, board units."""
    return float(np.linalg.norm(np.subtract(model.bounds_max, model.bounds_min))) * model.scale / 2


def _camera(model: ObjectModel, radius: float, pixels: int) -> RenderConfig:
    """A camera that holds a ball of this radius around the middle of the object's box.

    Raises:
        BusybotError: the object is too large, or stands too far off.
    """
    middle = (np.add(model.bounds_max, model.bounds_min)) * model.scale / 2 + [0, 0, model.offset_z]
    direction = VIEW / np.linalg.norm(VIEW)
    distance = 1.03 * radius / np.sin(np.deg2rad(FOV_DEG / 2))
    x, y, z = (middle + distance * direction).tolist()
    try:
        return RenderConfig(
            width=pixels,
            height=pixels,
            position=(x, y, z),
            target=tuple(middle.tolist()),
            fov_deg=FOV_DEG,
            near=0.2 * distance,
            far=distance + 4.0,
        )
    except ValidationError:  # no camera stands so far away
        what = f"{model.folder}: with its Scale {model.scale:g} it is {2 * _radius(model):.3g} board units across"
        raise BusybotError(f"{what}, too large for a portrait", "give it a smaller Scale: boards are 4 x 4") from None


def _portrait(simulator: Simulator, model: ObjectModel, size: int) -> np.ndarray:
    scene = simulator.board(lone_board(model))
    for responder in scene.responders.values():
        _pose(responder, model.category)
    image = scene.observe()
    assert image.segmentation is not None
    mask = (image.segmentation > 0).astype(np.float32)
    side = len(mask)
    moved = np.array([[1, 0, SHADOW_SHIFT * side], [0, 1, SHADOW_SHIFT * side]], np.float32)
    shade = cv2.GaussianBlur(cv2.warpAffine(mask, moved, (side, side)), (0, 0), SHADOW_BLUR * side)
    ground = np.array(GROUND, np.float32) * (1 - SHADOW * shade[..., None])
    picture = np.where(mask[..., None] > 0, image.rgb.astype(np.float32), ground)
    small = cv2.resize(picture, (size, size), interpolation=cv2.INTER_AREA)
    return np.asarray(np.round(small).astype(np.uint8))


def _pose(responder: Responder, category: str) -> None:
    """Light what is painted; set a door ajar."""
    if responder.effect.type == "color":
        responder.show(1)
    elif category == "Door" and responder.effect.single is not None:
        values = np.array(responder.effect.single[:2])
        rest_at(responder.articulation, responder.axes, values[0] + AJAR * (values[1] - values[0]))
