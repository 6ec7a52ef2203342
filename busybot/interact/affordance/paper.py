"""A trained model of the `paper` variant: the same folder and the same questions as `interact.affordance.fast`.

Its networks see whole pictures (paper appendix A.1 "Network detail") in four channels: the depth image and the surface
normals from the cross product of neighbouring world coordinates; or in three of colours. For the direction network
there is one more, a 2-D Gaussian at the selected position.

What the paper leaves open: depth is given relative to the camera's height over the board, in board units, so that the
board is near 0; where nothing was hit it is taken to be there. How neighbours are weighed in normals is as the paper's
authors have it, and so is the width of the Gaussian at the position, which is 1 at its centre.
"""

from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_IMAGE_PIXELS
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.interact.affordance.fast import AffordanceModel, AffordanceView
from busybot.interact.affordance.inputs import LOWEST, Pinhole, colour_features, unit
from busybot.interact.affordance.networks import (
    LEAST_SIDE,
    SIZE,
    Kind,
    PaperDirectionNet,
    Size,
    make_paper_network,
)
from busybot.interact.policy.config import Inputs, Threshold
from busybot.interact.policy.direction_pairs import ELEVATED, NOT_ELEVATED
from busybot.training.device import exactly, keep_memory, slices

GAUSSIAN_SIGMA = 10.0
"""Of the position's Gaussian, pixels; of the authors' program, which draws it in a window of 80."""
NORMAL_SIGMA, NORMAL_REACH = 2.0, 8
"""Of the Gaussian whose derivatives weigh a point's neighbours (the authors'), and how far these are away, pixels."""


def depth_and_normals(depth: Tensor, camera: Pinhole) -> Tensor:
    """The four channels, (B, 4, H, W), of depth images float32 (B, H, W) in board units, 0 where nothing was hit."""
    board = float(camera.origin[2])
    depth = torch.where(depth > 0, depth, board)
    return torch.cat([depth[:, None] - board, gaussian_normals(depth, camera)], dim=1)


def gaussian_normals(depth: Tensor, camera: Pinhole) -> Tensor:
    """Normals towards the camera, n = a x b, of the unit tangents down and across, which are the derivatives of a
    Gaussian G along the picture's columns and rows: a = G' * p / |G' * p| with points p.

    As in the authors' program nothing is smoothed across a tangent, and n is not normalised: it is as long as the sine
    of the angle between the tangents, 1 where a plane faces the camera. Beyond the border the nearest point goes on.

    Shapes:
        depth: float32 (B, H, W), board units, everywhere known.
        returns: float32 (B, 3, H, W).
    """
    rows, columns = (torch.arange(side, device=depth.device)[None] for side in depth.shape[-2:])
    points = camera.points(depth, rows, columns)
    offsets = torch.arange(-NORMAL_REACH, NORMAL_REACH + 1, device=depth.device) / NORMAL_SIGMA
    slope = offsets * torch.exp(-(offsets**2) / 2)
    down = _filtered(points, slope[:, None], (0, 0, NORMAL_REACH, NORMAL_REACH))
    across = _filtered(points, slope[None], (NORMAL_REACH, NORMAL_REACH, 0, 0))
    return torch.linalg.cross(unit(down), unit(across), dim=1)


def _filtered(points: Tensor, kernel: Tensor, border: tuple[int, int, int, int]) -> Tensor:
    """(B, 3, H, W) with every coordinate filtered, after so much was added on each side.

    Exact float32: neighbouring points differ by a hundredth of their distance, of which coarser numbers leave nothing.
    """
    padded = functional.pad(points, border, mode="replicate")
    channels = padded.flatten(0, 1)[None].contiguous(memory_format=torch.channels_last)
    count = channels.shape[1]
    with exactly():
        found = functional.conv2d(channels, kernel.expand(count, 1, *kernel.shape), groups=count)
    return found[0].unflatten(0, points.shape[:2])


def with_positions(features: Tensor, pixels: Tensor) -> Tensor:
    """Add the channel that tells where the action is.

    Shapes:
        features: (B, C, H, W); pixels: (B, 2), u and v.
        returns: (B, C + 1, H, W).
    """
    height, width = features.shape[-2:]
    columns = torch.arange(width, device=features.device)[None, None] - pixels[:, 0, None, None]
    rows = torch.arange(height, device=features.device)[None, :, None] - pixels[:, 1, None, None]
    gaussian = torch.exp(-(columns**2 + rows**2) / (2 * GAUSSIAN_SIGMA**2))
    return torch.cat([features, gaussian[:, None].to(features.dtype)], dim=1)


