"""Pictures of a board: what it stands on, shader packs, camera, and what is read back.

The default shader pack (`shaders/`) draws RGB, depth and segmentation in one pass without shadows: on a CPU it costs
about a quarter of SAPIEN's `minimal` (`benchmarks/speed/collection.py`). SAPIEN's own packs are selectable. The slab
with its texture and colour and the table beneath are the background of every board, for looks only.
"""

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import sapien
from pydantic import Field, SerializerFunctionWrapHandler, ValidationError, model_serializer, model_validator

from busybot.boards.spec import BoardSpec, without
from busybot.boards.textures import contact_shadow, painted
from busybot.common.atomic_io import write_new
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel, first_fault
from busybot.datasets.info import UNSAID
from busybot.episodes.camera import project
from busybot.episodes.episode import Camera
from busybot.objects.model import ObjectModel
from busybot.sim.scene.appearance import (
    USUAL_LIGHTS,
    USUAL_SURFACES,
    Lights,
    Randomise,
    Surfaces,
    lights_of,
    moved_camera,
    surfaces_of,
    zoom_of,
)
from busybot.sim.scene.real_camera import CameraConfig
from busybot.sim.vulkan_check import render_device

BOARD_THICKNESS = 0.08
BEVEL = 0.03
TABLE_HALF = 4.0
TABLE_COLOR = (0.33, 0.35, 0.38, 1.0)
AMBIENT = (0.45, 0.45, 0.45)
SUN_DIRECTION, SUN = (0.455, -0.542, -0.706), (1.6, 1.55, 1.45)
SHADOW_MAP_SIZE = 1024
"""Lights for SAPIEN's shader packs; ours has its own in the shader."""
SHADERS = Path(__file__).with_name("shaders")


def new_renderer() -> sapien.render.RenderSystem:
    """On the device on which this process draws (`vulkan_check.render_device`).

    Raises:
        BusybotError: SAPIEN cannot draw there.
    """
    if (name := render_device()) is None:
        return sapien.render.RenderSystem()
    try:
        return sapien.render.RenderSystem(sapien.Device(name))
    except RuntimeError as error:
        raise BusybotError(f"SAPIEN cannot draw on {name}: {error}", "busybot doctor, or --device auto") from None


class Surroundings:
    """Adds slab, table and lights to scenes; keeps the last board's surface, which its appearance group shares.

    Args:
        lights: whether the shader pack needs lights in the scene; it then lights in linear colours, too.
        shadows: whether the sun casts shadows.
    """

    def __init__(self, lights: bool, shadows: bool = True) -> None:
        self._lights, self._shadows = lights, shadows
        self._surface: tuple[Any, Any] = (None, None)

    def add(self, scene: sapien.Scene, spec: BoardSpec, models: list[ObjectModel], drawn: Randomise) -> None:
        """Put the board's slab (top at z = 0), the table below and the lights into the scene."""
        if self._lights:
            lights = lights_of(drawn.lights, spec)
            shadows = 1.5 * max(spec.size)
            scene.set_ambient_light(np.multiply(AMBIENT, lights.ambient))
            scene.add_directional_light(
                lights.turned(SUN_DIRECTION),
                np.multiply(SUN, lights.key),
                shadow=self._shadows,
                shadow_scale=shadows,
                shadow_near=-shadows,
                shadow_far=shadows,
                shadow_map_size=SHADOW_MAP_SIZE,
            )
        half, surfaces = np.array(spec.size) / 2, surfaces_of(drawn.textures, spec)
        colour = np.multiply(TABLE_COLOR, (*surfaces.table, 1.0)).tolist()
        table_color = [channel**2.2 if self._lights else channel for channel in colour]
        table = sapien.render.RenderMaterial(base_color=table_color, roughness=1.0)
        # seen obliquely a table ends at the horizon
        reach = TABLE_HALF if spec.camera is None else 6 * float(half.max())
        # the table is a ring: what lies under the board would be shaded for nothing
        _add_sides(scene, "table", [(half, -BOARD_THICKNESS), (reach, -BOARD_THICKNESS)], table, lid=False)
        slab = [(half - BEVEL, 0.0), (half, -BEVEL), (half, -BOARD_THICKNESS)]
        _add_sides(scene, "board", slab, self._material(spec, models, surfaces), lid=True)

    def _material(self, spec: BoardSpec, models: list[ObjectModel], surfaces: Surfaces) -> Any:
        key = (spec.size, spec.texture, spec.color, spec.objects, surfaces)
        if self._surface[0] != key:
            shade = contact_shadow(spec, models)
            if surfaces == USUAL_SURFACES:
                pixels = painted(spec.texture, spec.color, shade=shade)
            else:
                pixels = (surfaces.of(painted(spec.texture, spec.color)) * shade[..., None]).astype(np.uint8)
            opaque = cv2.cvtColor(pixels, cv2.COLOR_RGB2RGBA)
            material = sapien.render.RenderMaterial(base_color=(1, 1, 1, 1), roughness=1.0, metallic=0.0)
            material.base_color_texture = sapien.render.RenderTexture2D(opaque, "R8G8B8A8Unorm", srgb=self._lights)
            self._surface = (key, material)
        return self._surface[1]


