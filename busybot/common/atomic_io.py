"""All that busybot writes: files that are whole or absent, inside the folder that was meant. And paths that stay there.

A dataset, a training or a report may come from a stranger, with symbolic links planted where something will be written.
So this is the only module that opens files for writing, makes folders, renames and removes (a test looks for others).

Every function takes the file's path and `root`, the folder that the user named: links on the way to it are the user's
own and are followed. Below it each folder is opened relative to the one before, and none may be a link; missing ones
are made. Without `root`, the user named the file itself: the root is the folder that it lies in. Files are new ones
under names that cannot be guessed, renamed within the folder that was opened: a link at the final name is replaced, not
followed. A file that is continued (`append_line`, the lock) must be a regular one without a second name.
"""

import contextlib
import errno
import fcntl
import hashlib
import json
import math
import mmap
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import Any, BinaryIO, cast

from busybot.common.errors import BusybotError
from busybot.common.limits import MAX_HASHED_BYTES, MAX_JSON_BYTES
from busybot.common.remote import is_remote

LOCK_FILE = ".lock"
RESTORE = "restore it from a copy, or make it again with the command that wrote it"
_FOLDER = os.O_PATH | os.O_DIRECTORY
_NEW = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
_TEMPORARY_NAME = re.compile(r"^\..*\.(\d+)(-[0-9a-f]{16})?\.tmp$")
"""`.NAME.PROCESS-RANDOM.tmp`; earlier versions had no random part."""


def write_atomically(path: Path, data: bytes, root: Path | None = None) -> None:
    """Write under a temporary name, sync, rename: a file with its final name is whole."""
    with _naming(path), replacing(path, root) as file:
        file.write(data)


def write_json(path: Path, value: Any, root: Path | None = None) -> None:
    """Write JSON with sorted keys and a final newline, atomically."""
    write_atomically(path, (json.dumps(value, indent=2, sort_keys=True, allow_nan=False) + "\n").encode(), root)


@contextmanager
def replacing(path: Path, root: Path | None = None) -> Iterator[BinaryIO]:
    """A file to write into, which gets its final name when the block ends, and is removed when it fails."""
    temporary = f".{path.name}.{os.getpid()}-{os.urandom(8).hex()}.tmp"
    with _opened(path.parent, root) as folder:
        _refuse_device(path, folder)
        try:
            with _naming(path):
                descriptor = os.open(temporary, _NEW, 0o666, dir_fd=folder)
            with open(descriptor, "w+b") as file, naming_writes(path):
                yield file
                file.flush()
                os.fsync(descriptor)
            with _naming(path):
                os.rename(temporary, path.name, src_dir_fd=folder, dst_dir_fd=folder)
        finally:
            with contextlib.suppress(OSError):  # the fault that led here is the one to tell
                os.unlink(temporary, dir_fd=folder)


def _refuse_device(path: Path, folder: int) -> None:
    """Who may do everything would replace `/dev/null`, or a link to it, by a file, for all programs."""
    with contextlib.suppress(OSError):
        mode = os.stat(path.name, dir_fd=folder).st_mode
        if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
            raise BusybotError(f"{path}: a device, where a file belongs", "name a file")


@contextmanager
def replacing_by_path(path: Path, root: Path | None = None) -> Iterator[Path]:
    """The same for a library that wants a path: one in a folder that is new and open to nobody else."""
    make_folder(path.parent, root)
    remove_abandoned(path.parent, path.name)
    with unfinished(path.parent, path.name, root, mode=0o700) as private:
        with naming_writes(path):
            yield private / path.name
        with _opened(private, root, make=False) as folder, _naming(path):
            descriptor = os.open(path.name, os.O_RDONLY | os.O_NOFOLLOW, dir_fd=folder)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        rename(private / path.name, path, root)


def new_file(path: Path, root: Path | None = None) -> BinaryIO:
    """A file that was not there before, open for writing under its own name; for what is made in a new folder."""
    with _opened(path.parent, root) as folder, _naming(path):
        return open(os.open(path.name, _NEW, 0o666, dir_fd=folder), "wb")


