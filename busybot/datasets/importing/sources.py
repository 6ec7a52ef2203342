"""What `busybot dataset import` reads, told by what lies at the source."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os.path import lexists
from pathlib import Path

from busybot.common.errors import BusybotError, UsageError
from busybot.common.process_pool import Progress
from busybot.datasets.dataset import Dataset
from busybot.datasets.importing.camera_folder import ImportOptions, camera_folders, read_camera_folder, refuse_idle
from busybot.datasets.importing.exported import RecordingFolder, exported_recordings
from busybot.datasets.importing.images import check_export, describe_export, import_export
from busybot.datasets.importing.lerobot import INFO_FILE, read_lerobot
from busybot.datasets.importing.recording import Recording, check_recordings, store_recordings
from busybot.datasets.importing.thor import event_folders, read_events

CAMERA, IMAGES, PARQUET, LEROBOT, THOR = "camera", "images", "parquet", "lerobot", "ai2thor"


@dataclass(frozen=True)
class Imported:
    """What was read.

    Attributes:
        kind: of the source.
        recordings: what was read of each, JSON values.
        dataset: None of a dry run.
    """

    kind: str
    recordings: list[dict[str, object]]
    dataset: Dataset | None


def import_source(
    source: Path, out: Path | None, options: ImportOptions | None = None, progress: Progress | None = None
) -> Imported:
    """Make a dataset of recordings of others; it is there whole or not at all.

    Args:
        out: None to read and check everything, and write nothing.

    Raises:
        BusybotError: naming file and line, if something is missing, contradicts itself, or may mean several things.
    """
    options = options or ImportOptions()
    if not source.exists():
        raise BusybotError(f"{source}: there is no such file or folder", "name what is to be imported")
    if source.is_dir() and (exported := exported_recordings(source)):
        if options != ImportOptions():
            what = f"{source} tells all of it itself: options besides --out and --dry-run are for other sources"
            raise UsageError(what, "leave them out")
        kind = IMAGES if isinstance(exported[0], RecordingFolder) else PARQUET
        told = [describe_export(recording) for recording in exported]
        if out is None:
            check_export(exported, progress)
            return Imported(kind, told, None)
        return Imported(kind, told, import_export(source, out, progress, exported))
    kind, recordings = _read(source, options)
    summaries = [one.summary() for one in recordings]
    if out is None:
        check_recordings(kind, recordings, progress)
        return Imported(kind, summaries, None)
    return Imported(kind, summaries, store_recordings(kind, recordings, out, progress))


def _read(source: Path, options: ImportOptions) -> tuple[str, Sequence[Recording]]:
    if lexists(source / INFO_FILE):
        recordings = read_lerobot(source, options)
        refuse_idle(source, [] if options.tables is None else camera_folders(options.tables), options)
        return LEROBOT, _proposed(recordings, options)
    if events := event_folders(source):
        return THOR, [read_events(folder, options) for folder in events]
    folders = camera_folders(source)
    if not folders:
        what = f"{source}: it is nothing that can be imported"
        hint = "a folder with actions.csv (docs/guides/own-recordings.md), or one of `dataset export --to images` "
        raise BusybotError(what, f"{hint}with episodes/000000, or to parquet with data/frames")
    if options.tables is not None:
        raise UsageError(f"{source}: a camera's folder has its tables in it", "--tables is for LeRobot's datasets")
    refuse_idle(source, folders, options)
    return CAMERA, _proposed([read_camera_folder(folder, options) for folder in folders], options)


def _proposed(recordings: Sequence[Recording], options: ImportOptions) -> Sequence[Recording]:
    """The same with proposed objects where they were asked for and none are told."""
    if not options.proposed:
        return recordings
    from busybot.datasets.importing.proposals import propose_objects

    return [one if one.objects else replace(one, objects=propose_objects(one)) for one in recordings]
