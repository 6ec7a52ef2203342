"""Training batches: crops of recorded pictures, moved, scaled, turned and mirrored together with their labels.

What makes a switch work does not depend on where on the board it stands, nor much on its size or on how it is turned
about the camera's axis. So each crop is shown at a random offset, scale, aspect and height and in one of the eight
orientations of a square, and heights, normals and directions change as the object itself would.

In the picture +x is right and +y is up. `MIRROR_X` maps (x, y) to (-x, y), `MIRROR_Y` to (x, -y), and `TRANSPOSE`,
which swaps rows and columns, to (-y, -x). Quarter turns are transpositions with one mirror.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from busybot.boards.directions import DIRECTIONS
from busybot.interact.affordance.inputs import Pinhole, colour_features, depth_features, unit
from busybot.interact.training.config import FitConfig
from busybot.interact.training.sample_cache import SIDE, Samples

MIRROR_X = np.diag([-1.0, 1.0, 1.0])
MIRROR_Y = np.diag([1.0, -1.0, 1.0])
TRANSPOSE = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def remapped_directions(matrix: np.ndarray) -> np.ndarray:
    """For each direction the index of the one that `matrix` (3, 3) takes to it: labels[remapped] are the new labels."""
    images = DIRECTIONS @ matrix.T
    return np.argmax(DIRECTIONS @ images.T, axis=1)


@dataclass
class Batch:
    """B crops.

    Attributes:
        features: float32 (B, C, S, S).
        rows, columns: int64 (B,), the pixel acted on, in the crop.
        reward: float32 (B,).
        labels, known: float32 (B, 18), which directions worked and for which that is known.
    """

    features: Tensor
    rows: Tensor
    columns: Tensor
    reward: Tensor
    labels: Tensor
    known: Tensor


def draw_batch(samples: Samples, chosen: np.ndarray, config: FitConfig, rng: np.random.Generator) -> Batch:
    """Crops of the chosen samples, augmented."""
    augmentation, depth = config.augmentation, samples.inputs == "depth"
    rows, columns = _draw_sides(config, rng)
    cut = max(rows, columns)
    reach = min(config.jitter, min(rows, columns) // 2 - 1, (SIDE - 2 - cut) // 2)
    batch = cut_batch(samples, chosen, cut, rng.integers(-reach, reach + 1, (len(chosen), 2)))
    _narrow(batch, rows, columns)
    heights = np.exp(rng.uniform(-1, 1, len(chosen)) * augmentation.log_height).astype(np.float32)
    _resize(batch, config.side, torch.from_numpy(heights) if depth else None)
    for matrix, share in ((MIRROR_X, 0.5), (MIRROR_Y, 0.5), (TRANSPOSE, augmentation.transposed)):
        apply_symmetry(batch, matrix, torch.from_numpy(rng.random(len(chosen)) < share), depth)
    if samples.inputs == "rgb" and augmentation.colour:
        gain, offset = rng.normal(0, augmentation.colour, (2, len(chosen), 3, 1, 1)).astype(np.float32)
        batch.features = batch.features * torch.from_numpy(1 + gain) + torch.from_numpy(offset / 2)
    return batch


def _draw_sides(config: FitConfig, rng: np.random.Generator) -> tuple[int, int]:
    """How many rows and columns become the `side` pixels of this batch; even numbers."""
    augmentation = config.augmentation
    scaled = rng.random() < augmentation.scaled
    scale, stretch = rng.uniform(-1, 1, 2) * (augmentation.log_scale, augmentation.log_stretch) * scaled
    sides = [int(config.side * np.exp(scale + part)) // 2 * 2 for part in (stretch / 2, -stretch / 2)]
    return min(sides[0], SIDE - 2), min(sides[1], SIDE - 2)


def cut_batch(samples: Samples, chosen: np.ndarray, side: int, offsets: np.ndarray | None = None) -> Batch:
    """Crops around the samples' pixels as they are.

    Args:
        offsets: int (B, 2), rows and columns by which the crops are moved.
    """
    moved = np.zeros((len(chosen), 2), int) if offsets is None else offsets
    if samples.inputs == "depth":
        features = _cut_depth(samples, chosen, side, moved)
    else:
        features = colour_features(_crops(samples, chosen, side, moved))
    labels, known = samples.direction_labels(chosen)
    return Batch(
        features=features,
        rows=torch.from_numpy(side // 2 - moved[:, 0]),
        columns=torch.from_numpy(side // 2 - moved[:, 1]),
        reward=torch.from_numpy(samples.reward[chosen].astype(np.float32)),
        labels=torch.from_numpy(labels.astype(np.float32)),
        known=torch.from_numpy(known.astype(np.float32)),
    )


def _cut_depth(samples: Samples, chosen: np.ndarray, side: int, moved: np.ndarray) -> Tensor:
    """Features from depth, (B, 4, side, side); each needs a margin of one pixel."""
    around = np.arange(-1, side + 1) - side // 2
    depth = samples.depths(chosen, _crops(samples, chosen, side + 2, moved))
    rows = samples.pixels[chosen, 1, None] + moved[:, :1] + around
    columns = samples.pixels[chosen, 0, None] + moved[:, 1:] + around
    camera = samples.camera
    rows, columns = rows.clip(0, camera.height - 1), columns.clip(0, camera.width - 1)
    return depth_features(Pinhole(camera).points(depth, torch.from_numpy(rows), torch.from_numpy(columns)))


def _crops(samples: Samples, chosen: np.ndarray, side: int, moved: np.ndarray) -> np.ndarray:
    """The middle of the samples' squares as stored, moved: (B, side, side) or (B, side, side, 3)."""
    corners = SIDE // 2 - side // 2 + moved
    squares = zip(map(samples.picture, chosen), corners, strict=True)
    return np.stack([square[top : top + side, left : left + side] for square, (top, left) in squares])