def write_new(path: Path, data: bytes, root: Path | None = None) -> None:
    """Write a file that was not there before, without waiting for the disk."""
    with naming_writes(path), new_file(path, root) as file:
        file.write(data)


def copy_file(source: Path, path: Path, root: Path | None = None) -> None:
    """Copy a file's bytes to another place, whole or not at all."""
    with open_regular(source, MAX_HASHED_BYTES) as original, replacing(path, root) as copy:
        shutil.copyfileobj(original, copy)


def append_line(path: Path, line: str, root: Path | None = None) -> None:
    """Add a line to a file, which is made where it is absent."""
    with (
        _opened(path.parent, root) as folder,
        naming_writes(path),
        open(_continued(folder, path, os.O_APPEND), "ab") as file,
    ):
        file.write(f"{line}\n".encode())


def make_folder(path: Path, root: Path | None = None) -> None:
    """Make the folder and those that it lies in, where they are absent.

    Raises:
        BusybotError: one of them, below `root`, is a link or a file.
    """
    with _opened(path, root):
        pass


def rename(source: Path, target: Path, root: Path | None = None) -> None:
    """Rename a file or folder; an empty folder at the new name, or a file, is replaced."""
    with _opened(source.parent, root, make=False) as here, _opened(target.parent, root) as there, _naming(target):
        _refuse_device(target, there)
        os.rename(source.name, target.name, src_dir_fd=here, dst_dir_fd=there)


def remove(path: Path, root: Path | None = None) -> None:
    """Remove a file, a link itself, or a folder with all that is in it; nothing where nothing is."""
    with contextlib.suppress(FileNotFoundError), _opened(path.parent, root, make=False) as folder, _naming(path):
        if stat.S_ISDIR(os.stat(path.name, dir_fd=folder, follow_symlinks=False).st_mode):
            shutil.rmtree(path.name, dir_fd=folder)
        else:
            os.unlink(path.name, dir_fd=folder)


def forbid_writing(path: Path, root: Path) -> None:
    """Take away all permissions to write into a file or folder, which may be the root itself."""
    with _opened(path.parent, None if path == root else root, make=False) as folder, _naming(path):
        links = 0 if path == root else os.O_NOFOLLOW
        descriptor = os.open(path.name or ".", os.O_RDONLY | os.O_NONBLOCK | links, dir_fd=folder)
        try:
            mode = stat.S_IMODE(os.fstat(descriptor).st_mode)
            if mode & 0o222:
                os.fchmod(descriptor, mode & ~0o222)
        finally:
            os.close(descriptor)


@contextmanager
def one_writer(folder: Path) -> Iterator[None]:
    """Hold the lock of a dataset's folder, which ends with the process, however it ends.

    Raises:
        BusybotError: another process holds it.
    """
    with _opened(folder, make=False) as place, open(_continued(place, folder / LOCK_FILE), "wb") as file:
        try:
            with naming_writes(folder / LOCK_FILE):  # there are file systems that know no locks
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            what = f"{folder}: another process is writing into this dataset"
            raise BusybotError(what, "wait until it is done, or end it") from None
        yield


@contextmanager
def in_turn(folder: Path) -> Iterator[None]:
    """Wait until no other process is in such a block of the same folder, which is made where it is absent.

    Its lock is the folder's own and ends with the process; where a file system has no locks, nobody waits.
    """
    with _opened(folder) as place, _naming(folder):
        descriptor = os.open(".", os.O_RDONLY | os.O_DIRECTORY, dir_fd=place)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def remove_leftovers(folder: Path, root: Path | None = None) -> int:
    """Delete temporary files of writers that are no more; returns their number.

    Call it where no other machine writes, as under `one_writer`.
    """
    leftovers = [
        folder / name
        for name in scan(folder).files
        if (match := _TEMPORARY_NAME.match(Path(name).name)) and not _alive(int(match[1]))
    ]
    for file in leftovers:
        remove(file, root or folder)
    return len(leftovers)


def names_in(folder: Path) -> set[str]:
    """Names of what lies in a folder, but of temporary files, which a killed writer may have left."""
    return {entry.name for entry in folder.iterdir() if not _TEMPORARY_NAME.match(entry.name)}


