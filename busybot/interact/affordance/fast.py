"""A trained model: a folder with two files of weights and `model.json`, which says what they are.

Here is the `fast` variant; `interact.affordance.paper` has the `paper` variant. `interact.affordance.load` loads both.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from busybot.episodes.camera import Rays
from busybot.episodes.episode import Observation
from busybot.interact.affordance.folding import FoldedDirectionNet, FoldedPositionNet
from busybot.interact.affordance.incremental import IncrementalPositionNet
from busybot.interact.affordance.inputs import (
    HEIGHT_GAIN,
    LOWEST,
    Pinhole,
    colour_features,
    heights_of,
    picture_features,
    square_around,
    update_features,
)
from busybot.interact.affordance.networks import CROP, POSITION_STRIDE, DirectionNet, Kind, PositionNet, make_network
from busybot.interact.affordance.plan_view import PlanView, oblique
from busybot.interact.policy.config import AffordanceInfo, Inputs
from busybot.interact.policy.direction_pairs import ELEVATED, NOT_ELEVATED
from busybot.training.checkpoint import save_tensors
from busybot.training.device import device, multiplies_bfloat16
from busybot.training.model_cards import write_info

MARGIN = 32
"""The position network is run on what lies within so many pixels of something elevated: a third is saved."""


@dataclass(frozen=True)
class CropFeatures:
    """What the direction network makes of a crop.

    Attributes:
        crop: float32 (C, 64, 64), what it saw.
        position: logit that acting at its centre works.
        directions: float32 (18,), probabilities.
    """

    crop: np.ndarray
    position: np.float32
    directions: np.ndarray


@dataclass(frozen=True)
class AffordanceView:
    """What the model makes of one picture.

    Attributes:
        height: float32 (H, W), board units above the board; the lowest value where nothing was hit.
        affordance: float32 (H, W), logit that acting here works; `NOT_ELEVATED` off the elevated pixels.
        features: float32 (C, H, W), what the networks see; after a later look at the board what they see then.
        closer: the last closer looks, by pixel (u, v); an action changes little of a picture, so most of them hold for
            the next one.
        kept: what the next look at the board can use, if there may be one.
        drawn: of an oblique camera's picture, where the networks saw it.
    """

    height: np.ndarray
    affordance: np.ndarray
    features: np.ndarray
    closer: dict[tuple[int, int], CropFeatures] = field(default_factory=dict)
    kept: "KeptLook | None" = None
    drawn: "DrawnLook | None" = None


@dataclass(frozen=True)
class DrawnLook:
    """An oblique camera's picture as it was drawn from above.

    Attributes:
        plan: what drew it.
        view: of what was drawn.
        cells: int (H, W, 2), where each pixel is drawn, u and v.
    """

    plan: PlanView
    view: AffordanceView
    cells: np.ndarray


@dataclass
class KeptLook:
    """The newest picture of a board, and what the position network made of its part that has something elevated.

    Each look brings it up to date.

    Attributes:
        depth: of the picture.
        features: (C, H, W), what the networks saw.
        window: rows and columns of the part; None where nothing is elevated.
        position: the network with its layers' outputs on that part; None on a GPU, which computes all anew.
    """

    depth: np.ndarray
    features: Tensor
    window: tuple[slice, slice] | None = None
    position: IncrementalPositionNet | None = None


class AffordanceModel:
    """Where and how to act.

    Args:
        networks: `position` and `direction`; they are put into evaluation mode.

    Attributes:
        bfloat16: whether it multiplies in bfloat16, twice as fast on processors that can.
    """

    def __init__(self, info: AffordanceInfo, networks: dict[Kind, nn.Module]):
        self.info, self.on = info, device()
        self.bfloat16 = multiplies_bfloat16()
        self.networks = {kind: network.eval().to(self.on) for kind, network in networks.items()}
        self._folded: dict[tuple[Kind, torch.dtype], Any] = {}
        self._camera: tuple[Rays, Pinhole] | None = None

    @staticmethod
    def make_network(kind: Kind, inputs: Inputs, tensors: dict[str, Tensor]) -> nn.Module:
        """An untrained network that these weights fit, if they are of this variant."""
        return make_network(kind, inputs, tensors)

    def save(self, folder: Path) -> None:
        """Write the folder, `model.json` last."""
        for kind, network in self.networks.items():
            save_tensors(weights_file(folder, kind), network.state_dict())
        write_info(folder, self.info, [weights_file(folder, kind) for kind in self.networks])

    def look(self, seen: Observation, rays: Rays, earlier: AffordanceView | None = None) -> AffordanceView:
        """Affordance of every pixel of a picture; reads its depth, and its colours if the model sees colours.

        Args:
            earlier: of the same board, saves work where nothing has changed; its features become those of this picture.
        """
        if self.info.inputs == "depth" and oblique(rays.camera):
            return self._look_from_above(seen, rays, None if earlier is None else earlier.drawn)
        kept, height, changed = self._features(seen, rays, None if earlier is None else earlier.kept)
        elevated = height > ELEVATED
        affordance = np.full(height.shape, NOT_ELEVATED, np.float32)
        if (window := _window(elevated)) is None:
            kept.window = kept.position = None
        else:
            part = elevated[window]
            logits = self._position_logits(kept, window, part, changed[window])
            affordance[window][part] = logits.numpy()[: part.shape[0], : part.shape[1]][part]
        closer = {} if earlier is None else earlier.closer
        return AffordanceView(height, affordance, kept.features.numpy(), closer, kept)

    def _look_from_above(self, seen: Observation, rays: Rays, earlier: DrawnLook | None) -> AffordanceView:
        """The networks see the picture as from above; each pixel has the affordance of the place that it shows."""
        plan = PlanView(rays, seen) if earlier is None else earlier.plan
        drawn, cells = plan.of(seen)
        view = self.look(drawn, plan.above, None if earlier is None else earlier.view)
        height = np.nan_to_num(rays.heights(seen.depth), nan=LOWEST).astype(np.float32)
        affordance = np.where(
            height > ELEVATED, view.affordance[cells[..., 1], cells[..., 0]], np.float32(NOT_ELEVATED)
        )
        return AffordanceView(height, affordance, view.features, drawn=DrawnLook(plan, view, cells))

    def _features(
        self, seen: Observation, rays: Rays, kept: KeptLook | None
    ) -> tuple[KeptLook, np.ndarray, np.ndarray]:
        """What is known of the board with what the networks see now; heights (H, W); and where that may be otherwise
        than before, uint8 (H, W)."""
        camera, changed = self._pinhole(rays), np.ones(seen.depth.shape, np.uint8)
        if self.info.inputs == "rgb":
            features, height = colour_features(seen.rgb), heights_of(picture_features(seen.depth, camera)).numpy()
            if kept is None:
                return KeptLook(seen.depth, features), height, changed
            changed = (features.numpy() != kept.features.numpy()).any(axis=0).view(np.uint8)
            kept.depth, kept.features = seen.depth, features
            return kept, height, changed
        if kept is None:
            kept = KeptLook(seen.depth, picture_features(seen.depth, camera))
        else:
            changed = update_features(kept.features, kept.depth, seen.depth, camera)
            kept.depth = seen.depth
        return kept, np.asarray(kept.features.numpy()[0] / np.float32(HEIGHT_GAIN)), changed

    def _position_logits(
        self, kept: KeptLook, window: tuple[slice, slice], elevated: np.ndarray, changed: np.ndarray
    ) -> Tensor:
        """Logits of a part of the picture where it is elevated, (H, W); whole squares of `POSITION_STRIDE`."""
        part = _pad_to_stride(kept.features[:, *window])
        position = kept.position
        if self.on.type != "cpu" or not isinstance(self.networks["position"], PositionNet):
            return self._run("position", part[None])[0]
        rows, columns = part.shape[1:]
        if position is None or kept.window is None:
            position = IncrementalPositionNet(self._fold("position", FoldedPositionNet), (rows, columns))
        elif kept.window != window:
            first = (window[0].start - kept.window[0].start, window[1].start - kept.window[1].start)
            position = position.moved(first, (rows, columns))
        kept.window, kept.position = window, position
        missing = [(0, rows - len(elevated)), (0, columns - elevated.shape[1])]
        wanted, changed = np.pad(elevated.view(np.uint8), missing), np.pad(changed, missing, mode="edge")
        with torch.inference_mode():
            return position(part, wanted, changed).float()

    def directions(self, view: AffordanceView, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A closer look at pixels, int (K, 2), u and v.

        Returns:
            the logit that acting there works, float32 (K,), and the probability that each direction works there if any
            does, float32 (K, 18).
        """
        if not len(pixels):
            return np.empty(0, np.float32), np.empty((0, 18), np.float32)
        if view.drawn is not None:
            return self.directions(view.drawn.view, view.drawn.cells[pixels[:, 1], pixels[:, 0]])
        places = [(int(u), int(v)) for u, v in pixels]
        crops = {place: crop_around(view.features, place) for place in places}
        looks = {place: known for place in places
                 if (known := view.closer.get(place)) and np.array_equal(known.crop, crops[place])}  # fmt: skip
        if fresh := [place for place in crops if place not in looks]:
            stacked = np.stack([crops[place] for place in fresh])
            logits, position = self._run("direction", torch.from_numpy(stacked))
            answers = zip(stacked, position.numpy(), torch.sigmoid(logits).numpy(), strict=True)
            looks |= {place: CropFeatures(*answer) for place, answer in zip(fresh, answers, strict=True)}
        view.closer.clear()
        view.closer.update(looks)
        closer = [looks[place] for place in places]
        return np.array([one.position for one in closer]), np.stack([one.directions for one in closer])

    @property
    def _number_type(self) -> torch.dtype:
        """What networks are given; on a CPU the usual ones consist of it."""
        return torch.bfloat16 if self.bfloat16 else torch.float32

    def _fold(self, kind: Kind, fold: Callable[[Any, torch.dtype], Any]) -> Any:
        """A network as it is run, for numbers of the usual type."""
        wanted = kind, self._number_type
        if wanted not in self._folded:
            with torch.inference_mode():
                self._folded[wanted] = fold(self.networks[kind], self._number_type)
        return self._folded[wanted]

    def _run(self, kind: Kind, features: Tensor) -> Any:
        """The outputs of a network in float32, on the CPU."""
        on_device = features.to(self.on, self._number_type).contiguous(memory_format=torch.channels_last)
        network: Any = self.networks[kind]
        if isinstance(network, DirectionNet):
            network, cast = self._fold(kind, FoldedDirectionNet), False
        else:
            cast = self.bfloat16
        with torch.inference_mode(), torch.autocast(self.on.type, torch.bfloat16, enabled=cast):
            outputs = network(on_device)
        return tuple(part.float().cpu() for part in outputs) if isinstance(outputs, tuple) else outputs.float().cpu()

    def _pinhole(self, rays: Rays) -> Pinhole:
        if self._camera is None or self._camera[0] is not rays:
            self._camera = (rays, Pinhole(rays.camera))
        return self._camera[1]


