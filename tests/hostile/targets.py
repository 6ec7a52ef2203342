"""What is read from files that others made, and how one sees that the answer is not wrong."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from busybot.boards.config import BoardConfig
from busybot.common.config import build
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.datasets.dvc_remote import read_pointer
from busybot.datasets.verify import verify
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.interact.affordance.load import load_model
from busybot.objects.partnet.loader import load_object
from busybot.objects.resolve import find
from tests.episodes.folders import make_dataset

Read = Callable[[Path], Any]


@dataclass(frozen=True)
class Target:
    """A kind of file.

    Attributes:
        make: fills a folder.
        files: pattern of the files in it that are damaged, one at a time.
        text: whether the file is text.
        read: reads the folder as users' commands do; returns what it understood, to be compared.
        strict: whether any change of the file must be noticed or be without effect.
    """

    make: Callable[[Path], None]
    files: str
    text: bool
    read: Read
    strict: bool


def _frozen(folder: Path) -> None:
    from busybot.datasets.freeze import freeze

    dataset = make_dataset(folder / "d", boards=2, finished=(0, 1))
    freeze(dataset.path, None)
    for path in sorted(folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)  # who damages files does not mind that they are read-only


def _verified(folder: Path) -> Any:
    """Nothing if the dataset is not as it was frozen: `verify` says so."""
    report = verify(folder / "d")
    return True if report.ok else NOTICED


NOTICED = "noticed"


def _episode(folder: Path) -> Any:
    return _plain(read_episode(folder / "d" / "episodes" / "000000.mcap"))


def _plain(episode: Episode) -> Any:
    pictures = [
        (image.rgb.tobytes(), None if image.depth is None else image.depth.tobytes()) for image in episode.images
    ]
    return episode.board, episode.steps, pictures


def _dataset(folder: Path) -> None:
    make_dataset(folder / "d", boards=2, finished=(0, 1))


def _boards(folder: Path) -> Any:
    dataset = Dataset.open(folder / "d")
    return [dataset.board(index) for index in range(dataset.info.boards)]


def _tables(folder: Path) -> Any:
    report = verify(folder / "d")
    return True if report.ok else NOTICED


def _object(key: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        library = find("procedural")
        shutil.copytree(library.folder / key, folder / key)

    return make


def _load(key: str) -> Read:
    def read(folder: Path) -> Any:
        model = load_object(folder / key)
        return model.sha256

    return read


def _textured(suffix: str) -> Callable[[Path], None]:
    """An object whose first material has a picture."""

    def make(folder: Path) -> None:
        _object(OBJECT)(folder)
        meshes = folder / OBJECT / "textured_objs"
        material = sorted(meshes.glob("*.mtl"))[0]
        material.write_text(material.read_text() + f"map_Kd picture{suffix}\n")
        picture = generator(0, "hostile", 0, "picture").integers(0, 255, (64, 48, 3), np.uint8)
        cv2.imwrite(str(meshes / f"picture{suffix}"), picture)

    return make


def _pointer(folder: Path) -> None:
    out = "- md5: 4ffb46ba37bd2ce52470086b4756420b.dir\n  size: 300003\n  nfiles: 4\n  hash: md5\n  path: toys\n"
    (folder / "toys.dvc").write_text("outs:\n" + out)


def _config(folder: Path) -> None:
    text = "boards: 3\nsplit: novel-object\nlamps: [3, 4]\nseed: 5\nuniform: true\n"
    (folder / "boards.yaml").write_text(text)


def _built(folder: Path) -> Any:
    return build(BoardConfig, folder / "boards.yaml", [], {})


def _model(folder: Path) -> None:
    from busybot.interact.affordance.load import find_model

    shutil.copytree(find_model("procedural"), folder / "m")


def _weights(folder: Path) -> Any:
    model = load_model(folder / "m")
    return [np.asarray(value).tobytes() for net in model.networks.values() for value in net.state_dict().values()]


OBJECT = "Switch/rocker-01"
TARGETS: dict[str, Target] = {
    "boards": Target(_frozen, "d/boards/*.jsonl", True, _verified, True),
    "boards, read": Target(_dataset, "d/boards/*.jsonl", True, _boards, False),
    "dataset.json": Target(_frozen, "d/dataset.json", True, _verified, True),
    "manifest": Target(_frozen, "d/manifest.json", True, _verified, False),
    "parquet": Target(_dataset, "d/tables/*/*.parquet", False, _tables, True),
    "mcap": Target(_dataset, "d/episodes/000000.mcap", False, _episode, True),
    "urdf": Target(_object(OBJECT), f"{OBJECT}/mobility.urdf", True, _load(OBJECT), False),
    "annotation": Target(_object(OBJECT), f"{OBJECT}/object_meta_info.json", True, _load(OBJECT), False),
    "obj and mtl": Target(_object(OBJECT), f"{OBJECT}/textured_objs/*", True, _load(OBJECT), False),
    "png": Target(_textured(".png"), f"{OBJECT}/textured_objs/*.png", False, _load(OBJECT), False),
    "jpeg": Target(_textured(".jpg"), f"{OBJECT}/textured_objs/*.jpg", False, _load(OBJECT), False),
    "dvc pointer": Target(_pointer, "toys.dvc", True, lambda folder: read_pointer(folder / "toys.dvc", "toys"), False),
    "yaml": Target(_config, "boards.yaml", True, _built, False),
    "safetensors": Target(_model, "m/*.safetensors", False, _weights, False),
    "model.json": Target(_model, "m/model.json", True, _weights, False),
}
