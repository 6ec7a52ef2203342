"""Inputs of the `paper` variant's networks: whole pictures (paper appendix A.1 "Network detail").

Four channels: the depth image and the surface normals from the cross product of neighbouring world coordinates; or
three of colours. For the direction network one more, a 2-D Gaussian at the selected position.

What the paper leaves open: depth is given relative to the camera's height over the board, in board units, so that the
board is near 0, and 0 where nothing was hit; the Gaussian has a standard deviation of 5 pixels and is 1 at its centre.
"""

import numpy as np
import torch
from torch import Tensor

from busybot.interact.affordance.inputs import Pinhole, colour_features, stack_features
from busybot.interact.training.sample_cache import Samples

GAUSSIAN_SIGMA = 5.0
"""Pixels."""


def depth_and_normals(depth: Tensor, camera: Pinhole) -> Tensor:
    """The four channels, (B, 4, H, W), of depth images float32 (B, H, W) in board units, 0 where nothing was hit."""
    features = stack_features(depth, camera)
    features[:, 0] = torch.where(depth > 0, depth - float(camera.origin[2]), 0)
    return features


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


def recorded_pictures(samples: Samples, chosen: np.ndarray, on: torch.device) -> Tensor:
    """What the camera saw before the chosen samples' actions, (B, C, H, W), computed where it is used."""
    stored = np.stack([samples.squares[samples.dataset[i]][samples.row[i]] for i in chosen])
    if samples.inputs == "rgb":
        return colour_features(stored).to(on)
    offset, step = samples.scale[chosen].T[:, :, None, None]
    depth = np.where(stored > 0, offset + stored * step, np.float32(0))
    return depth_and_normals(torch.from_numpy(depth).to(on), Pinhole(samples.camera))
