"""Pictures of a board: shader packs, camera, and what is read back.

The default shader pack (`shaders/`) draws RGB, depth and segmentation in one pass without shadows: on a CPU it costs
about a quarter of SAPIEN's `minimal` (`benchmarks/speed/collection.py`). SAPIEN's own packs are selectable.

The slab with its texture and colour, and the table beneath: the background of every board, for looks only.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import sapien
from pydantic import Field, model_validator

from busybot.boards.spec import BoardSpec
from busybot.boards.textures import contact_shadow, painted
from busybot.common.frozen_model import FrozenModel
from busybot.episodes.episode import Camera
from busybot.objects.model import ObjectModel

BOARD_THICKNESS = 0.08
BEVEL = 0.03
TABLE_HALF = 4.0
TABLE_COLOR = (0.33, 0.35, 0.38, 1.0)
AMBIENT = (0.45, 0.45, 0.45)
SUN_DIRECTION, SUN = (0.455, -0.542, -0.706), (1.6, 1.55, 1.45)
SHADOW_MAP_SIZE = 1024
"""Lights for SAPIEN's shader packs; ours has its own in the shader."""


class Surroundings:
    """Adds slab, table and lights to scenes; keeps the last board's surface, which its appearance group shares.

    Args:
        lights: whether the shader pack needs lights in the scene; it then lights in linear colours, too.
        shadows: whether the sun casts shadows.
    """

    def __init__(self, lights: bool, shadows: bool = True) -> None:
        self._lights, self._shadows = lights, shadows
        self._surface: tuple[Any, Any] = (None, None)

    def add(self, scene: sapien.Scene, spec: BoardSpec, models: list[ObjectModel]) -> None:
        """Put the board's slab (top at z = 0), the table below and the lights into the scene."""
        if self._lights:
            reach = 1.5 * max(spec.size)
            scene.set_ambient_light(AMBIENT)
            scene.add_directional_light(
                SUN_DIRECTION,
                SUN,
                shadow=self._shadows,
                shadow_scale=reach,
                shadow_near=-reach,
                shadow_far=reach,
                shadow_map_size=SHADOW_MAP_SIZE,
            )
        half = np.array(spec.size) / 2
        table_color = [channel**2.2 if self._lights else channel for channel in TABLE_COLOR]
        table = sapien.render.RenderMaterial(base_color=table_color, roughness=1.0)
        _add_mesh(scene, "table", *_frame(half, TABLE_HALF, -BOARD_THICKNESS), table)
        mesh = _frustum(half - BEVEL, half, 0.0, -BEVEL, skirt=-BOARD_THICKNESS)
        _add_mesh(scene, "board", *mesh, self._material(spec, models))

    def _material(self, spec: BoardSpec, models: list[ObjectModel]) -> Any:
        key = (spec.texture, spec.color, spec.objects)
        if self._surface[0] != key:
            pixels = painted(spec.texture, spec.color) * contact_shadow(spec, models)[..., None]
            opaque = np.concatenate([pixels, np.full_like(pixels[..., :1], 255)], axis=-1).astype(np.uint8)
            material = sapien.render.RenderMaterial(base_color=(1, 1, 1, 1), roughness=1.0, metallic=0.0)
            material.base_color_texture = sapien.render.RenderTexture2D(opaque, "R8G8B8A8Unorm", srgb=self._lights)
            self._surface = (key, material)
        return self._surface[1]


