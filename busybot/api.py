"""The package from Python in a few calls: datasets by their address, boards by their seed."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.boards.spec import BoardSpec
from busybot.common.errors import BusybotError, naming_extras
from busybot.common.frozen_model import first_fault
from busybot.common.remote import place_of
from busybot.datasets.dataset import Dataset as Recordings
from busybot.objects.library import Library
from busybot.objects.resolve import find

if TYPE_CHECKING:
    from busybot.frames import Frames, Picture
    from busybot.reason.inputs.board_dataset import BoardDataset


class Dataset(Recordings):
    """A recorded dataset: `data[i]` is the episode of board i, `len(data)` tells how many there are.

    Episodes read their pictures from the files when these are asked for, so thousands of them can be open.
    """

    def __repr__(self) -> str:
        """A line; the parameters of its boards and recordings, which `info` has, would be many."""
        return (
            f"<Dataset {str(self.path)!r}: split {self.info.split!r}, seed {self.info.seed}, boards {self.info.boards}>"
        )

    def frames(self, *pictures: "Picture") -> "Frames":
        """All recorded steps as a map-style PyTorch dataset, see `busybot.frames.Frames`.

        Args:
            pictures: `rgb` (the default) or `depth` before each step, `next_rgb` or `next_depth` after it.

        Raises:
            BusybotError: the tables of the dataset are missing or not those of its episodes.
        """
        with naming_extras():
            from busybot.frames import Frames

        return Frames(self, *(pictures or ("rgb",)))

    def graphs(self, encoder: str = "embedded", workers: int = 1) -> "BoardDataset":
        """The episodes as a PyTorch Geometric dataset, a graph each (`reason.models.event.data.board_graph`).

        What objects look like is computed on first use and kept beside the dataset (`busybot features`).

        Args:
            encoder: of the features of pictures, see there.
            workers: processes that compute them.

        Raises:
            BusybotError: no episode is finished, one is damaged, or there is no such encoder.
        """
        with naming_extras():
            from busybot.reason.inputs.board_dataset import BoardDataset, RecordedBoards
            from busybot.reason.inputs.feature_store import features_of
            from busybot.reason.models.event.data import board_graph

        features = features_of(self, encoder, workers=workers)
        return BoardDataset(RecordedBoards((features,), tuple((0, episode) for episode in features)), board_graph)


def load_dataset(address: str | Path, storage_options: Mapping[str, Any] | None = None) -> Dataset:
    """Open a dataset, frozen or not.

    What lies elsewhere is only read, and only what is asked for: the list of recordings, tables, a recording or chunks
    of it at a time. Nothing is kept on the disk.

    Args:
        address: its folder, as a path or as an address that fsspec knows: `file://`, `s3://BUCKET/FOLDER`, `memory://`.
        storage_options: for the file system of the address, as `{"anon": True}` of S3.

    Raises:
        BusybotError: there is no dataset, it has another schema version, or the address cannot be read.
    """
    return Dataset.open(place_of(address, storage_options))


def make_board(seed: int = 0, assets: str | Library = "procedural", **config: Any) -> BoardSpec:
    """Draw one board; the same seed, objects and configuration give the same one.

    Args:
        seed: from 0.
        assets: `procedural`, a folder of objects, or a library of them.
        config: values of `boards.config.BoardConfig`, as `split="novel-object"` or `relations="one-to-one"`.

    Raises:
        BusybotError: a value is not allowed, or the objects are not there.
    """
    alone = {"boards": 1, "group_size": 1}
    if others := [name for name, one in alone.items() if config.get(name, one) != one]:
        raise BusybotError(
            f"make_board: {others[0]}: one board is drawn", "`busybot generate` makes a dataset of several"
        )
    try:
        drawn = BoardConfig.model_validate({**config, "seed": seed, **alone})
    except ValidationError as error:
        raise BusybotError(f"make_board: {first_fault(error)}", "see `busybot.boards.config.BoardConfig`") from None
    return next(iter(generate_boards(drawn, assets if isinstance(assets, Library) else find(assets))))