@contextmanager
def unfinished(parent: Path, name: str, root: Path | None = None, mode: int = 0o777) -> Iterator[Path]:
    """A new folder `parent/.NAME-....tmp`, locked while this process lives. It may be renamed away.

    What is left of it at the end is removed. What a killed process left is told from what another one is working on by
    the lock, and removed when the same work begins again; where a file system has no locks, nothing is removed.

    Args:
        parent: an existing folder.
        name: of the kind of work; `remove_abandoned` gets the same.
    """
    with _opened(parent, root, make=False) as place:
        lock = None
        while lock is None:  # else another process took it for abandoned, in the moment between the two calls
            folder = f".{name}-{os.urandom(8).hex()}.tmp"
            with _naming(parent / folder):
                os.mkdir(folder, mode, dir_fd=place)
            lock = _lock(place, folder)
        try:
            yield parent / folder
        finally:
            shutil.rmtree(folder, ignore_errors=True, dir_fd=place)
            os.close(lock)


def remove_abandoned(parent: Path, name: str, rescue: Callable[[Path], object] | None = None) -> None:
    """Remove such folders of processes that are no more.

    Args:
        rescue: called with each folder before it is removed.
    """
    ours = re.compile(rf"\.{re.escape(name)}-[0-9a-f]{{8}}([0-9a-f]{{8}})?\.tmp")
    if not parent.is_dir():
        return
    with _opened(parent, make=False) as place:
        for folder in sorted(entry for entry in os.listdir(parent) if ours.fullmatch(entry)):
            lock = _lock(place, folder, when_unknown=False)
            if lock is None:
                continue
            try:
                if rescue is not None:
                    rescue(parent / folder)
                shutil.rmtree(folder, ignore_errors=True, dir_fd=place)
            finally:
                os.close(lock)


def refuse_taken(place: Path) -> None:
    """Only what is absent, or an empty folder, can become something new by renaming.

    Raises:
        BusybotError: something is there.
    """
    if place.is_symlink() or (place.exists() and (not place.is_dir() or any(place.iterdir()))):
        raise BusybotError(f"{place}: it exists and is not an empty folder", "name another folder, or remove it")
    if place.is_dir() and (place.is_mount() or place.samefile(os.curdir)):  # it could not be replaced, or be found
        raise BusybotError(f"{place}: it is the current folder or a mounted one", "name a new folder in it")


@contextmanager
def _opened(folder: Path, root: Path | None = None, make: bool = True) -> Iterator[int]:
    """Descriptor of a folder, reached from `root` without following a link; see the module's beginning."""
    place = folder if root is None else root
    steps = folder.relative_to(place).parts
    if ".." in steps:
        raise BusybotError(f"{folder}: it leaves {place}", "name a folder without `..`")
    with _naming(place):
        try:
            descriptor = os.open(place, _FOLDER)
        except FileNotFoundError:
            if not make:
                raise
            os.makedirs(place, exist_ok=True)
            descriptor = os.open(place, _FOLDER)
    try:
        for step in steps:
            place = place / step
            outer = descriptor
            descriptor = _entered(outer, step, place, make)
            os.close(outer)
        yield descriptor
    finally:
        os.close(descriptor)


def _entered(folder: int, name: str, place: Path, make: bool) -> int:
    try:
        with _naming(place):
            return os.open(name, _FOLDER | os.O_NOFOLLOW, dir_fd=folder)
    except NotADirectoryError:
        what = f"{place}: a link or a file where a folder is needed; nothing is written through links"
        raise BusybotError(what, "remove it, or put a folder in its place") from None
    except FileNotFoundError:
        if not make:
            raise
    with _naming(place), contextlib.suppress(FileExistsError):  # somebody was faster
        os.mkdir(name, dir_fd=folder)
    return _entered(folder, name, place, make=False)


