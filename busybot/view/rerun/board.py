"""Rerun, the board in 3-D from depth images: its face, objects as reliefs, boxes, the action, relations as arcs."""

from dataclasses import dataclass

import cv2
import numpy as np
import rerun as rr

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.camera import Rays, project
from busybot.episodes.episode import Camera, Episode, Image
from busybot.view.annotations import Edge, centres, looks_new, object_names
from busybot.view.palette import ACTION, ROLES, TRUTH, VERDICTS, Rgb, mix, text_on_dark

FACE_PIXELS = 512
OBJECT_HEIGHT = 0.015
"""Board units; what is higher is an object, where no segmentation was recorded."""
SIDE_SHADE = 0.45
"""Of the sides of reliefs, which no camera saw: share of the object's brightness."""
SLAB = 0.08
"""Thickness of the drawn board, board units."""
ARC_POINTS = 24
LABEL_LIFT = 0.24
"""Of a name above its object, board units."""
INFERRED_LIFT = 0.1
"""Of inferred arcs above the true ones, board units."""
HEAD = 0.18
"""Length of an arc's arrow head, board units."""


@dataclass(frozen=True)
class Relief:
    """A coloured triangle mesh in the board frame.

    Attributes:
        vertices: float32 (V, 3), board units.
        triangles: uint32 (T, 3).
        colors: uint8 (V, 3).
    """

    vertices: np.ndarray
    triangles: np.ndarray
    colors: np.ndarray


def object_pixels(episode: Episode, image: Image, rays: Rays) -> np.ndarray:
    """1 + index of the object that each pixel shows, 0 for board and table; int (H, W)."""
    if image.segmentation is not None:
        owner = np.array([0, *(link.object + 1 for link in episode.links)])
        return owner[image.segmentation]
    pixels = np.zeros(image.rgb.shape[:2], int)
    if image.depth is None:
        return pixels
    high = rays.heights(image.depth) > OBJECT_HEIGHT
    for index, (u0, v0, u1, v1) in enumerate(np.maximum(image.boxes.astype(int), 0)):
        pixels[v0:v1, u0:u1][high[v0:v1, u0:u1]] = index + 1
    return pixels


def board_face(image: Image, objects: np.ndarray, camera: Camera, size: tuple[float, float]) -> np.ndarray:
    """The board's face seen from straight above with the objects painted over, uint8 (FACE_PIXELS, FACE_PIXELS, 3).

    The upper left corner is the board's (-x, +y) corner.
    """
    half = np.array(size) / 2
    corners = np.array([[-half[0], half[1], 0], [half[0], half[1], 0], [half[0], -half[1], 0], [-half[0], -half[1], 0]])
    seen = project(corners, camera)[0].astype(np.float32)
    target = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32) * FACE_PIXELS
    warp = cv2.getPerspectiveTransform(seen, target)
    covered = cv2.dilate((objects > 0).astype(np.uint8), np.ones((7, 7), np.uint8))
    shape = (FACE_PIXELS, FACE_PIXELS)
    face = cv2.warpPerspective(image.rgb, warp, shape, borderMode=cv2.BORDER_REPLICATE)
    holes = cv2.warpPerspective(covered, warp, shape, flags=cv2.INTER_NEAREST)
    return cv2.inpaint(face, holes, 5, cv2.INPAINT_TELEA)


