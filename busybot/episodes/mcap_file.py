"""One episode, one MCAP file: written whole or not at all, read without trust. `mcap_topics` lists its channels."""

from pathlib import Path

from busybot.episodes.check import check_episode
from busybot.episodes.codec import ImageFormat
from busybot.episodes.episode import Episode
from busybot.episodes.mcap_reader import Decoding, read_episode
from busybot.episodes.mcap_writer import episode_to_mcap
from busybot.files import write_atomically

__all__ = ["Decoding", "ImageFormat", "read_episode", "write_episode"]


def write_episode(path: Path, episode: Episode, images: ImageFormat = "jpeg", root: Path | None = None) -> int:
    """Write the file under a temporary name, sync, rename.

    Args:
        images: how RGB is encoded; depth (to 4e-5 units) and segmentation are lossless in either case.
        root: the dataset's folder; see `files`.

    Returns:
        The size of the file in bytes.

    Raises:
        BusybotError: naming the file and the contradiction, if the episode is not consistent.
    """
    check_episode(episode, str(path))
    data = episode_to_mcap(episode, images, str(path))
    write_atomically(path, data, root)
    return len(data)