def _add_sides(
    scene: sapien.Scene, name: str, levels: Sequence[tuple[np.ndarray | float, float]], material: Any, lid: bool
) -> None:
    """Add the surface between rectangles around the origin, from one to the next, seen from above.

    Its texture coordinates follow x and y, and reach from 0 to 1 over the last one.

    Args:
        levels: half extents (x, y) and height z of each rectangle.
        lid: whether the first one is filled.
    """
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    rings = [np.concatenate([signs * half, np.full((4, 1), z)], axis=1) for half, z in levels]
    faces = [rings[0]] if lid else []
    for upper, lower in pairwise(rings):
        faces += [np.stack([lower[i], lower[(i + 1) % 4], upper[(i + 1) % 4], upper[i]]) for i in range(4)]
    vertices, corners = np.concatenate(faces), np.array(faces)
    triangles = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(len(faces))])
    normals = np.repeat(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), 4, axis=0)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-12)
    uvs = vertices[:, :2] / (2 * np.asarray(levels[-1][0])) + 0.5
    arrays = (vertices.astype(np.float32), triangles.astype(np.uint32), normals.astype(np.float32))
    shape = sapien.render.RenderShapeTriangleMesh(*arrays, uvs.astype(np.float32), material)
    body = sapien.render.RenderBodyComponent()
    body.attach(shape)
    entity = sapien.Entity()
    entity.name = name
    entity.add_component(body)
    scene.add_entity(entity)


SIGHT = 4
"""A board's own camera sees so many times as far as its target."""
Coordinate = Annotated[float, Field(ge=-100, le=100, allow_inf_nan=False)]