def _continued(folder: int, path: Path, flags: int = 0) -> int:
    """Descriptor of a file that may be there already: a regular one, and to append to, without a second name."""
    flags |= os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        with _naming(path):
            descriptor = os.open(path.name, flags, 0o666, dir_fd=folder)
    except OSError as error:
        if error.errno not in (errno.ELOOP, errno.ENXIO):  # a link, a pipe that nobody reads
            raise
    else:
        facts = os.fstat(descriptor)
        if stat.S_ISREG(facts.st_mode) and (facts.st_nlink == 1 or not flags & os.O_APPEND):
            return descriptor
        os.close(descriptor)
    what = f"{path}: a link, no regular file, or one with a second name; nothing is written into it"
    raise BusybotError(what, "remove it, or put a copy of the file in its place")


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Faults of the file system tell the whole path, not the name in a folder that was opened."""
    try:
        yield
    except IsADirectoryError:
        raise BusybotError(f"{path}: a folder, where a file belongs", "remove it") from None
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


@contextmanager
def naming_writes(path: Path) -> Iterator[None]:
    """Name the file in what goes wrong while it is written, as on a full disk: the system tells no path then."""
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from None


def _lock(parent: int, folder: str, when_unknown: bool = True) -> int | None:
    """Descriptor that holds the folder's lock; None when another process has it or the folder is gone.

    Args:
        when_unknown: whether a folder that cannot be locked at all counts as locked by this process.
    """
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=parent)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        locked = os.path.samestat(os.fstat(descriptor), os.stat(folder, dir_fd=parent, follow_symlinks=False))
    except (BlockingIOError, FileNotFoundError):
        locked = False
    except OSError:
        locked = when_unknown
    if locked:
        return descriptor
    os.close(descriptor)
    return None


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        pass
    return True


def open_regular(path: Path, max_bytes: int, hint: str = RESTORE) -> BufferedReader:
    """Open a file to read that may be anything: only a regular one of at most `max_bytes` is opened.

    Raises:
        BusybotError: naming the file and what it is instead.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe that nobody writes into would keep us waiting
    except FileNotFoundError:
        raise BusybotError(f"{path}: there is no such file", hint) from None
    except OSError as error:
        raise BusybotError(f"{path}: cannot be read: {error.strerror}", hint) from None
    except ValueError:  # a NUL, or what no file system takes
        raise BusybotError(f"{str(path)!r}: no file can have this name", hint) from None
    facts = os.fstat(descriptor)
    if stat.S_ISREG(facts.st_mode) and facts.st_size <= max_bytes:
        return open(descriptor, "rb")
    os.close(descriptor)
    if not stat.S_ISREG(facts.st_mode):
        raise BusybotError(f"{path}: not a regular file", hint)
    raise _too_large(path, facts.st_size, max_bytes, hint)


def _too_large(path: object, size: int, max_bytes: int, hint: str) -> BusybotError:
    return BusybotError(f"{path}: {size} bytes are more than the {max_bytes} that such a file may have", hint)


def memory_on_disk(size: int) -> mmap.mmap:
    """So many bytes in a temporary file without a name, which the system takes out of memory when that is needed."""
    with tempfile.TemporaryFile() as file:  # is there as long as it is mapped
        os.posix_fallocate(file.fileno(), 0, size)  # a full disk is told here, and not by the death of who writes later
        return mmap.mmap(file.fileno(), size)


def read_regular(path: Path, max_bytes: int, hint: str = RESTORE) -> bytes:
    """The bytes of such a file, which may lie at an address."""
    if is_remote(path):
        if (size := path.size()) > max_bytes:
            raise _too_large(path, size, max_bytes, hint)
        return path.read(0, size)
    with open_regular(path, max_bytes, hint) as file:
        try:
            return file.read(os.fstat(file.fileno()).st_size)  # the kernel's own say that they are empty, and never end
        except OSError as error:
            raise BusybotError(f"{path}: cannot be read: {error.strerror}", hint) from None


def read_text(path: Path, max_bytes: int, hint: str = RESTORE) -> str:
    """The text of such a file, in UTF-8."""
    try:
        return read_regular(path, max_bytes, hint).decode()
    except UnicodeDecodeError as error:
        raise BusybotError(f"{path}: cannot be read as text: {error}", hint) from None


def read_json(path: Path, max_bytes: int = MAX_JSON_BYTES) -> Any:
    """Read JSON from such a file; errors name the file and the line."""
    text = read_text(path, max_bytes)
    try:
        return parse_json(text)
    except (ValueError, RecursionError) as error:  # of JSON, and of numbers with thousands of digits
        raise BusybotError(f"{path}: not valid JSON: {error}", RESTORE) from None


