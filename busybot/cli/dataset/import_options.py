"""Options of `dataset import` about times, which say nothing where there are none."""

from os.path import lexists
from pathlib import Path
from typing import TYPE_CHECKING

from busybot.common.errors import UsageError

if TYPE_CHECKING:
    from busybot.datasets.importing.camera_folder import ImportOptions


def refuse_idle(source: Path, options: "ImportOptions") -> None:
    """Refuse a rate without a video that it is for, and a shift without times of actions.

    Raises:
        UsageError: an option would change nothing.
    """
    from busybot.datasets.importing.camera_folder import camera_folders

    place = options.tables or source
    if not place.is_dir():
        return  # told where it is read
    folders = camera_folders(place)
    if options.fps is not None and not any(map(_has_bare_video, folders)):
        raise UsageError(f"{place}: no video without frames.csv lies there", "--fps is for one: leave it out")
    if options.shift and not any(map(_has_times, folders)):
        what = f"{place}: no actions.csv there tells times"
        raise UsageError(what, "--shift is for a column time: leave it out, or add the column")


def _has_bare_video(folder: Path) -> bool:
    from busybot.datasets.importing.camera_pictures import FRAMES_FILE, VIDEOS

    return not lexists(folder / FRAMES_FILE) and any(file.suffix.lower() in VIDEOS for file in folder.iterdir())


def _has_times(folder: Path) -> bool:
    from busybot.common.atomic_io import inside
    from busybot.datasets.importing.camera_folder import ACTIONS_FILE, HINT
    from busybot.datasets.importing.csv_tables import Row, Text, read_table

    class When(Row):
        time: Text = None

    return any(row.time is not None for row in read_table(inside(folder, ACTIONS_FILE), When, HINT))
