"""Downloading PartNet-Mobility objects with the user's own token, through SAPIEN's downloader.

That downloader prints and raises addresses with the token in them, unpacks whatever archive comes, and has no time
limit. So it runs in a process of its own (`python -m busybot.sim.partnet_download ID FOLDER`) that gets the token in
its environment, whose output is thrown away, and which reports nothing but the kind of fault; while it unpacks, into a
folder of quarantine, its files' sizes are bounded and the folder is watched. What it left there is inspected as any
object is (no links, sane sizes, a URDF that stays in its folder) and only then moved to its place.
"""

import contextlib
import errno
import os
import re
import resource
import subprocess
import sys
import time
import zipfile
import zlib
from pathlib import Path

from busybot.common.atomic_io import make_folder, remove_abandoned, rename, unfinished
from busybot.common.errors import BusybotError
from busybot.common.process_pool import end_with
from busybot.objects.importing.raw import read_raw
from busybot.objects.partnet.folder_snapshot import MAX_BYTES, MAX_FILES

TOKEN_VARIABLE = "SAPIEN_ACCESS_TOKEN"
TIME_LIMIT_S = 600.0
MAX_MEMORY = 4 << 30
"""Address space of the download's process, bytes: SAPIEN's libraries reserve much of it."""
ROOT = Path(__file__).resolve().parents[2]
_WORK = "fetch"
_ID = re.compile(r"[0-9]{1,9}")
_OFFLINE, _REFUSED, _ARCHIVE, _ROOM, _OTHER = range(64, 69)
_FAULTS = {
    _OFFLINE: ("the server cannot be reached", "check the network connection"),
    _REFUSED: (
        "the server refused",
        "check that the token is valid (tokens expire) and that PartNet-Mobility has an object with this id",
    ),
    _ARCHIVE: ("what came is not an archive that can be unpacked", "try again later"),
    _ROOM: ("what came is larger than an object may be, or the disk is full", "make room, or leave this object out"),
    _OTHER: ("SAPIEN's downloader failed", "try again; `busybot doctor` says whether SAPIEN works here"),
}


def fetch(instance: str, out: Path, token: str, time_limit_s: float = TIME_LIMIT_S) -> bool:
    """Download one object into `out / instance`.

    Args:
        instance: the object's id, digits.
        token: the user's; it is passed on in the environment of the download's process and goes nowhere else.

    Returns:
        False when the folder is there already.

    Raises:
        BusybotError: the id or the download is at fault, or what came is not a sound raw object. The token is in no
            message.
    """
    if not _ID.fullmatch(instance):
        raise BusybotError(f"{instance[:40]!r} is not an id of PartNet-Mobility", "ids are numbers, for example 100366")
    remove_abandoned(out, _WORK)
    place = out / instance
    if place.is_symlink() or place.exists():
        read_raw(place)
        return False
    make_folder(out)
    with unfinished(out, _WORK) as quarantine:
        fault = _download(instance, quarantine, token, time_limit_s)
        if fault is not None:
            what, hint = _FAULTS[fault]
            raise BusybotError(f"object {instance}: {what}", hint)
        came = quarantine / instance
        if came.is_symlink() or not came.is_dir():
            raise BusybotError(f"object {instance}: the archive has no folder {instance}", "try again later")
        try:
            read_raw(came)
        except BusybotError as error:
            what = error.what.replace(str(came), str(place))
            raise BusybotError(f"object {instance} came, but is refused: {what}", "leave this object out") from None
        rename(came, place)
    return True


def _download(instance: str, folder: Path, token: str, time_limit_s: float) -> int | None:
    """Run the downloader in its own process; the kind of fault, None when there is none."""
    path = os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), str(ROOT)]))
    process = subprocess.Popen(
        [sys.executable, "-m", "busybot.sim.partnet_download", instance, str(folder), str(os.getpid())],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        # one thread: a pool's stacks would count against the limit of memory
        env=os.environ | {TOKEN_VARIABLE: token, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
    )
    deadline = time.monotonic() + time_limit_s
    try:
        while process.poll() is None:
            if time.monotonic() > deadline:
                return _OFFLINE
            if not _sane(folder):
                return _ROOM
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(0.1)
    finally:
        process.kill()
        process.wait()
    if process.returncode == 0:
        return None
    return process.returncode if process.returncode in _FAULTS else _OTHER


def _sane(folder: Path) -> bool:
    """Whether what has been unpacked so far could be one object."""
    count = size = 0
    for place, _, names in os.walk(folder):
        for name in names:
            count += 1
            with contextlib.suppress(FileNotFoundError):
                size += os.lstat(os.path.join(place, name)).st_size
        if count > MAX_FILES or size > MAX_BYTES:
            return False
    return True


def _main(instance: str, folder: str, parent: int) -> int:
    """In the download's process: SAPIEN's downloader, its faults reduced to a number."""
    end_with(parent)
    resource.setrlimit(resource.RLIMIT_FSIZE, (MAX_BYTES, MAX_BYTES))
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        from sapien.asset import download_partnet_mobility
    except Exception:  # whatever a broken installation raises
        return _OTHER
    try:
        download_partnet_mobility(instance, token=os.environ[TOKEN_VARIABLE], directory=folder)
    except Exception as error:  # its message may hold the token: only the kind is passed on
        return _kind(error)
    return 0


def _kind(error: Exception) -> int:
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno in (errno.EFBIG, errno.ENOSPC)):
        return _ROOM
    if isinstance(error, zipfile.BadZipFile | zlib.error | EOFError | RuntimeError):
        return _ARCHIVE
    requests_fault = "RequestException" in {kind.__name__ for kind in type(error).__mro__}
    if requests_fault or isinstance(error, ConnectionError | TimeoutError):
        return _OFFLINE
    return _REFUSED if str(error).startswith("Download PartNet-Mobility failed") else _OTHER


if __name__ == "__main__":
    os._exit(_main(sys.argv[1], sys.argv[2], int(sys.argv[3])))
