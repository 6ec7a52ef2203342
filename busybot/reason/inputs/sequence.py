"""One board as arrays for models of relations: features, positions and actions.

Made from `ObservedEpisode` and the features of its pictures, so it holds nothing that a reasoner may not know (protocol
"Who may read what"). Triggers have no features, as in the paper.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from busybot.common.errors import BusybotError

if TYPE_CHECKING:
    from busybot.reason.inputs.observation import ObservedEpisode

CHANNELS = 256
"""Numbers per object and frame (paper section 3.2)."""


@dataclass(frozen=True)
class BoardSequence:
    """A board watched for T steps, N objects.

    Attributes:
        features: float32 (T + 1, N, 256), what each object looks like in each frame; zeros for triggers and for objects
            without a box in the first frame.
        positions: float32 (N, 3), visible centre in the first frame, board frame, board units; 0 where unknown.
        actions: float32 (T, 6), position (board frame, board units) and direction (unit vector).
        acted: int64 (T,), index of the trigger acted on as far as boxes tell (`acted_objects`), -1 for none.
        triggers: bool (N,).
        responders: bool (N,).
    """

    features: np.ndarray
    positions: np.ndarray
    actions: np.ndarray
    acted: np.ndarray
    triggers: np.ndarray
    responders: np.ndarray

    @property
    def steps(self) -> int:
        """T, the number of actions."""
        return len(self.actions)

    @property
    def candidates(self) -> np.ndarray:
        """bool (N, N), True where the row is a trigger and the column a responder."""
        return self.triggers[:, None] & self.responders[None]

    def first(self, images: int) -> "BoardSequence":
        """The same board watched for at most `images` frames (so many minus one actions)."""
        steps = max(0, images - 1)
        return BoardSequence(
            self.features[: steps + 1],
            self.positions,
            self.actions[:steps],
            self.acted[:steps],
            self.triggers,
            self.responders,
        )


def sequence_of(observed: "ObservedEpisode", features: np.ndarray) -> BoardSequence:
    """Put features beside what else a reasoner may read.

    Args:
        features: (T + 1, N, 256) of the frames of `observed`, any floating type; those of triggers and of objects
            without a box are replaced by zeros.

    Raises:
        BusybotError: the features are not those of so many frames and objects.
    """
    from busybot.reason.inputs.observation import (
        acted_objects,  # decodes pictures; models that read sequences do without
    )

    roles = np.array(observed.roles, str)
    expected = (len(observed.image_of), len(roles), CHANNELS)
    if features.shape != expected:
        raise BusybotError(f"features of shape {features.shape} where the episode has {expected}", "compute them again")
    left, top, right, bottom = np.asarray(observed.boxes).reshape(-1, 4).T
    seen = (left >= 0) & (top >= 0) & (right > left) & (bottom > top) & (roles == "responder")
    actions = [(*action.position, *action.direction) for action in observed.actions]
    return BoardSequence(
        features=np.where(seen[None, :, None], features, 0).astype(np.float32),
        positions=np.nan_to_num(observed.positions, nan=0.0).astype(np.float32),
        actions=np.array(actions, np.float32).reshape(-1, 6),
        acted=acted_objects(observed).astype(np.int64),
        triggers=roles == "trigger",
        responders=roles == "responder",
    )