def object_relief(image: Image, own: np.ndarray, rays: Rays) -> Relief | None:
    """The pixels `own` (bool (H, W)) as a surface whose rim falls down to the board; None if nothing is visible.

    Where the camera measured no depth, the surface has a hole.
    """
    assert image.depth is not None
    box = cv2.boundingRect(own.astype(np.uint8))
    if box[2] == 0:
        return None
    rows = slice(max(box[1] - 2, 0), box[1] + box[3] + 2)
    columns = slice(max(box[0] - 2, 0), box[0] + box[2] + 2)
    inner = own[rows, columns].astype(np.uint8)
    solid = np.asarray(cv2.morphologyEx(inner, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)), np.uint8)
    inner = solid if solid.any() else inner  # parts of one or two pixels' width would stand there as tall thin fences
    depth = image.depth[rows, columns]
    used = cv2.dilate(inner, np.ones((3, 3), np.uint8)).astype(bool) & ((inner == 0) | (depth > 0))
    directions = rays.directions[rows, columns]
    points = directions * depth[..., None] + rays.origin
    rim = used & (inner == 0)
    points[rim] = (directions * (-rays.origin[2] / directions[..., 2:]) + rays.origin)[rim]  # on the board, z = 0
    colors = np.where(rim[..., None], _rim_colors(image.rgb[rows, columns], inner), image.rgb[rows, columns])
    number = np.full(used.shape, -1)
    number[used] = np.arange(int(used.sum()))
    triangles = _triangles(number)
    if not inner[used][triangles].any():
        return None  # nothing but rim: the object itself is one hole
    return Relief(points[used].astype(np.float32), triangles, colors[used].astype(np.uint8))