PAPER_POLICY: dict[str, Threshold] = {
    "candidates": "kmeans",
    "cluster_belief": "middle",
    "blur": 1,
    "caution": 0,
    "temperature": 1,
    "component_penalty": 0,
    "failure_penalty": 0,
    "responder_penalty": 0,
    "trigger_bonus": 0,
}
"""What the learned policy's constants are with a paper model: clusters, affordance and directions as they are."""
PAPER_PRIOR = 0.5
"""The affordance is taken as it is: no correction for how rare working places are."""
CHUNK = 8
"""Positions that the direction network looks at together, on a GPU more."""


def refuse_former(file: Path, tensors: dict[str, Tensor]) -> None:
    """Refuse weights of former versions: without normalisation, or with two convolutions at full resolution."""
    if "stem.0.0.weight" in tensors or not any(name.endswith("running_mean") for name in tensors):
        what = f"{file}: weights of the `paper` variant as its networks were before"
        raise BusybotError(what, "train the model again: `busybot train interact --variant paper`")


def size_in(tensors: dict[str, Tensor]) -> Size:
    """Rows and columns of the pictures that a stranger's weights are for, as those of the direction network tell.

    Raises:
        BusybotError: no picture has that size, or it is too small for the networks.
    """
    size = tensors.get("size")
    if size is None or size.shape != (2,):  # where it should be there, who compares the weights tells it
        return SIZE
    sides = size.tolist()
    if size.dtype != torch.int64 or min(sides) < 1 or prod(sides) > MAX_IMAGE_PIXELS:
        raise BusybotError(f"size is {sides}, rows and columns that no picture has", "copy the model again")
    refuse_small((sides[0], sides[1]))
    return sides[0], sides[1]


def refuse_small(size: Size) -> None:
    """Refuse pictures of so few rows or columns that the direction network sees nothing of them."""
    if min(size) < LEAST_SIDE:
        what = f"pictures of {size[1]} x {size[0]} pixels: networks of the `paper` variant need {LEAST_SIDE} a side"
        raise BusybotError(what, "--set render.width and render.height, or the variant `fast`")


class PaperModel(AffordanceModel):
    """Where and how to act, from whole pictures of the size that it was trained on.

    The affordance is that of the paper, softmax of two channels, given as a logit; only elevated pixels can be chosen
    (the board's surface cannot be held). The direction network has no opinion on positions: `directions` repeats the
    position network's.
    """

    @staticmethod
    def make_network(kind: Kind, inputs: Inputs, tensors: dict[str, Tensor]) -> nn.Module:
        return make_paper_network(kind, inputs, size_in(tensors))

    def look(self, seen: Observation, rays: Rays, earlier: AffordanceView | None = None) -> AffordanceView:
        """Affordance of every pixel of a picture; reads its depth, and its colours if the model sees colours.

        An earlier look saves nothing here: both networks see whole pictures.

        Raises:
            BusybotError: the picture has another size than those of the training.
        """
        self._check_size(seen.depth.shape)
        keep_memory()
        height = np.nan_to_num(rays.heights(seen.depth), nan=LOWEST).astype(np.float32)
        if self.info.inputs == "rgb":
            features = colour_features(seen.rgb)[None]
        else:
            features = depth_and_normals(torch.from_numpy(seen.depth)[None].to(self.on), self._pinhole(rays)).cpu()
        logits = self._run("position", features)[0]
        affordance = torch.where(torch.from_numpy(height > ELEVATED), logits[1] - logits[0], NOT_ELEVATED)
        return AffordanceView(height, affordance.numpy(), features[0].numpy())

    def directions(self, view: AffordanceView, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `AffordanceModel.directions`; the position's logits are those of the affordance."""
        if not len(pixels):
            return np.empty(0, np.float32), np.empty((0, 18), np.float32)
        features, scores = torch.from_numpy(view.features), []
        for part in slices(len(pixels), CHUNK, self.on):
            chunk = torch.from_numpy(np.asarray(pixels[part]))
            seen = with_positions(features.expand(len(chunk), -1, -1, -1), chunk)
            scores.append(torch.sigmoid(self._run("direction", seen)))
        return view.affordance[pixels[:, 1], pixels[:, 0]], torch.cat(scores).numpy()

    def _run(self, kind: Kind, features: Tensor) -> Any:
        with torch.inference_mode(), torch.autocast(self.on.type, torch.bfloat16, enabled=self.bfloat16):
            on_device = features.to(self.on).contiguous(memory_format=torch.channels_last)
            return self.networks[kind](on_device).float().cpu()

    def _check_size(self, shape: tuple[int, ...]) -> None:
        network = self.networks["direction"]
        assert isinstance(network, PaperDirectionNet)
        rows, columns = (int(side) for side in network.size)
        if shape != (rows, columns):
            what = f"a picture of {shape[1]} x {shape[0]} pixels, the model was trained on {columns} x {rows}"
            raise BusybotError(what, f"--set render.width={columns} --set render.height={rows}")
