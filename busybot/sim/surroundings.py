"""What every board stands on: the slab with its texture and colour, and the table beneath. Looks only."""

from typing import Any

import numpy as np
import sapien

from busybot.boards.spec import BoardSpec
from busybot.boards.surface import painted

BOARD_THICKNESS = 0.08
BEVEL = 0.03
TABLE_HALF = 4.0
TABLE_COLOR = (0.33, 0.35, 0.38, 1.0)
"""The table's base colour."""


class Surroundings:
    """Adds slab and table to scenes; keeps the textures that it has made."""

    def __init__(self) -> None:
        self._materials: dict[tuple[str, tuple[float, float, float]], Any] = {}

    def add(self, scene: sapien.Scene, spec: BoardSpec) -> None:
        """Put the board's slab (top at z = 0) and the table below into the scene."""
        half = np.array(spec.size) / 2
        table = sapien.render.RenderMaterial(base_color=TABLE_COLOR, roughness=1.0)
        level = -BOARD_THICKNESS
        _add_mesh(scene, "table", *_frustum(np.full(2, TABLE_HALF), np.full(2, TABLE_HALF), level, level - 0.01), table)
        mesh = _frustum(half - BEVEL, half, 0.0, -BEVEL, skirt=-BOARD_THICKNESS)
        _add_mesh(scene, "board", *mesh, self._material(spec))

    def _material(self, spec: BoardSpec) -> Any:
        key = (spec.texture, spec.color)
        if key not in self._materials:
            pixels = painted(*key)
            opaque = np.concatenate([pixels, np.full_like(pixels[..., :1], 255)], axis=-1)
            material = sapien.render.RenderMaterial(base_color=(1, 1, 1, 1), roughness=1.0, metallic=0.0)
            material.base_color_texture = sapien.render.RenderTexture2D(opaque, "R8G8B8A8Unorm", srgb=False)
            self._materials[key] = material
        return self._materials[key]


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
