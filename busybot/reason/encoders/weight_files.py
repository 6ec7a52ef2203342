"""Files with weights that are downloaded: once, whole, and only what is known to be right."""

import hashlib
import http.client
import urllib.request
from pathlib import Path
from typing import NamedTuple

from busybot.common.atomic_io import open_regular, replacing
from busybot.common.errors import BusybotError

TIME_LIMIT_S = 60.0
"""Without any byte for so long a download counts as failed."""
PIECE = 1 << 20


class KnownFile(NamedTuple):
    """A file at an address.

    Attributes:
        algorithm: of the digest, as `hashlib` calls it.
        digest: in hexadecimal digits.
        bytes: its size; what is longer is not read to its end.
    """

    address: str
    algorithm: str
    digest: str
    bytes: int

    @property
    def name(self) -> str:
        """The last part of its address."""
        return self.address.rpartition("/")[2]


def download(known: KnownFile, place: Path, instead: str) -> None:
    """Put the file there, if it is the one that is known; nothing is left behind otherwise.

    Args:
        instead: what else can be done, for the hint.

    Raises:
        BusybotError: it cannot be had, or what came is another file.
    """
    digest = hashlib.new(known.algorithm)
    hint = f"download it elsewhere and copy it to {place}, or {instead}"
    try:
        with urllib.request.urlopen(known.address, timeout=TIME_LIMIT_S) as answer, replacing(place) as out:
            size = 0
            while (piece := answer.read(PIECE)) and size <= known.bytes:
                size += len(piece)
                digest.update(piece)
                out.write(piece)
            if size != known.bytes:
                raise BusybotError(
                    f"{known.address}: {size} bytes came, the file that is known has {known.bytes}", hint
                )
            if digest.hexdigest() != known.digest:
                what = f"what came has another {known.algorithm} than the file that is known"
                raise BusybotError(f"{known.address}: {what}", hint)
    except (OSError, http.client.HTTPException) as error:  # no network, refused, too slow, cut off, or no room
        raise BusybotError(f"{known.address}: cannot be downloaded: {error}", hint) from None


def is_there(known: KnownFile, place: Path) -> bool:
    """Whether the file lies there as it is known."""
    if not place.is_file() or place.stat().st_size != known.bytes:
        return False
    with open_regular(place, known.bytes) as file:
        return hashlib.file_digest(file, known.algorithm).hexdigest() == known.digest