def weights_file(folder: Path, kind: Kind) -> Path:
    """Where a model's folder has the weights of a network."""
    return folder / f"{kind}.safetensors"


def crop_around(features: np.ndarray, pixel: Sequence[int]) -> np.ndarray:
    """What the direction network looks at: of (C, H, W), around a pixel (u, v), the crop (C, CROP, CROP)."""
    return np.asarray(features[:, *square_around(pixel, CROP, *features.shape[1:])])


def _window(elevated: np.ndarray) -> tuple[slice, slice] | None:
    """Rows and columns within `MARGIN` of something elevated, of sides that the position network needs if possible."""
    left, top, width, height = cv2.boundingRect(elevated.view(np.uint8))
    if not width:
        return None
    sides = []
    for size, start, count in zip(elevated.shape, (top, left), (height, width), strict=True):
        first = max(0, start - MARGIN) // POSITION_STRIDE * POSITION_STRIDE
        last = start + count + MARGIN
        sides.append(slice(first, min(size, -(-last // POSITION_STRIDE) * POSITION_STRIDE)))
    return sides[0], sides[1]


def _pad_to_stride(features: Tensor) -> Tensor:
    """Repeat the last row and column until both sides are multiples of what the position network needs."""
    height, width = features.shape[-2:]
    missing = (0, -width % POSITION_STRIDE, 0, -height % POSITION_STRIDE)
    return functional.pad(features[None], missing, mode="replicate")[0] if any(missing) else features
