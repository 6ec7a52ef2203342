"""The camera's matrix and pose from pictures of a checkerboard, as `camera.json` of a camera's folder has them.

Several pictures of the checkerboard, held at different slants, tell the matrix (Zhang's method, OpenCV's
`calibrateCamera`, without distortion: pictures are undistorted before). In one of them it lies flat in the middle of
the board, its rows along its width: that one tells the pose. Its first corner is the one at the upper left of the
picture.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from busybot.common.errors import BusybotError
from busybot.datasets.importing.camera_pictures import PICTURES, Shot, decode_picture
from busybot.datasets.importing.recording import BOARD

LEAST = 3
"""Pictures with the whole checkerboard that are needed."""
MOST_ERROR = 1.0
"""Mean distance of corners from where the camera would see them, pixels: more is a lens that bends lines, or blur."""
STARTS = (0.5, 1.0, 2.0)
"""Focal lengths from which the search begins, and that are tried as they are, widths of the picture."""
MOST_AS_GOOD = 1.05
"""Error of a focal length that was tried, times that of the one found: with less it fits as well."""
OTHER = 0.2
"""Part of a focal length by which another one differs from it."""
LEAST_ERROR = 0.1
"""Pixels that corners are found to: less is not looked into."""
MOST_LEFT_OUT = 30
"""Pictures of which it is tried whether the others agree better without."""
MOST_SPREAD = 0.02
"""Part of the focal length that its standard deviation may have, and by which others than an odd picture differ."""


@dataclass(frozen=True)
class Checkerboard:
    """Inner corners in a row and in a column, and the side of a square, of any unit."""

    columns: int
    rows: int
    side: float

    @property
    def points(self) -> np.ndarray:
        """float32 (rows * columns, 3): corners around the middle, x right and y up, row by row from above."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        middle = np.array([self.columns - 1, self.rows - 1]) / 2
        flat = np.stack([x.ravel() - middle[0], middle[1] - y.ravel(), np.zeros(x.size)], axis=1)
        return (flat * self.side).astype(np.float32)


def calibrate(folder: Path, board: Checkerboard, flat: str, width: float) -> dict[str, Any]:
    """What `camera.json` says, and the error in pixels.

    Args:
        folder: with pictures of one size.
        flat: name of the one in which the checkerboard lies in the middle of the board.
        width: of the board, in the unit of the checkerboard's side.

    Raises:
        BusybotError: naming a picture that is missing, or of another size; too few show the checkerboard, or no camera
            without distortion sees it so.
    """
    found = _found(folder, board)
    size = _one_size(folder, found)
    seen = {name: corners for name, (corners, _) in found.items() if corners is not None}
    if flat not in found:
        raise BusybotError(f"{folder / flat}: there is no such picture", "--flat names the one for the pose")
    if flat not in seen or len(seen) < LEAST:
        what = f"{folder}: {len(seen)} of {len(found)} pictures show {board.columns} x {board.rows} inner corners"
        hint = f"{LEAST} are needed, {flat} among them; count the inner corners, and keep the rim of paper white"
        raise BusybotError(what, hint)
    error, matrix = _matrix(board, seen, size, folder)
    _, turn, place = cv2.solvePnP(board.points, seen[flat], matrix, np.zeros(5))
    rotation = cv2.Rodrigues(turn)[0]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.T, -(rotation.T @ place).ravel()
    if pose[2, 3] <= 0:
        raise BusybotError(f"{folder / flat}: the camera would be below the board", "film it from above")
    camera = {"matrix": matrix.round(6).tolist(), "pose": pose.round(9).tolist(), "unit": width / BOARD}
    return {"camera": camera, "error": round(error, 3), "pictures": len(seen)}


def _found(folder: Path, board: Checkerboard) -> dict[str, tuple[np.ndarray | None, tuple[int, ...]]]:
    """Corners, float32 (K, 2), and shape of each picture; None where the checkerboard does not show."""
    if not folder.is_dir():
        raise BusybotError(f"{folder}: there is no such folder", "name a folder with pictures of the checkerboard")
    names = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in PICTURES)
    told: dict[str, tuple[np.ndarray | None, tuple[int, ...]]] = {}
    for name in names:
        grey = decode_picture(folder, Shot(name, -1, None, None, str(folder / name)), name, cv2.IMREAD_GRAYSCALE)
        there, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=cv2.CALIB_CB_ACCURACY)
        if there:
            corners = corners.reshape(-1, 2)
            corners = corners if corners[0].sum() < corners[-1].sum() else corners[::-1].copy()
        told[name] = (corners if there else None, grey.shape)
    return told


