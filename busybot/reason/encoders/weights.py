"""Where the weights of ImageNet's ResNet-50 come from: a file at hand, the cache, or their official place."""

import hashlib
import urllib.request
from pathlib import Path

from busybot.errors import BusybotError
from busybot.files import replacing, sha256_of
from busybot.objects.cache import cache_folder

ADDRESS = "https://download.pytorch.org/models/resnet50-0676ba61.pth"
SHA256 = "0676ba61b6795bbe1773cffd859882e5e297624d384b6993f7c9e683e722fb8a"
BYTES = 102_530_333
"""Of the file at that address: torchvision's first weights for ImageNet, of the paper's time."""

TIME_LIMIT_S = 60.0
"""Without any byte for so long the download counts as failed."""
PIECE = 1 << 20
MEND = "download it elsewhere and name it (`--weights FILE`), or use `--encoder embedded`, which needs none"


def resnet50_file(file: Path | None) -> tuple[Path, str]:
    """A file with the weights and its SHA-256.

    Args:
        file: any with torchvision's layout; None for the official one, which is downloaded into the cache once.

    Raises:
        BusybotError: there is no such file; it cannot be downloaded; or what came is not what was to come.
    """
    if file is not None:
        if not file.is_file():
            raise BusybotError(f"{file}: there is no such file with weights", MEND)
        return file, sha256_of(file)
    place = cache_folder() / "weights" / ADDRESS.rpartition("/")[2]
    if not (place.is_file() and sha256_of(place) == SHA256):
        _download(place)
    return place, SHA256


def _download(place: Path) -> None:
    digest = hashlib.sha256()
    try:
        with urllib.request.urlopen(ADDRESS, timeout=TIME_LIMIT_S) as answer, replacing(place) as out:
            size = 0
            while (piece := answer.read(PIECE)) and size <= BYTES:
                size += len(piece)
                digest.update(piece)
                out.write(piece)
            if digest.hexdigest() != SHA256:
                raise BusybotError(f"{ADDRESS}: what came has another SHA-256 than the file that is known", MEND)
    except OSError as error:  # no network, refused, too slow, or no room
        raise BusybotError(f"{ADDRESS}: cannot be downloaded: {error}", MEND) from None