def _narrow(batch: Batch, rows: int, columns: int) -> None:
    """Keep so many rows and columns around the middle of square crops."""
    top, left = ((batch.features.shape[-1] - kept) // 2 for kept in (rows, columns))
    batch.features = batch.features[:, :, top : top + rows, left : left + columns]
    batch.rows, batch.columns = batch.rows - top, batch.columns - left


def _resize(batch: Batch, side: int, heights: Tensor | None) -> None:
    """Show the crops `side` pixels wide and high, as if everything in them were larger, smaller, slimmer or flatter.

    Args:
        heights: of depth features, factors (B,) by which things become higher than the crop's own scale makes them.
    """
    along, across = (side / size for size in batch.features.shape[-2:])
    features = batch.features
    if along != 1 or across != 1:
        features = functional.interpolate(features, size=(side, side), mode="bilinear", align_corners=False)
    if heights is not None and (along != 1 or across != 1 or bool((heights != 1).any())):
        upward = heights * float(np.sqrt(along * across))
        # a surface that is stretched by s has a normal that is divided by s, along each axis
        stretch = torch.stack([torch.full_like(upward, across), torch.full_like(upward, along), upward], dim=1)
        normal = unit(features[:, 1:] / stretch[:, :, None, None])
        features = torch.cat([features[:, :1] * upward[:, None, None, None], normal], dim=1)
    batch.features = features
    batch.rows = ((batch.rows + 0.5) * along).long().clamp(0, side - 1)
    batch.columns = ((batch.columns + 0.5) * across).long().clamp(0, side - 1)


def apply_symmetry(batch: Batch, matrix: np.ndarray, chosen: Tensor, depth: bool) -> None:
    """Mirror or transpose the chosen crops (bool (B,)) with their labels; `matrix` is one of the three above."""
    part, rows, columns = batch.features[chosen], batch.rows, batch.columns
    last = part.shape[-1] - 1
    if matrix is TRANSPOSE:
        part, moved = part.transpose(-1, -2), (columns, rows)
        if depth:
            part = torch.stack([part[:, 0], -part[:, 2], -part[:, 1], part[:, 3]], dim=1)
    elif matrix is MIRROR_X:
        part, moved = part.flip(-1), (rows, last - columns)
        if depth:
            part[:, 1].neg_()
    else:
        part, moved = part.flip(-2), (last - rows, columns)
        if depth:
            part[:, 2].neg_()
    batch.features[chosen] = part
    batch.rows, batch.columns = torch.where(chosen, moved[0], rows), torch.where(chosen, moved[1], columns)
    order = torch.from_numpy(remapped_directions(matrix))
    batch.labels[chosen] = batch.labels[chosen][:, order]
    batch.known[chosen] = batch.known[chosen][:, order]
