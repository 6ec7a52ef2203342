"""`busybot features DATASET`: 256 numbers for every frame and object, kept beside the dataset."""

import time
from pathlib import Path
from typing import Annotated

import typer

from busybot.cli.common import check_file, episode_progress, print_json, say
from busybot.cli.options import DeviceOption, JsonOption, WorkersOption, encoders, offering


def features(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Folder of a dataset with episodes.")],
    encoder: Annotated[
        str,
        typer.Option(
            help="embedded, resnet50, resnet50keras or random; with -box, -mask (an oracle) or -centre behind it.",
            autocompletion=offering(encoders),
        ),
    ] = "embedded",
    weights: Annotated[
        Path | None, typer.Option(help="Of resnet50: a file of torchvision's; by default the official one.")
    ] = None,
    store: Annotated[Path | None, typer.Option(help="Keep them in this folder instead of DATASET.features.")] = None,
    parquet: Annotated[Path | None, typer.Option(help="Also write a table to this file, for other programs.")] = None,
    workers: WorkersOption = None,
    device: DeviceOption = "auto",
    json: JsonOption = False,
) -> None:
    """Turn pictures into what models of relations read: 256 numbers for every responder and frame.

    Training and evaluation do it themselves. Ctrl-C loses nothing: the same command continues.
    """
    from busybot.datasets.dataset import Dataset
    from busybot.reason.inputs.feature_store import features_of, write_table

    check_file("--parquet", parquet, "features.parquet")
    began = time.monotonic()
    with episode_progress("encoding") as progress:
        found = features_of(
            Dataset.open(dataset), encoder, weights=weights, store=store, workers=workers, progress=progress
        )
    seconds = time.monotonic() - began
    if parquet is not None:
        write_table(parquet, found)
        say(f"wrote {parquet}")
    if json:
        told = {name: getattr(found, name) for name in ("encoder", "key", "oracle", "folder", "new")}
        counts = {"episodes": len(found), "frames": sum(len(found[episode]) for episode in found)}
        print_json({"dataset": dataset, **told, "parquet": parquet, **counts, "seconds": round(seconds, 2)})
    else:
        say(f"features of {len(found)} episodes in {found.folder}, {found.new} of them new")
