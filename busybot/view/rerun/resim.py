"""Rerun, the recorded steps put back into the simulator: its picture, and where that differs from the recorded one."""

import numpy as np
import rerun as rr

from busybot.episodes.codec import encode_plain, encode_rgb
from busybot.episodes.episode import Episode
from busybot.episodes.episode_diff import COLOUR_TOLERANCE

SIMULATOR = "simulator"
MARK = (140, 30, 240)
"""Of pixels that differ, in the order of OpenCV."""


def log_replayed(recording: rr.RecordingStream, episode: Episode, step: int, picture: np.ndarray) -> None:
    """One step; the recording's clock is the caller's. `picture` is uint8 (H, W, 3)."""
    encoded = rr.EncodedImage(contents=encode_rgb(picture, "jpeg"), media_type="image/jpeg", draw_order=-10)
    recording.log(f"{SIMULATOR}/picture", encoded)
    layer = encode_plain(difference_layer(episode.image(step).rgb, picture))
    recording.log(f"{SIMULATOR}/differences", rr.EncodedImage(contents=layer, media_type="image/png", draw_order=0))


def difference_layer(recorded: np.ndarray, picture: np.ndarray) -> np.ndarray:
    """Pixels that differ by more than 2/255 in a channel, coloured; uint8 (H, W, 4) in the order of OpenCV."""
    apart = np.abs(recorded.astype(int) - picture).max(axis=-1) > COLOUR_TOLERANCE
    return np.where(apart[..., None], np.array([*MARK, 255], np.uint8), np.uint8(0))