class RenderConfig(FrozenModel):
    """How the board is looked at.

    Attributes:
        shader: `busybot` (ours), or SAPIEN's `minimal` or `default`.
        width, height: pixels.
        position, target: of the camera, board frame, board units.
        fov_deg: horizontal field of view, degrees.
        near, far: clipping distances, board units; depth is exact to about 2e-5 units at the default.
        camera: what the camera makes of the picture (`real_camera`); by default it stays as it is rendered.
        randomise: what is drawn for each board (`appearance`); by default nothing.

    In JSON `camera` and `randomise` are left out where they say nothing.
    """

    shader: Literal["busybot", "minimal", "default"] = "busybot"
    width: Annotated[int, Field(ge=16, le=4096)] = 640
    height: Annotated[int, Field(ge=16, le=4096)] = 480
    position: tuple[Coordinate, Coordinate, Coordinate] = (0.0, -0.1, 4.0)
    target: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    fov_deg: Annotated[float, Field(gt=1, lt=170)] = 69.4
    near: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    far: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)] = 6.0
    camera: CameraConfig = CameraConfig()
    randomise: Randomise = Randomise()

    @model_validator(mode="after")
    def _looks_somewhere(self) -> "RenderConfig":
        distance = float(np.linalg.norm(np.subtract(self.target, self.position)))
        if distance < 1e-6:
            raise ValueError("position and target are the same point")
        if not self.near < distance < self.far:
            raise ValueError(f"the target is {distance:.3g} away, not between near {self.near:g} and far {self.far:g}")
        return self

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return without(handler(self), UNSAID)

    def of_board(self, spec: BoardSpec) -> "RenderConfig":
        """How this board is looked at: by its own camera if it has one, else with the pose and the field of view that
        were drawn for it. A board's own camera may stand farther away: it sees `SIGHT` times as far as its target.

        Raises:
            BusybotError: a drawn camera, or the board's own, does not see the board.
        """
        if spec.camera is not None:
            own = spec.camera.model_dump()
            far = max(self.far, SIGHT * float(np.linalg.norm(np.subtract(own["target"], own["position"]))))
            try:
                there = self.model_validate({**self.model_dump(), **own, "far": far})
            except ValidationError as error:
                what = f"board {spec.index}: its camera: {first_fault(error)}"
                raise BusybotError(what, "mend `camera` in the board's JSON, or draw the board again") from None
            return there.of_board(spec.model_copy(update={"camera": None}))
        pose, zoom = self.randomise.pose, self.randomise.fov
        if not (pose or zoom):
            return self
        position, target = moved_camera(pose, spec, self.position, self.target)
        fov = self.fov_deg * zoom_of(zoom, spec)
        drawn = {**self.model_dump(), "position": position, "target": target}
        try:
            fitting = _widened(RenderConfig.model_validate({**drawn, "fov_deg": fov}), spec)
            return RenderConfig.model_validate({**drawn, "fov_deg": fitting})
        except ValidationError as error:
            what = f"board {spec.index}: its drawn camera: {first_fault(error)}"
            raise BusybotError(what, "randomise less, or look from another place") from None


def _widened(config: RenderConfig, spec: BoardSpec) -> float:
    """The field of view, degrees, at least as wide as the corners of the board need."""
    width, height = spec.size
    corners = np.array([(x * width / 2, y * height / 2, 0.0) for x in (-1, 1) for y in (-1, 1)])
    pixels, depth = project(corners, camera_model(config))
    middle = np.array([config.width, config.height]) / 2
    beyond = np.abs(pixels / middle - 1).max() if (depth > 0).all() else np.inf
    half = np.tan(np.deg2rad(config.fov_deg) / 2) * max(1.0, float(beyond))
    return float(2 * np.rad2deg(np.arctan(half)))


