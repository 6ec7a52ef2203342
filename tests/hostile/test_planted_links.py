"""A dataset from a stranger, with links planted where busybot will write: nothing outside of it is touched.

Every command ends well or in an error that says what to do.
"""

import contextlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from busybot.boards.config import BoardConfig
from busybot.common.atomic_io import append_line
from busybot.common.errors import BusybotError
from busybot.datasets.create import continue_or_create, create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.dvc_remote import pull
from busybot.datasets.exporting.targets import export_recordings
from busybot.datasets.freeze import freeze
from busybot.datasets.repair import repair
from busybot.datasets.verify import verify
from busybot.interact.training.sample_cache import cache_samples
from busybot.objects.importing.importer import import_objects
from busybot.objects.resolve import find
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs.feature_store import features_of
from busybot.sim.collect import CollectConfig, collect
from busybot.sim.scene.render import RenderConfig
from busybot.training.checkpoint import save_tensors
from busybot.training.model_cards import ModelCard, write_info
from busybot.training.run_folder import begin_folder
from busybot.view.report.report import write_report
from tests.episodes.folders import make_dataset
from tests.objects.raw_objects import ROCKER, make_raw

SMALL = CollectConfig(policy="scripted", steps=2, render=RenderConfig(width=160, height=120))
TABLE1 = Path(__file__).resolve().parents[2] / "benchmarks" / "results" / "table1.json"
POINTER = f"outs:\n- md5: {'0' * 32}.dir\n  size: 10\n  nfiles: 2\n  hash: md5\n  path: toys\n"
PROCESSES = 1000
"""Temporary names once held the process's number and nothing else: links lie at those of so many."""


def record(path: Path) -> None:
    collect(Dataset.open(path), find("procedural"), SMALL, 1)


COMMANDS: dict[str, Callable[[Path], object]] = {
    "features": lambda path: features_of(Dataset.open(path), workers=1),
    "repair": repair,
    "repair, dropping": lambda path: repair(path, keep_partial=False),
    "freeze": lambda path: freeze(path, None),
    "verify": verify,
    "tables": lambda path: Dataset.open(path).write_tables(),
    "copy": lambda path: repair(path, path.with_name("copy")),
    "export": lambda path: export_recordings(Dataset.open(path), "parquet", path.with_name("exported")),
}


def link(path: Path, target: Path) -> None:
    """A link in place of what may be there; a copy of that lies where it leads."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_dir():
        shutil.move(path, target)
    elif path.exists():
        path.unlink()
    path.symlink_to(target)


def plant(name: str) -> Callable[[Path, Path], None]:
    """A link at this place relative to the dataset's parent, to a folder or, for files, to a file."""

    def planted(path: Path, outside: Path) -> None:
        target = outside / ("file" if Path(name).suffix or name.endswith(".lock") else Path(name).name)
        link(path.parent / name, target)
        if target.name != "file":
            target.mkdir(exist_ok=True)
            (target / "precious").write_bytes(b"precious")

    return planted


def temporary_names(path: Path, outside: Path) -> None:
    """At the names that earlier versions gave to their temporary files."""
    places = [path / "dataset.json", *(path / "episodes" / f"00000{index}.mcap" for index in (0, 1))]
    places += [path / "tables" / table / "part-00000.parquet" for table in ("episodes", "steps", "objects")]
    places += [path / "damaged" / "000001.mcap", path / "README.md", path / "manifest.json"]
    with contextlib.suppress(BusybotError):  # of damaged episodes there are no features
        rows = Dataset.open(path).episodes_table().to_pydict()
        store = path.with_name(f"{path.name}.features") / make_extractor().key
        for index, digest in zip(rows["episode"], rows["content_digest"], strict=True):
            places.append(store / f"{index:06d}-{digest[:16]}.npy")
    for place in places:
        place.parent.mkdir(parents=True, exist_ok=True)
        for process in range(os.getpid(), os.getpid() + PROCESSES):
            os.symlink(outside / "file", place.parent / f".{place.name}.{process}.tmp")


PLANTS: dict[str, Callable[[Path, Path], None]] = {"temporary names": temporary_names}
PLANTS |= {
    name: plant(name)
    for name in (
        "toys/.lock",
        "toys/boards",
        "toys/damaged",
        "toys/damaged/000001.mcap",
        "toys/episodes",
        "toys/episodes/000001.mcap",
        "toys/manifest.json",
        "toys/objects",
        "toys/README.md",
        "toys/tables",
        "toys/tables/steps",
        "toys/tables/steps/part-00000.parquet",
        "toys.features",
        f"toys.features/{make_extractor().key}",
    )
}


def everything(folder: Path) -> dict[str, tuple[int, int, bytes]]:
    """Permissions, time and content of all that is in it."""
    return {
        str(path.relative_to(folder)): (
            path.lstat().st_mode,
            path.lstat().st_mtime_ns,
            path.read_bytes() if path.is_file() else b"",
        )
        for path in sorted([folder, *folder.rglob("*")])
    }


def attack(
    path: Path, outside: Path, planted: Callable[[Path, Path], None], command: Callable[[Path], object]
) -> BusybotError | None:
    """The error in which the command ended, if it did; what is outside is as it was."""
    outside.mkdir()
    (outside / "file").write_bytes(b"precious")
    planted(path, outside)
    before = everything(outside)
    error = None
    try:
        command(path)
    except BusybotError as fault:
        error = fault
        assert fault.hint, fault
    assert everything(outside) == before
    return error


