"""The slab with its texture and colour, and the table beneath: the background of every board, for looks only."""

from typing import Any

import numpy as np
import sapien

from busybot.boards.spec import BoardSpec
from busybot.boards.textures import contact_shadow, painted
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