def parse_json(text: str | bytes) -> Any:
    """The value of a JSON text, in UTF-8; NaN, infinities and lone surrogates, which Python would take, are none.

    Raises:
        ValueError: it is not valid.
    """
    text = text.decode() if isinstance(text, bytes) else text  # Python would guess encodings, and take surrogates
    value = json.loads(text, parse_constant=_refuse_constant, parse_float=_finite)
    # an escape is the only way in for a half of a pair, since the text itself is UTF-8
    if any(half in text for half in ("\\ud", "\\uD")):
        try:
            json.dumps(value, ensure_ascii=False).encode()
        except UnicodeEncodeError:
            raise ValueError("half of a surrogate pair in a string") from None
    return value


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON")


def _finite(digits: str) -> float:
    number = float(digits)
    if math.isinf(number):
        raise ValueError(f"{digits[:40]} is too large")
    return number


MAX_NAME_BYTES = 255
"""Of a file's name, as systems have it."""


def inside(folder: Path, relative: str) -> Path:
    """`folder / relative`, refused when it is absolute, climbs out, leaves the folder by a link, or is too long."""
    if is_remote(folder):
        return cast(Path, folder / relative)  # which refuses the same
    candidate = folder / relative
    try:
        stays = not Path(relative).is_absolute() and candidate.resolve().is_relative_to(folder.resolve())
        stays &= all(len(os.fsencode(part)) <= MAX_NAME_BYTES for part in candidate.parts)
    except (OSError, RuntimeError, ValueError):  # a link to itself, a NUL
        stays = False
    if not stays:
        raise BusybotError(f"{folder}: the path {relative!r} leaves the folder", "remove it or copy the file inside")
    return candidate


def sha256_of(path: Path) -> str:
    """SHA-256 over a file's bytes, hexadecimal."""
    with open_regular(path, MAX_HASHED_BYTES) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass
class Scan:
    """What lies under a folder, by path relative to it with "/" between parts, in sorted order.

    Attributes:
        files: size in bytes of every regular file.
        others: links, devices, sockets: what is neither a regular file nor a folder.
    """

    files: dict[str, int] = field(default_factory=dict)
    others: list[str] = field(default_factory=list)


HINT_COPY_IN = "put a copy of what it leads to in its place, or remove it"


def scan(folder: Path) -> Scan:
    """Look through the folder and all folders in it; no link is followed."""
    found = Scan()
    waiting = [""]
    while waiting:
        place = waiting.pop()
        with os.scandir(folder / place) as entries:
            for entry in entries:
                name = f"{place}{entry.name}"
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(f"{name}/")
                elif stat.S_ISREG((facts := entry.stat(follow_symlinks=False)).st_mode):
                    found.files[name] = facts.st_size
                else:
                    found.others.append(name)
    return Scan(dict(sorted(found.files.items())), sorted(found.others))


def folders_with(folder: Path, name: str = "") -> list[Path]:
    """The folders in the folder that have an entry of this name, or all; none if it is no folder.

    Raises:
        BusybotError: beside them lies a link, or something that is neither file nor folder.
    """
    if not folder.is_dir():
        return []
    entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    found = [Path(entry.path) for entry in entries if os.path.lexists(os.path.join(entry.path, name))]
    for entry in entries if found else ():
        if entry.is_symlink() or not (entry.is_dir() or entry.is_file()):
            raise BusybotError(f"{entry.path}: a link, or neither a file nor a folder", HINT_COPY_IN)
    return [path for path in found if path.is_dir()]


def regular_files(folder: Path, wanted: Callable[[str], bool]) -> list[Path]:
    """The files in the folder and in all folders in it whose names are wanted; no link is followed.

    Raises:
        BusybotError: something else has such a name.
    """
    found = scan(folder)
    for name in found.others:
        if wanted(Path(name).name):
            what = f"{folder / name}: a link, or no regular file"
            raise BusybotError(what, HINT_COPY_IN)
    return [folder / name for name in found.files if wanted(Path(name).name)]