@pytest.fixture(scope="module")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Without tables: there is something to write."""
    dataset = make_dataset(tmp_path_factory.mktemp("synthetic") / "toys", boards=2, finished=(0, 1))
    shutil.rmtree(dataset.path / "tables")
    return dataset.path


@pytest.fixture(scope="module")
def damaged(pristine: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a cut episode, which `repair` replaces."""
    path = tmp_path_factory.mktemp("damaged") / "toys"
    shutil.copytree(pristine, path)
    episode = path / "episodes" / "000001.mcap"
    episode.write_bytes(episode.read_bytes()[:-1000])
    return path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half collected, without tables."""
    path = tmp_path_factory.mktemp("recorded") / "toys"
    create_dataset(path, BoardConfig(boards=2, group_size=2), find("procedural"))
    record(path)
    (path / "episodes/000001.mcap").unlink()
    shutil.rmtree(path / "tables")
    return path


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_outside_is_touched(pristine: Path, damaged: Path, tmp_path: Path, command: str) -> None:
    for number, (name, planted) in enumerate(PLANTS.items()):
        place = tmp_path / str(number)
        shutil.copytree(damaged if "repair" in command else pristine, place / "toys")
        try:
            attack(place / "toys", place / "outside", planted, COMMANDS[command])
        except BaseException as error:
            error.add_note(f"{command} with links at {name}")
            raise


@pytest.mark.long
def test_collecting_touches_nothing_outside(recorded: Path, tmp_path: Path) -> None:
    """Also in its workers."""
    names = ["temporary names", "toys/.lock", "toys/episodes", "toys/episodes/000001.mcap", "toys/tables/steps"]
    for number, name in enumerate(names):
        place = tmp_path / str(number)
        shutil.copytree(recorded, place / "toys")
        try:
            error = attack(place / "toys", place / "outside", PLANTS[name], record)
            assert (error is None) == (name == "temporary names")
        except BaseException as error:
            error.add_note(f"links at {name}")
            raise
    done = Dataset.open(tmp_path / "0" / "toys")
    assert done.finished() == {0, 1} and set(done.table("episodes")["episode"].to_pylist()) == {0, 1}


@pytest.mark.parametrize("name", ["toys.features", f"toys.features/{make_extractor().key}"])
def test_a_store_that_is_a_link_is_refused_by_name(pristine: Path, tmp_path: Path, name: str) -> None:
    shutil.copytree(pristine, tmp_path / "toys")
    error = attack(tmp_path / "toys", tmp_path / "outside", PLANTS[name], COMMANDS["features"])
    assert error is not None and f"{tmp_path / name}: a link" in error.what


def report(folder: Path) -> None:
    write_report([TABLE1], folder)


def train(folder: Path) -> None:
    """Begin a training as all of them do."""
    begin_folder(folder, SMALL, 0, before=("rounds", "validation"))


def save_weights(folder: Path) -> None:
    save_tensors(folder / "checkpoints" / "position.safetensors", {"weight": torch.zeros(3)})


def cache(folder: Path) -> None:
    dataset = make_dataset(folder.with_name("recorded"), boards=1, finished=(0,))
    cache_samples(dataset, folder / "cache", "depth")


def evaluate(folder: Path) -> None:
    append_line(folder / "boards.jsonl", "{}", folder)


def save_card(folder: Path) -> None:
    write_info(folder / "model", ModelCard(), [])


def import_raw(folder: Path) -> None:
    raw = make_raw(folder.with_name("raw") / "100", "Switch", ROCKER)
    list(import_objects([raw], folder))


@pytest.mark.parametrize(
    ("command", "names"),
    [
        (save_card, ["model"]),
        (import_raw, ["Switch", "Lamp"]),
        (report, ["figures"]),
        (train, ["rounds", "validation", "rounds/000"]),
        (save_weights, ["checkpoints"]),
        (cache, ["cache"]),
        (evaluate, ["boards.jsonl"]),
        (lambda folder: pull(folder.parent / "toys", "remote"), ["../.toys.pull", "../.toys.pull/toys.dvc"]),
    ],
    ids=["model", "import", "report", "training", "checkpoint", "sample cache", "evaluation", "pull"],
)
def test_other_folders_are_not_left_either(tmp_path: Path, command: Callable[[Path], object], names: list[str]) -> None:
    for number, name in enumerate(names):
        place = tmp_path / str(number)
        (place / "out").mkdir(parents=True)
        (place / "toys.dvc").write_text(POINTER)
        outside, planted = place / "outside", place / "out" / name
        outside.mkdir()
        (outside / "precious").write_bytes(b"precious")
        planted.parent.mkdir(exist_ok=True)
        planted.symlink_to(outside / "precious" if planted.suffix in (".jsonl", ".dvc") else outside)
        before = everything(outside)
        with pytest.raises(BusybotError, match="link") as error:
            command(place / "out")
        assert Path(name).name in error.value.what and error.value.hint
        assert everything(outside) == before


def test_the_user_s_own_links_are_followed(pristine: Path, tmp_path: Path) -> None:
    """A dataset, its parent and a store that are named through links."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "data").symlink_to(tmp_path / "disk")
    shutil.copytree(pristine, tmp_path / "disk" / "toys")
    (tmp_path / "link").symlink_to(tmp_path / "data" / "toys")
    Dataset.open(tmp_path / "link").write_tables()
    assert verify(tmp_path / "data" / "toys").ok
    (tmp_path / "store").mkdir()
    (tmp_path / "named").symlink_to(tmp_path / "store")
    assert features_of(Dataset.open(tmp_path / "link"), store=tmp_path / "named", workers=1).new == 2
    assert len(list((tmp_path / "store").rglob("*.npy"))) == 2
    dataset = Dataset.open(pristine)
    made = continue_or_create(tmp_path / "data" / "more" / "toys", dataset.info, dataset.boards())
    assert (tmp_path / "disk" / "more" / "toys" / "dataset.json").is_file() and made.boards() == dataset.boards()