def _one_size(folder: Path, found: dict[str, tuple[np.ndarray | None, tuple[int, ...]]]) -> tuple[int, int]:
    """Width and height of all pictures."""
    if not found:
        raise BusybotError(f"{folder}: it has no pictures", f"it reads {', '.join(PICTURES)}")
    first, (_, shape) = next(iter(found.items()))
    for name, (_, other) in found.items():
        if other != shape:
            what = f"{folder / name}: {other[1]} x {other[0]} pixels, {first} has {shape[1]} x {shape[0]}"
            raise BusybotError(what, "pictures of one camera at one setting have one size")
    return shape[1], shape[0]


def _matrix(
    board: Checkerboard, seen: Mapping[str, np.ndarray], size: tuple[int, int], folder: Path
) -> tuple[float, np.ndarray]:
    """The error, pixels, and the matrix of a camera whose pixels are square.

    Pictures of one slant fit cameras of any focal length. Then the search ends where its beginning or the noise of
    corners takes it, at times with a small deviation: what tells is that a quite other focal length fits as well.
    """
    corners = list(seen.values())
    error, matrix, deviation = min(
        (_search(board, corners, size, size[0] * start) for start in STARTS), key=itemgetter(0)
    )
    focal = matrix[0, 0]
    _refuse_odd_one(board, seen, size, folder, (error, focal))
    if not error <= MOST_ERROR:
        what = f"{folder}: the corners lie {error:.1f} pixels from where a camera without distortion sees them"
        raise BusybotError(what, "undistort the pictures, hold the checkerboard still, and count its inner corners")
    inside = 0 < matrix[0, 2] < size[0] and 0 < matrix[1, 2] < size[1]
    doubt = _as_good(board, corners, size, (error, focal))
    if not (doubt or (inside and 0 <= deviation <= MOST_SPREAD * focal)):
        doubt = f"{focal:.0f} ± {deviation:.0f} pixels"
    if doubt:
        what = f"{folder}: the pictures tell no focal length: {doubt}"
        raise BusybotError(what, "take pictures with the checkerboard held at several slants, not only turned")
    return error, matrix


def _as_good(
    board: Checkerboard, corners: Sequence[np.ndarray], size: tuple[int, int], found: tuple[float, float]
) -> str | None:
    """A quite other focal length that fits as well as the one found, for people; None if there is none.

    Args:
        found: error and focal length, pixels.
    """
    error, focal = found
    for other in (size[0] * start for start in STARTS):
        far = abs(other - focal) > OTHER * focal
        if far and _search(board, corners, size, other, fixed=True)[0] <= error * MOST_AS_GOOD:
            return f"{other:.0f} pixels fit as well as {focal:.0f}"
    return None


def _search(
    board: Checkerboard, seen: Sequence[np.ndarray], size: tuple[int, int], focal: float, fixed: bool = False
) -> tuple[float, np.ndarray, float]:
    """Error, matrix, and the focal length's standard deviation, pixels, from this focal length on, or with it."""
    flags = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    flags |= cv2.CALIB_USE_INTRINSIC_GUESS | (cv2.CALIB_FIX_FOCAL_LENGTH if fixed else cv2.CALIB_FIX_ASPECT_RATIO)
    start = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1.0]])
    points = [board.points] * len(seen)
    told = cv2.calibrateCameraExtended(points, list(seen), size, start, np.zeros(5), flags=flags)
    error, matrix, deviations = told[0], told[1], told[5]
    return float(error) if np.isfinite(matrix).all() else np.inf, matrix, deviations[:2].max()


def _refuse_odd_one(
    board: Checkerboard,
    seen: Mapping[str, np.ndarray],
    size: tuple[int, int],
    folder: Path,
    told: tuple[float, float],
) -> None:
    """Refuse a picture that the camera of the others did not take: one that was cut or made larger bends the whole.

    Args:
        told: error and focal length of all, pixels.
    """
    if len(seen) <= LEAST or told[0] < LEAST_ERROR:
        return
    without = {}
    for name in list(seen)[:MOST_LEFT_OUT]:
        others = [corners for other, corners in seen.items() if other != name]
        error, matrix, deviation = _search(board, others, size, size[0])
        if deviation <= MOST_SPREAD * matrix[0, 0]:
            without[name] = (error, matrix[0, 0])
    name, (error, focal) = min(without.items(), key=lambda one: one[1], default=("", (np.inf, 1.0)))
    if error < told[0] / 2 and (told[0] > MOST_ERROR or abs(told[1] / focal - 1) > MOST_SPREAD):
        what = f"{folder / name}: the other pictures tell a focal length of {focal:.0f} pixels, {told[1]:.0f} with it"
        raise BusybotError(what, "remove it: is it of another camera, or was it cut, turned or made larger?")
