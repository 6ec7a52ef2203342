"""What is wrong with each object of a library: every object is read, however many are bad."""

from dataclasses import dataclass
from pathlib import Path

from busybot.errors import BusybotError
from busybot.objects.annotation import FILE_NAME
from busybot.objects.folder import load_object
from busybot.objects.library import SPLIT_FILE, load_as, object_folders, read_split_file, read_splits


@dataclass(frozen=True)
class Finding:
    """The verdict on one object, or on the library's split file: `problem` is None when nothing is wrong."""

    name: str
    problem: str | None = None
    mend: str | None = None

    @property
    def ok(self) -> bool:
        return self.problem is None


def check_objects(path: Path) -> list[Finding]:
    """Read a library, or a single object's folder, object by object.

    Raises:
        BusybotError: `path` is neither.
    """
    if (path / FILE_NAME).exists() or (path / "mobility.urdf").exists():
        return [_verdict(path.name, None, path)]
    folders = object_folders(path)
    findings = [_verdict(key, key, folder) for key, folder in folders.items()]
    try:
        read_splits(path, folders)
        listed = set(read_split_file(path / SPLIT_FILE)) if (path / SPLIT_FILE).exists() else set()
    except BusybotError as error:
        return [*findings, Finding(SPLIT_FILE, error.what, error.mend)]
    findings += [
        Finding(key, f"{path / SPLIT_FILE}: lists it, but there is no such folder", "add the folder or drop the id")
        for key in sorted(listed - set(folders))
    ]
    return findings


def _verdict(name: str, key: str | None, folder: Path) -> Finding:
    try:
        if key is None:
            load_object(folder)
        else:
            load_as(key, folder)
    except BusybotError as error:
        return Finding(name, error.what, error.mend)
    return Finding(name)
