"""A program that reads an HDF5 file or a video for `containers`, by lines of JSON: it may hang, or die.

The HDF5 library finds no end in some damaged files, where nothing in Python can stop it, and unpacks whatever a chunk
holds; a decoder of videos allocates what any of its packets says. So they have a process of its own, with little
memory, that is killed when no answer comes. This module imports nothing of the package and is run by its path, so that
it starts at once.

A question has `kind` (hdf5 or video), `file`, `serial` (of its opening), `do` and its arguments, an answer `answer`, or
`fault` and what it is.
"""

import base64
import json
import resource
import sys
import time
from typing import Any

PIECE = 1 << 20
"""Bytes of a row, or characters of texts, in an answer; numbers are told so many fewer at once."""
NUMBERS, TEXTS = 20_000, 100
MOST_TEXT, MOST_NAMES = 1 << 18, 1000
TURN_S = 1.0
"""Seconds that frames are decoded for an answer."""


class _FaultError(Exception):
    """What is wrong with the file."""


def _piece(data: bytes, start: int) -> list[Any]:
    """A piece of the bytes, from `start` on, and how many there are."""
    return [base64.b64encode(data[start : start + PIECE]).decode(), len(data)]


class _Hdf5:
    """A file with the row that was read last."""

    def __init__(self, file: str):
        import h5py

        self._h5py, self._kept = h5py, (("", -1), b"")
        try:
            self._root = h5py.File(file, "r", locking=False)  # it may be open for long, and lie where nobody may write
        except (OSError, RuntimeError):
            raise _FaultError("it cannot be read as HDF5") from None

    def close(self) -> None:
        self._root.close()

    def names(self, path: str) -> list[str]:
        """Names of what is in a group, none where it is not; those that are no text are left out."""
        try:
            found = self._found(path)
        except _FaultError:
            return []
        if not isinstance(found, self._h5py.Group):
            raise _FaultError(f"{path} is no group")
        if len(found) > MOST_NAMES:
            raise _FaultError(f"{path} holds {len(found)} names, at most {MOST_NAMES} are read")
        return sorted(name for name in found if isinstance(name, str))

    def facts(self, path: str) -> list[Any]:
        """Shape and type of an array."""
        found = self._array(path)
        return [list(found.shape), str(found.dtype)]

    def values(self, path: str, start: int) -> list[float | str]:
        """Some of the numbers or texts of a list, from `start` on; none after its end."""
        found = self._array(path)
        if found.dtype.kind in "fiu":
            return [float(value) for value in found[start : start + NUMBERS]]
        if self._h5py.check_string_dtype(found.dtype) is None:
            raise _FaultError(f"{path} holds {str(found.dtype)[:40]}, neither numbers nor texts")
        told: list[float | str] = []
        while start < len(found) and sum(len(str(text)) for text in told) < PIECE and len(told) < TEXTS:
            text = bytes(found[start])
            if len(text) > MOST_TEXT:
                raise _FaultError(f"{path}[{start}] has {len(text)} bytes, at most {MOST_TEXT} are read")
            try:
                told.append(text.decode())
            except UnicodeDecodeError as error:
                raise _FaultError(f"{path}[{start}]: {error}") from None
            start += 1
        return told

    def row(self, path: str, number: int, start: int) -> list[Any]:
        """A piece of a row's bytes, from `start` on, and how many it has; without zeros that pad it."""
        if self._kept[0] != (path, number):
            found = self._array(path)
            data = found[number].tobytes()
            self._kept = ((path, number), data.rstrip(b"\0") if found.ndim == 2 else data)
        return _piece(self._kept[1], start)

    def _array(self, path: str) -> Any:
        """An array whose values lie in this file."""
        found = self._found(path)
        if not isinstance(found, self._h5py.Dataset) or found.is_virtual or found.external or not found.shape:
            raise _FaultError(f"{path} is no array in this file")
        return found

    def _found(self, path: str) -> Any:
        """What is there, by way of hard links alone: others may lead to other files, or in circles."""
        place = self._root
        for part in path.split("/"):
            group = isinstance(place, self._h5py.Group)
            if not group or not isinstance(place.get(part, getlink=True), self._h5py.HardLink):
                raise _FaultError(f"it has no {path} of its own")
            place = place[part]
        return place


class _Video:
    """A video at one of its frames, of which only those are turned into pictures that are asked for."""

    def __init__(self, file: str):
        import cv2

        self._cv2, self._picture = cv2, b""
        # of one thread: each more holds frames of its own
        self._capture = cv2.VideoCapture(file, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
        if not self._capture.isOpened():
            raise _FaultError("it cannot be read as a video")

    def close(self) -> None:
        self._capture.release()

    def size(self) -> list[int]:
        """Width and height, as the file tells them before anything is decoded."""
        names = (self._cv2.CAP_PROP_FRAME_WIDTH, self._cv2.CAP_PROP_FRAME_HEIGHT)
        return [int(self._capture.get(name)) for name in names]

    def grab(self, count: int) -> int:
        """Decode so many frames, or fewer if that takes long; returns their number, negative where the video ends."""
        done, until = 0, time.monotonic() + TURN_S
        while done < count and time.monotonic() < until:
            if not self._capture.grab():
                return -done - 1
            done += 1
        return done

    def picture(self, start: int) -> list[Any]:
        """A piece of the colours (H, W, 3) of the frame that was decoded last, how many bytes it has, and H and W."""
        if start == 0:
            done, bgr = self._capture.retrieve()
            if not done:
                raise _FaultError("a frame cannot be decoded")
            self._shape = bgr.shape[:2]
            self._picture = self._cv2.cvtColor(bgr, self._cv2.COLOR_BGR2RGB).tobytes()
        return [*_piece(self._picture, start), *self._shape]


def main() -> None:
    limit = int(sys.argv[1])
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    opened: dict[tuple[str, int], _Hdf5 | _Video] = {}
    for line in sys.stdin:
        asked = json.loads(line)
        kind = _Hdf5 if asked.pop("kind") == "hdf5" else _Video
        key = (asked.pop("file"), asked.pop("serial"))
        try:
            if key not in opened:
                for one in opened.values():  # else the library answers from what it knows of a file with this inode
                    one.close()
                opened.clear()
                opened[key] = kind(key[0])
            told = {"answer": getattr(opened[key], asked.pop("do"))(**asked)}
        except _FaultError as error:
            told = {"fault": str(error)[:1000]}
        except MemoryError:
            told = {"fault": f"reading it takes more than {limit} bytes of memory"}
        except Exception as error:  # of whatever kind the library makes of damaged bytes
            told = {"fault": f"it is damaged: {type(error).__name__}: {str(error)[:200]}"}
        print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
