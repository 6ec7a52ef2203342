"""A trained model of the `paper` variant: the same folder and the same questions as `interact.affordance.fast`.

Its networks see whole pictures (paper appendix A.1 "Network detail") in four channels: the depth image and the surface
normals from the cross product of neighbouring world coordinates; or in three of colours. For the direction network
there is one more, a 2-D Gaussian at the selected position.

What the paper leaves open: depth is given relative to the camera's height over the board, in board units, so that the
board is near 0, and 0 where nothing was hit; the Gaussian is 1 at its centre, and as wide as its authors have it.
"""

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from busybot.common.errors import BusybotError
from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.interact.affordance.fast import AffordanceModel, AffordanceView
from busybot.interact.affordance.inputs import LOWEST, Pinhole, colour_features, stack_features
from busybot.interact.affordance.networks import SIZE, Kind, PaperDirectionNet, make_paper_network
from busybot.interact.policy.config import Inputs, Threshold
from busybot.interact.policy.direction_pairs import ELEVATED, NOT_ELEVATED
from busybot.training.device import mixed, slices

GAUSSIAN_SIGMA = 10.0
"""Pixels; of the authors' program, which draws it in a window of 80."""


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


PAPER_POLICY: dict[str, Threshold] = {
    "candidates": "kmeans",
    "blur": 1,
    "caution": 0,
    "temperature": 1,
    "component_penalty": 0,
    "failure_penalty": 0,
    "responder_penalty": 0,
    "trigger_bonus": 0,
    "collect": 0.5,
    "untried_first": False,
}
"""What the learned policy's constants are with a paper model: clusters, affordance and directions as they are, and
data for reasoning by a draw among all candidates (section 3.2, "Data collection")."""
PAPER_PRIOR = 0.5
"""The affordance is taken as it is: no correction for how rare working places are."""
CHUNK = 8
"""Positions that the direction network looks at together, on a GPU more."""


class PaperModel(AffordanceModel):
    """Where and how to act, from whole pictures of the size that it was trained on.

    The affordance is that of the paper, softmax of two channels, given as a logit; only elevated pixels can be chosen
    (the board's surface cannot be held). The direction network has no opinion on positions: `directions` repeats the
    position network's.
    """

    @staticmethod
    def make_network(kind: Kind, inputs: Inputs, tensors: dict[str, Tensor]) -> nn.Module:
        size = tensors.get("size")  # of the direction network alone
        rows, columns = SIZE if size is None or size.shape != (2,) else size.tolist()
        return make_paper_network(kind, inputs, (int(rows), int(columns)))

    def look(self, seen: Observation, rays: Rays, earlier: AffordanceView | None = None) -> AffordanceView:
        """Affordance of every pixel of a picture; reads its depth, and its colours if the model sees colours.

        An earlier look saves nothing here: both networks see whole pictures.

        Raises:
            BusybotError: the picture has another size than those of the training.
        """
        self._check_size(seen.depth.shape)
        height = np.nan_to_num(rays.heights(seen.depth), nan=LOWEST).astype(np.float32)
        if self.info.inputs == "rgb":
            features = colour_features(seen.rgb)[None]
        else:
            features = depth_and_normals(torch.from_numpy(seen.depth)[None], self._pinhole(rays))
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
        with torch.inference_mode(), mixed(self.on):
            on_device = features.to(self.on).contiguous(memory_format=torch.channels_last)
            return self.networks[kind](on_device).float().cpu()

    def _check_size(self, shape: tuple[int, ...]) -> None:
        network = self.networks["direction"]
        assert isinstance(network, PaperDirectionNet)
        rows, columns = (int(side) for side in network.size)
        if shape != (rows, columns):
            what = f"a picture of {shape[1]} x {shape[0]} pixels, the model was trained on {columns} x {rows}"
            raise BusybotError(what, f"--set render.width={columns} --set render.height={rows}")
