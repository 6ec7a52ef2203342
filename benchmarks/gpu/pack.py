"""Packs recorded boards for a machine with a GPU that has neither the simulator nor a network: the way there.

    python -m benchmarks.gpu.pack --data DATA/train --rows paper,paper-without-inference --out PACK
    python -m benchmarks.gpu.pack --data DATA/random/train --rows paper-without-exploration --out PACK

The datasets are those of Table 2 (`python -m benchmarks.tables.table2 record`); features that are missing are computed.
The pack holds what the paper's graph networks learn from, and the parameters of the rows that are to be trained on it.
Boards to judge on stay here.

`--wheels NAME...` adds packages of requirements/lock.txt, in its versions and compared with its hashes, for Linux on
x86-64 and the Python of `--python`. `benchmarks.gpu.train` needs torch, torch-geometric, numpy, pydantic and
safetensors with what these need; without a NAME all of them are added but numpy and torch with what it needs itself.

The paper's interaction networks learn from no pack: every epoch's boards are collected with the networks of the epoch
before, which takes the simulator (`benchmarks.gpu.interact`). `--simulator` adds what that needs beside the packages
above, and without `--data` there is nothing else:

    python -m benchmarks.gpu.pack --simulator --out PACK
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.gpu.formats import write_pack
from benchmarks.runner import chosen, one_of, parser
from benchmarks.tables.table2 import ROWS
from busybot.common.config import build
from busybot.common.errors import BusybotError, UsageError
from busybot.datasets.dataset import Dataset
from busybot.datasets.summary import origin_of
from busybot.evaluation.results import commit
from busybot.reason.inputs.board_dataset import held_apart
from busybot.reason.inputs.feature_store import features_of
from busybot.reason.models.paper.config import PaperReasonConfig
from provision import packages

LOCK = Path(__file__).resolve().parents[2] / "requirements" / "lock.txt"
WHEELS = (
    *("torch-geometric", "psutil", "tqdm", "xxhash", "requests", "certifi", "charset-normalizer", "idna", "urllib3"),
    *("pydantic", "pydantic-core", "annotated-types", "typing-extensions", "typing-inspection", "safetensors"),
)
"""What training needs beside numpy and torch with what it needs itself: of the other packages what they import."""
SIMULATOR = (
    *("sapien", "transforms3d", "lxml", "pyperclip", "importlib-resources", "setuptools", "opencv-python", "scipy"),
    *("mcap", "lz4", "zstandard", "foxglove-sdk", "protobuf", "pyarrow", "pyyaml", "pillow", "defusedxml"),
    *("typer", "rich", "markdown-it-py", "mdurl", "pygments", "shellingham", "annotated-doc"),
    *("matplotlib", "contourpy", "cycler", "fonttools", "kiwisolver"),
    *("packaging", "pyparsing", "python-dateutil", "six"),
)
"""What it takes to collect and to draw curves, beside what training needs."""
PLATFORMS = ("manylinux_2_28_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64", "manylinux1_x86_64")
EACH = 2500
"""Boards in a file: some 9 MB."""


def trainings(rows: list[str], file: Path | None) -> dict[str, PaperReasonConfig]:
    """Parameters of rows of Table 2.

    Raises:
        BusybotError: one does not train the paper's networks on all boards.
    """
    options = argparse.ArgumentParser()  # those of `busybot train reason` that rows have
    options.add_argument("--variant")
    options.add_argument("--encoder")
    options.add_argument("--set", action="append", default=[])
    found = {}
    for name in rows:
        told = options.parse_args(ROWS[name].train)
        if told.variant != "paper":
            raise BusybotError(f"the row {name} trains none of the paper's networks", "choose rows `paper...`")
        config = build(PaperReasonConfig, file, told.set, {"encoder": told.encoder})
        if config.loop.held_out or config.loop.boards:
            raise BusybotError(f"the row {name} does not train on all boards", "choose one that holds none out")
        found[name] = config
    return found


def pack(arguments: argparse.Namespace) -> dict[str, Any]:
    """Write the pack; returns what is told of it."""
    rows = trainings(chosen(arguments.rows, ROWS), arguments.config)
    encoders = sorted({config.encoder for config in rows.values()})
    if len(encoders) > 1:
        raise BusybotError(f"the rows read features of {' and '.join(encoders)}", "pack them one by one")
    datasets = [Dataset.open(path) for path in arguments.data]
    features = [features_of(dataset, encoders[0], workers=arguments.workers) for dataset in datasets]
    boards, _ = held_apart(datasets, features, share=0, seed=0)
    info = write_pack(
        arguments.out,
        boards,
        arguments.each,
        commit=commit(),
        data=[origin_of(dataset) for dataset in datasets],
        features=features[0].key,
        oracle=any(found.oracle for found in features),
        rows={name: config.model_dump(mode="json") for name, config in rows.items()},
    )
    size = sum((arguments.out / name).stat().st_size for name in info.files)
    return {"boards": info.boards, "bytes": size, "bytes_per_board": round(size / info.boards), "rows": sorted(rows)}


def locked(names: list[str]) -> str:
    """The lines of the lock about these packages, with versions and hashes."""
    text = LOCK.read_text(encoding="utf-8")
    found = {name: packages.locked(text, name) for name in names}
    if absent := [name for name, lines in found.items() if not lines]:
        raise BusybotError(f"{LOCK.name} has no {', '.join(absent)}", "name packages as it does")
    return "".join(found.values())


def fetch(names: list[str], python: str, folder: Path) -> int:
    """Download wheels; returns their bytes."""
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as wanted:
        wanted.write(locked(names))
        wanted.flush()
        platforms = [word for name in PLATFORMS for word in ("--platform", name)]
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:"]
        command += ["--python-version", python, "--implementation", "cp", *platforms]
        subprocess.run([*command, "--require-hashes", "--dest", str(folder), "-r", wanted.name], check=True)
    return sum(file.stat().st_size for file in folder.glob("*.whl"))


def main(words: list[str]) -> None:
    options = parser(__doc__, assets=False, out=None)
    options.add_argument("--data", type=Path, nargs="+", help="recorded datasets to train on")
    options.add_argument("--rows", default="paper", help="rows of Table 2 that are trained on them")
    options.add_argument("--out", type=Path, required=True, help="folder of the pack")
    options.add_argument("--config", type=Path, help="YAML file with parameters of every training")
    options.add_argument("--each", type=int, default=EACH, help="boards in a file")
    options.add_argument("--workers", type=int, help="processes that compute missing features")
    options.add_argument("--wheels", nargs="*", help="packages to add; without a name all that may be absent there")
    options.add_argument("--simulator", action="store_true", help="add what it takes to collect, too")
    options.add_argument("--python", default="3.12", help="version of Python there")
    arguments = options.parse_args(words)
    if not arguments.data and arguments.wheels is None and not arguments.simulator:
        raise UsageError("nothing to pack", "--data DATASET... to learn from, --wheels or --simulator for packages")
    if arguments.each < 1:
        raise UsageError(f"--each {arguments.each}: a file has no board", "--each from 1")
    if arguments.data:
        print(pack(arguments))
    if arguments.wheels is not None or arguments.simulator:
        names = [*(arguments.wheels or WHEELS), *(SIMULATOR if arguments.simulator else ())]
        print(f"wheels: {fetch(names, arguments.python, arguments.out / 'wheels')} bytes")


if __name__ == "__main__":
    one_of(main)