def _rim_colors(rgb: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """The object's colours carried over its outline and darkened: the sides, which no camera saw."""
    weight = cv2.blur(inner.astype(np.float32), (3, 3))
    spread = cv2.blur(rgb.astype(np.float32) * inner[..., None], (3, 3))
    return SIDE_SHADE * spread / np.maximum(weight, 1e-6)[..., None]


def _triangles(number: np.ndarray) -> np.ndarray:
    """Two triangles for every 2 x 2 block of numbered pixels, counter-clockwise seen from the camera."""
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    whole = (a >= 0) & (b >= 0) & (c >= 0) & (d >= 0)
    upper = np.stack([a[whole], c[whole], b[whole]], axis=1)
    lower = np.stack([b[whole], c[whole], d[whole]], axis=1)
    return np.concatenate([upper, lower]).astype(np.uint32)


class BoardLogger:
    """Logs what changed since the frame before, and nothing else.

    Attributes:
        tops: (N, 3) point above each object from which arcs start, board frame.
    """

    def __init__(self, recording: rr.RecordingStream, episode: Episode):
        self.recording, self.episode = recording, episode
        self.rays = Rays(episode.camera)
        self.names = object_names(episode.board)
        self.tops = centres(episode).copy()
        self.tops[:, 2] = np.maximum(self.tops[:, 2], 0.1)
        self._before: dict[int, bytes] = {}

    def log_static(self) -> None:
        """Axes, the board's slab and its textured face."""
        self.recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        size, image = self.episode.board.size, self.episode.image(0)
        half = [size[0] / 2, size[1] / 2, SLAB / 2]
        face = board_face(image, object_pixels(self.episode, image, self.rays), self.episode.camera, size)
        edge = tuple(int(x) for x in face.reshape(-1, 3).mean(0) * 0.6)
        slab = rr.Boxes3D(centers=[[0, 0, -SLAB / 2 - 0.01]], half_sizes=[half], colors=[edge], fill_mode="solid")
        self.recording.log("world/board/slab", slab, static=True)
        corners = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * half[:2]
        mesh = rr.Mesh3D(
            vertex_positions=np.column_stack([corners, np.zeros(4)]),
            triangle_indices=[[0, 2, 1], [0, 3, 2]],
            vertex_texcoords=[[0, 0], [1, 0], [1, 1], [0, 1]],
            albedo_texture=face,
        )
        self.recording.log("world/board/face", mesh, static=True)

    def log_frame(self, frame: int) -> None:
        """Reliefs and boxes of the objects that changed, and the action that led here."""
        image = self.episode.image(frame)
        if looks_new(self.episode, frame) and image.depth is not None:
            owner = object_pixels(self.episode, image, self.rays)
            for index in range(len(self.names)):
                self._log_object(index, owner == index + 1, frame)
        if frame > 0:
            done = self.episode.steps[frame - 1]
            vector = 0.5 * DIRECTIONS[done.direction]
            arrow = rr.Arrows3D(origins=[done.position], vectors=[vector], colors=[ACTION], radii=0.025)
            self.recording.log("world/action", arrow)

    def _log_object(self, index: int, own: np.ndarray, frame: int) -> None:
        relief = object_relief(self.episode.image(frame), own, self.rays)
        if relief is None:
            return
        seen = relief.colors.tobytes() + relief.vertices.tobytes()
        if self._before.get(index) == seen:
            return
        self._before[index] = seen
        name = self.names[index]
        mesh = rr.Mesh3D(
            vertex_positions=relief.vertices, triangle_indices=relief.triangles, vertex_colors=relief.colors
        )
        self.recording.log(["world", "objects", name], mesh)
        low, high = relief.vertices.min(0), relief.vertices.max(0)
        low[2] = 0
        if frame == 0:
            self.tops[index, 2] = high[2]
        color = ROLES[self.episode.board.objects[index].role]
        center, size = (low + high) / 2, high - low
        box = rr.Boxes3D(
            centers=[center], sizes=[size], colors=[color], radii=rr.Radius.ui_points(1.0), fill_mode="majorwireframe"
        )
        self.recording.log(["world", "boxes", name], box)
        above = [center[0], center[1], high[2] + LABEL_LIFT]
        label = rr.Points3D([above], labels=[name], colors=[text_on_dark(color)], radii=0.0, show_labels=True)
        self.recording.log(["world", "names", name], label)

    def log_true_relations(self, edges: list[Edge], static: bool = True) -> None:
        """The board's own relations, thin, for the whole episode or from now on."""
        path, colors = ["world", "relations", "true"], [TRUTH] * len(edges)
        log_arcs(self.recording, path, self._ends(edges), colors, 0.012, 0.0, static=static)

    def log_inferred_relations(self, name: str, edges: list[Edge]) -> None:
        """Claimed relations by verdict, paler the less probable."""
        claimed = [edge for edge in edges if edge.verdict != "missed"]
        colors = [mix(VERDICTS[e.verdict], (235, 235, 235), 0.7 * (1 - e.probability)) for e in claimed]
        log_arcs(self.recording, ["world", "relations", name], self._ends(claimed), colors, 0.026, INFERRED_LIFT)

    def _ends(self, edges: list[Edge]) -> list[tuple[np.ndarray, np.ndarray]]:
        return [(self.tops[edge.cause], self.tops[edge.effect]) for edge in edges]


def log_arcs(
    recording: rr.RecordingStream,
    path: list[str],
    ends: list[tuple[np.ndarray, np.ndarray]],
    colors: list[Rgb],
    radius: float,
    lift: float,
    static: bool = False,
) -> None:
    """Arrows that rise from the board and come down again, one per pair of ends."""
    curves = [arc(start, end, lift) for start, end in ends]
    shafts = rr.LineStrips3D([curve[:-1] for curve in curves], colors=colors, radii=radius)
    recording.log([*path, "arcs"], shafts, static=static)
    lasts = np.reshape([curve[-2:] for curve in curves], (-1, 2, 3))
    tips = lasts[:, 1] - lasts[:, 0]
    vectors = tips / np.maximum(np.linalg.norm(tips, axis=1, keepdims=True), 1e-9) * HEAD
    heads = rr.Arrows3D(origins=lasts[:, 1] - vectors, vectors=vectors, colors=colors, radii=radius * 1.2)
    recording.log([*path, "heads"], heads, static=static)


def arc(start: np.ndarray, end: np.ndarray, lift: float = 0.0) -> np.ndarray:
    """A parabola from start to end, (ARC_POINTS + 1, 3), higher by `lift` and the farther they are apart."""
    share = np.linspace(0, 1, ARC_POINTS + 1)[:, None]
    height = 0.35 + lift + 0.25 * float(np.linalg.norm(end - start))
    points = start + share * (end - start)
    points[:, 2] += (4 * height * share * (1 - share))[:, 0]
    return points