def camera_model(config: RenderConfig) -> Camera:
    """The pinhole model: intrinsics in pixels (pixel centres at .5), and the camera's pose on the board in OpenCV's
    convention (x right, y down, z forward).
    """
    focal = config.width / 2 / np.tan(np.deg2rad(config.fov_deg) / 2)
    matrix = np.array([[focal, 0, config.width / 2], [0, focal, config.height / 2], [0, 0, 1]])
    position = np.array(config.position, float)
    forward = np.array(config.target, float) - position
    forward /= np.linalg.norm(forward)
    up = np.array([0.0, 1.0, 0.0]) if abs(forward[2]) > 0.5 else np.array([0.0, 0.0, 1.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return Camera(config.width, config.height, matrix, pose)


def add_camera(scene: sapien.Scene, config: RenderConfig, lights: Lights = USUAL_LIGHTS) -> Any:
    """Mount the camera in the scene and return SAPIEN's camera component.

    Args:
        config: of the board, see `RenderConfig.of_board`.
        lights: of our shader; the scene has those of SAPIEN's.
    """
    if config.shader == "busybot" and lights != USUAL_LIGHTS:
        with TemporaryDirectory(prefix="busybot-shader-") as folder:
            _write_shader(Path(folder), lights)
            camera = _add_camera(scene, config, folder)
            scene.update_render()
            camera.take_picture()  # SAPIEN reads a shader with the first picture
        return camera
    return _add_camera(scene, config, str(SHADERS) if config.shader == "busybot" else config.shader)


def _write_shader(folder: Path, lights: Lights) -> None:
    """Our shader with the constants of other lights."""
    factors = {"KEY_COLOR": lights.key, **dict.fromkeys(("FILL_COLOR", "SKY", "GROUND"), lights.ambient)}

    def changed(found: re.Match[str]) -> str:
        x, y, z = (float(value) for value in found[2].split(","))
        values = lights.turned((x, y, z)) if found[1] == "KEY_DIRECTION" else (x, y, z)
        values = tuple(np.multiply(values, factors.get(found[1], 1.0)))
        return f"const vec3 {found[1]} = vec3({', '.join(f'{value:.6f}' for value in values)});"

    for file in sorted(SHADERS.iterdir()):
        text = file.read_text(encoding="utf-8")
        write_new(folder / file.name, re.sub(r"const vec3 (\w+) = vec3\((.*)\);", changed, text).encode())


def _add_camera(scene: sapien.Scene, config: RenderConfig, shader: str) -> Any:
    # SAPIEN keeps the shader pack and its formats globally, but reads them when a camera is made
    ours = config.shader == "busybot"
    sapien.render.set_picture_format("Color", "r8g8b8a8unorm" if ours else "r32g32b32a32sfloat")
    sapien.render.set_picture_format("Segmentation", "r16g16b16a16uint" if ours else "r32g32b32a32uint")
    sapien.render.set_camera_shader_dir(shader)
    model = camera_model(config)
    fov_vertical = 2 * np.arctan(config.height / 2 / model.matrix[1, 1])
    camera = scene.add_camera("camera", config.width, config.height, fov_vertical, config.near, config.far)
    # SAPIEN's camera looks along x with z up: forward, left, up
    axes = model.pose[:3, :3]
    pose = np.eye(4)
    pose[:3, :3] = np.stack([axes[:, 2], -axes[:, 0], -axes[:, 1]], axis=1)
    pose[:3, 3] = model.pose[:3, 3]
    camera.entity.set_pose(sapien.Pose(pose))
    return camera


def read_picture(camera: Any, config: RenderConfig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fetch the picture that `camera.take_picture()` asked for.

    Returns:
        RGB, uint8 (H, W, 3); depth, float32 (H, W), board units along the optical axis, 0 where nothing was hit;
        SAPIEN's per-scene ids of the visible entities, uint16 (H, W).
    """
    ours = config.shader == "busybot"
    color = camera.get_picture("Color")
    rgb = cv2.cvtColor(color, cv2.COLOR_RGBA2RGB) if ours else (color[..., :3].clip(0, 1) * 255).astype(np.uint8)
    if config.shader == "minimal":
        entities = camera.get_picture("PositionSegmentation")[..., 3].astype(np.uint16)
    elif ours:
        entities = cv2.extractChannel(camera.get_picture("Segmentation"), 1)
    else:
        entities = camera.get_picture("Segmentation")[..., 1].astype(np.uint16)
    return rgb, _metric_depth(camera, config), entities


def _metric_depth(camera: Any, config: RenderConfig) -> np.ndarray:
    near, far = np.float32(config.near), np.float32(config.far)
    if config.shader == "default":
        depth = -camera.get_picture("Position")[..., 2]
        return np.ascontiguousarray(np.where(depth > 0, depth, 0), dtype=np.float32)
    buffer = camera.get_picture("GbufferDepth").reshape(config.height, config.width)
    # near * far / (far - buffer * (far - near)), in place: this runs for every frame
    depth = np.multiply(buffer, near - far)
    depth += far
    np.divide(near * far, depth, out=depth)
    depth *= buffer < 1
    return depth