def _frustum(
    top: np.ndarray, bottom: np.ndarray, z_top: float, z_bottom: float, skirt: float | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A rectangle at `z_top` with slanted sides to `z_bottom` and upright ones down to `skirt`.

    Returns:
        vertices (V, 3), triangles (T, 3), normals (V, 3) and texture coordinates (V, 2) that follow x and y.
    """
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    levels = [(top, z_top), (bottom, z_bottom)] + ([(bottom, skirt)] if skirt is not None else [])
    rings = [np.concatenate([signs * half, np.full((4, 1), z)], axis=1) for half, z in levels]
    faces = [rings[0]]
    for upper, lower in zip(rings, rings[1:], strict=False):
        faces += [np.stack([lower[i], lower[(i + 1) % 4], upper[(i + 1) % 4], upper[i]]) for i in range(4)]
    vertices = np.concatenate(faces)
    triangles = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(len(faces))])
    normals = np.repeat([np.cross(f[1] - f[0], f[2] - f[0]) for f in faces], 4, axis=0)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-12)
    return vertices, triangles, normals, vertices[:, :2] / (2 * bottom.max()) + 0.5


def _frame(inner: np.ndarray, outer: float, z: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A level ring around the board: what lies under the board would be shaded for nothing. Returns as `_frustum`."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    near, far = signs * inner, signs * outer
    corners = np.concatenate([np.stack([far[i], far[(i + 1) % 4], near[(i + 1) % 4], near[i]]) for i in range(4)])
    vertices = np.concatenate([corners, np.full((16, 1), z)], axis=1)
    triangles = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(4)])
    return vertices, triangles, np.tile([0.0, 0.0, 1.0], (16, 1)), corners / (2 * outer) + 0.5


def _add_mesh(
    scene: sapien.Scene,
    name: str,
    vertices: np.ndarray,
    triangles: np.ndarray,
    normals: np.ndarray,
    uvs: np.ndarray,
    material: Any,
) -> None:
    shape = sapien.render.RenderShapeTriangleMesh(
        vertices.astype(np.float32),
        triangles.astype(np.uint32),
        normals.astype(np.float32),
        uvs.astype(np.float32),
        material,
    )
    body = sapien.render.RenderBodyComponent()
    body.attach(shape)
    entity = sapien.Entity()
    entity.name = name
    entity.add_component(body)
    scene.add_entity(entity)


Coordinate = Annotated[float, Field(ge=-100, le=100, allow_inf_nan=False)]


class RenderConfig(FrozenModel):
    """How the board is looked at.

    Attributes:
        shader: `busybot` (ours), or SAPIEN's `minimal` or `default`.
        width, height: pixels.
        position, target: of the camera, board frame, board units.
        fov_deg: horizontal field of view, degrees.
        near, far: clipping distances, board units; depth is exact to about 2e-5 units at the default.
    """

    shader: Literal["busybot", "minimal", "default"] = "busybot"
    width: Annotated[int, Field(ge=16, le=4096)] = 640
    height: Annotated[int, Field(ge=16, le=4096)] = 480
    position: tuple[Coordinate, Coordinate, Coordinate] = (0.0, -0.1, 4.0)
    target: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    fov_deg: Annotated[float, Field(gt=1, lt=170)] = 69.4
    near: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0
    far: Annotated[float, Field(gt=0, le=1000, allow_inf_nan=False)] = 6.0

    @model_validator(mode="after")
    def _looks_somewhere(self) -> "RenderConfig":
        distance = float(np.linalg.norm(np.subtract(self.target, self.position)))
        if distance < 1e-6:
            raise ValueError("position and target are the same point")
        if not self.near < distance < self.far:
            raise ValueError(f"the target is {distance:.3g} away, not between near {self.near:g} and far {self.far:g}")
        return self


@dataclass
class RenderedPicture:
    """What the camera sees.

    Attributes:
        rgb: uint8 (H, W, 3).
        depth: float32 (H, W), board units along the optical axis, 0 where nothing was hit.
        entities: uint16 (H, W), SAPIEN's per-scene id of the visible entity.
    """

    rgb: np.ndarray
    depth: np.ndarray
    entities: np.ndarray


def _select_shader(config: RenderConfig) -> None:
    """Choose the shader pack of the next camera: SAPIEN keeps it globally, but reads it when a camera is made."""
    ours = config.shader == "busybot"
    directory = str(Path(__file__).with_name("shaders")) if ours else config.shader
    sapien.render.set_picture_format("Color", "r8g8b8a8unorm" if ours else "r32g32b32a32sfloat")
    sapien.render.set_picture_format("Segmentation", "r16g16b16a16uint" if ours else "r32g32b32a32uint")
    sapien.render.set_camera_shader_dir(directory)


def camera_pose(config: RenderConfig) -> np.ndarray:
    """Camera to board, shape (4, 4), in OpenCV's convention (x right, y down, z forward)."""
    position = np.array(config.position, float)
    forward = np.array(config.target, float) - position
    forward /= np.linalg.norm(forward)
    up = np.array([0.0, 1.0, 0.0]) if abs(forward[2]) > 0.5 else np.array([0.0, 0.0, 1.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return pose


def camera_model(config: RenderConfig) -> Camera:
    """The pinhole model: intrinsics in pixels (pixel centres at .5) and pose."""
    focal = config.width / 2 / np.tan(np.deg2rad(config.fov_deg) / 2)
    matrix = np.array([[focal, 0, config.width / 2], [0, focal, config.height / 2], [0, 0, 1]])
    return Camera(config.width, config.height, matrix, camera_pose(config))


def add_camera(scene: sapien.Scene, config: RenderConfig) -> Any:
    """Mount the camera in the scene and return SAPIEN's camera component."""
    _select_shader(config)
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


def read_picture(camera: Any, config: RenderConfig) -> RenderedPicture:
    """Fetch the picture that `camera.take_picture()` asked for."""
    ours = config.shader == "busybot"
    color = camera.get_picture("Color")
    rgb = cv2.cvtColor(color, cv2.COLOR_RGBA2RGB) if ours else (color[..., :3].clip(0, 1) * 255).astype(np.uint8)
    if config.shader == "minimal":
        entities = camera.get_picture("PositionSegmentation")[..., 3].astype(np.uint16)
    elif ours:
        entities = cv2.extractChannel(camera.get_picture("Segmentation"), 1)
    else:
        entities = camera.get_picture("Segmentation")[..., 1].astype(np.uint16)
    return RenderedPicture(rgb, _metric_depth(camera, config), entities)


def _metric_depth(camera: Any, config: RenderConfig) -> np.ndarray:
    """Metric depth from the depth buffer, float32."""
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
