"""The formats that recordings are exported to, by the name that the command line knows them by."""

from pathlib import Path

from busybot.common.process_pool import Progress
from busybot.datasets.dataset import Dataset
from busybot.datasets.exporting import croissant, hugging_face, images, lerobot
from busybot.datasets.exporting.folder import Exported, Target, export_folder

TARGETS = {
    "lerobot": Target("lerobot", lerobot.write_episode, lerobot.finish, lerobot.check),
    "hf": Target("hf", hugging_face.write_episode, hugging_face.finish_with_card),
    "parquet": Target("parquet", hugging_face.write_episode, hugging_face.finish),
    "croissant": Target("croissant", hugging_face.write_episode, croissant.finish),
    "images": Target("images", images.write_episode, images.finish),
}


def export_recordings(
    dataset: Dataset,
    to: str,
    out: Path,
    privileged: bool = False,
    workers: int = 1,
    progress: Progress | None = None,
) -> Exported:
    """Export all recordings to one of `TARGETS`; a call that was cut is repeated and goes on where it was.

    Args:
        privileged: also what only the simulator knows, under names that begin with `privileged`, and `segmentation`.

    Raises:
        BusybotError: see `export_folder`; or the format cannot hold the dataset.
    """
    return export_folder(dataset, out, TARGETS[to], privileged, workers, progress)
