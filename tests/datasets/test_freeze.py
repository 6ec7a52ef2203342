"""Frozen: finished, whole, listed file by file, read-only, and never collected into again."""

import json
import shutil
import stat
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from busybot.boards.config import BoardConfig
from busybot.common.atomic_io import scan, sha256_of
from busybot.common.errors import BusybotError
from busybot.datasets import freeze as module
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.create import boards_again, create_dataset
from busybot.datasets.dataset import Dataset
from busybot.datasets.freeze import copy_tiny, freeze
from busybot.datasets.manifest import AssetEntry, is_frozen, read_manifest
from busybot.datasets.summary import summarise
from busybot.datasets.verify import verify
from busybot.objects.library import Library
from busybot.objects.resolve import find
from tests.episodes.folders import COLLECT, make_dataset


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return make_dataset(tmp_path / "d", boards=3, finished=range(3))


def faults(path: Path) -> list[tuple[str, str]]:
    return [(str(Path(problem.file).relative_to(path)), problem.what) for problem in verify(path).problems]


def thaw(path: Path) -> None:
    for place in [path, *path.rglob("*")]:
        place.chmod(place.stat().st_mode | stat.S_IWUSR)


def test_the_manifest_lists_every_file_and_what_decided_it(dataset: Dataset) -> None:
    before = dataset.hashes()
    done = freeze(dataset.path, None)
    assert done.new and is_frozen(dataset.path)
    manifest = read_manifest(dataset.path)
    assert manifest == done.manifest
    files = set(scan(dataset.path).files) - {"manifest.json"}
    assert set(manifest.files) == files and len(files) == 2 + 1 + 3 + 3
    for name, entry in manifest.files.items():
        assert entry.sha256 == sha256_of(dataset.path / name)
        assert entry.bytes == (dataset.path / name).stat().st_size
    assert vars(before) == manifest.hashes.model_dump()
    assert (manifest.boards, manifest.steps, manifest.collect) == (3, 18, COLLECT)
    assert [(o.renderer["device"], o.versions, o.episodes) for o in manifest.origins] == [
        ("numpy", {"busybot": "0.0", "numpy": "2"}, 3)
    ]
    assert set(manifest.assets) == set(dataset.info.assets.sha256)
    assert not any(entry.carried for entry in manifest.assets.values())
    assert faults(dataset.path) == []


def test_nothing_can_be_written_any_more(dataset: Dataset) -> None:
    freeze(dataset.path, None)
    for place in [dataset.path, *dataset.path.rglob("*")]:
        assert not place.stat().st_mode & 0o222, place
    for act in (lambda: dataset.begin_collecting(COLLECT), lambda: dataset.locked().__enter__()):
        with pytest.raises(BusybotError, match="frozen"):
            act()
    assert not (dataset.path / ".lock").exists()
    assert summarise(dataset.path)["frozen"]


def test_what_is_missing_changed_or_added_is_named(dataset: Dataset) -> None:
    freeze(dataset.path, None)
    thaw(dataset.path)
    (dataset.path / "README.md").unlink()
    table = dataset.path / "tables/steps/part-00000.parquet"
    table.write_bytes(table.read_bytes() + b"x")
    info = dataset.path / "dataset.json"
    info.write_text(info.read_text().replace('"toys"', '"boys"'))
    (dataset.path / "notes.txt").write_text("mine")
    found = dict(faults(dataset.path))
    assert found["README.md"] == "missing; the manifest lists it"
    assert "the manifest says" in found["tables/steps/part-00000.parquet"]
    assert found["dataset.json"] == "its content changed after freezing: another SHA-256 than the manifest's"
    assert "notes.txt" in found
    hints = [problem.hint for problem in verify(dataset.path).problems if problem.file.endswith("part-00000.parquet")]
    assert len(hints) == 2 and all("repair DATASET --out DIR" in hint for hint in hints)


def test_a_manifest_with_other_hashes_is_noticed(dataset: Dataset) -> None:
    freeze(dataset.path, None)
    thaw(dataset.path)
    file = dataset.path / "manifest.json"
    values = json.loads(file.read_text())
    values["hashes"]["content"] = "0" * 64
    file.write_text(json.dumps(values))
    assert faults(dataset.path) == [("manifest.json", "its hashes are not those of the dataset")]


@pytest.mark.parametrize(
    "edit",
    [
        {"manifest_version": "9.0"},
        {"files": {"../../etc/passwd": {"sha256": "0" * 64, "bytes": 1}}},
        {"files": {"/etc/passwd": {"sha256": "0" * 64, "bytes": 1}}},
        {"files": {"a/../b": {"sha256": "0" * 64, "bytes": 1}}},
        {"files": {"a\n": {"sha256": "0" * 64, "bytes": 1}}},
        {"files": {"a": {"sha256": "x", "bytes": -1}}},
        {"hashes": None},
        {"surprise": 1},
    ],
)
def test_a_damaged_manifest_is_refused_and_nothing_outside_is_read(dataset: Dataset, edit: dict) -> None:
    freeze(dataset.path, None)
    thaw(dataset.path)
    file = dataset.path / "manifest.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | edit))
    with pytest.raises(BusybotError, match="manifest.json") as error:
        read_manifest(dataset.path)
    assert error.value.hint
    assert [name for name, _ in faults(dataset.path)] == ["manifest.json"]


def test_unfinished_and_damaged_datasets_are_refused(tmp_path: Path) -> None:
    for finished, text in (((), "0 of 4 boards"), ((0, 1, 3), "3 of 4 boards")):
        path = make_dataset(tmp_path / str(len(finished)), finished=finished).path
        with pytest.raises(BusybotError, match=text) as error:
            freeze(path, None)
        assert "busybot collect" in str(error.value.hint) and not is_frozen(path)
    dataset = make_dataset(tmp_path / "damaged one", boards=2, finished=range(2))
    dataset.episode_path(1).write_bytes(dataset.episode_path(1).read_bytes()[:-9])
    with pytest.raises(BusybotError, match=r"000001\.mcap") as error:
        freeze(dataset.path, None)
    assert f"busybot dataset repair '{dataset.path}'" in str(error.value.hint)
    assert not is_frozen(dataset.path)


@pytest.mark.parametrize("name", ["notes.txt", ".hidden", "episodes/.more", "extra/file", "damaged/000001.mcap"])
def test_strangers_are_refused_by_name(dataset: Dataset, name: str) -> None:
    (dataset.path / name).parent.mkdir(exist_ok=True)
    (dataset.path / name).write_text("mine")
    with pytest.raises(BusybotError, match=name) as error:
        freeze(dataset.path, None)
    assert error.value.hint and (dataset.path / name).read_text() == "mine" and not is_frozen(dataset.path)


def test_links_are_refused_and_not_followed(dataset: Dataset, tmp_path: Path) -> None:
    outside = tmp_path / "outside.mcap"
    shutil.move(dataset.episode_path(1), outside)
    mode = outside.stat().st_mode
    (dataset.path / "episodes/000001.mcap").symlink_to(outside)
    with pytest.raises(BusybotError):
        freeze(dataset.path, None)
    (dataset.path / "episodes/000001.mcap").unlink()
    shutil.copy(outside, dataset.path / "episodes/000001.mcap")
    (dataset.path / "tables/more").symlink_to(tmp_path)
    with pytest.raises(BusybotError, match="link") as error:
        freeze(dataset.path, None)
    assert "more" in error.value.what and outside.stat().st_mode == mode


def test_a_card_of_ones_own_is_not_overwritten(dataset: Dataset) -> None:
    (dataset.path / "README.md").write_text("mine")
    with pytest.raises(BusybotError, match=r"README\.md"):
        freeze(dataset.path, None)
    assert (dataset.path / "README.md").read_text() == "mine" and not is_frozen(dataset.path)


def test_the_card_has_front_matter_and_the_hashes(dataset: Dataset) -> None:
    manifest = freeze(dataset.path, None).manifest
    text = (dataset.path / "README.md").read_text()
    front, _, body = text.removeprefix("---\n").partition("\n---\n")
    values = yaml.safe_load(front)
    assert values["license"] == "other" and values["pretty_name"] == "toys" and "busybot" in values["tags"]
    assert {config["config_name"] for config in values["configs"]} == {"episodes", "steps", "objects"}
    for digest in manifest.hashes.model_dump().values():
        assert digest in body
    assert "{" not in body


def test_what_the_card_repeats_is_no_markup(dataset: Dataset) -> None:
    manifest = freeze(dataset.path, None).manifest
    collect = manifest.collect.model_copy(update={"policy": "mine`\n# hers"})
    odd = {"name": "# toys\n[here](http://x)", "split": "a`<b>|c", "collect": collect}
    body = module.card(manifest.model_copy(update=odd)).split("\n---\n", 1)[1]
    assert [line for line in body.splitlines() if line.startswith("# ")] == [r"# \# toys \[here\]\(http://x\)"]
    assert "split `a <b> c` and" in body and "`mine # hers`, recorded by" in body
    entry = AssetEntry(sha256="0" * 64, licence="MIT\n", carried=False)
    assert manifest.model_copy(update={"assets": {"a": entry}}).licence is None


@pytest.mark.parametrize("moment", ["_write_card", "file_entries", "write_json", "_finish"])
def test_stopped_at_any_moment_it_is_continued(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    shutil.copytree(dataset.path, tmp_path / "whole" / "d")
    whole = freeze(tmp_path / "whole" / "d", None).manifest

    def stop(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(module, moment, stop)
        with pytest.raises(KeyboardInterrupt):
            freeze(dataset.path, None)
    assert is_frozen(dataset.path) == (moment == "_finish")
    done = freeze(dataset.path, None)
    assert done.manifest == whole and done.new == (moment != "_finish")
    assert not dataset.path.stat().st_mode & 0o222
    assert faults(dataset.path) == []


def test_what_a_killed_copy_of_the_tiny_dataset_left_is_removed(tmp_path: Path) -> None:
    left = tmp_path / ".tiny-0123456789abcdef.tmp"
    left.mkdir()
    (left / "dataset.json").write_text("{}")
    assert copy_tiny(tmp_path / "tiny") > 12
    assert [path.name for path in tmp_path.iterdir()] == ["tiny"]


def test_two_at_once_and_a_writer_are_kept_apart(dataset: Dataset) -> None:
    with dataset.locked(), pytest.raises(BusybotError, match="another process"):
        freeze(dataset.path, None)
    assert not is_frozen(dataset.path)


@pytest.fixture
def few(few_objects: Callable[[int], Path]) -> Library:
    """Some of the default objects, as if there were no others."""
    return replace(Library.load(few_objects(0)), name="procedural")


def drawn(path: Path, library: Library) -> Dataset:
    """A dataset of boards drawn from the library, with synthetic episodes of other boards."""
    return create_dataset(path, BoardConfig(boards=2, group_size=1), library)


@pytest.fixture
def empty_collection(monkeypatch: pytest.MonkeyPatch) -> None:
    """Freezing without episodes: what is done with objects does not depend on them."""
    monkeypatch.setattr(module, "refuse_unfinished", lambda dataset: dataset.begin_collecting(COLLECT))


def test_procedural_objects_are_carried_with_all_that_could_have_been_drawn(
    tmp_path: Path, few: Library, empty_collection: None
) -> None:
    dataset = drawn(tmp_path / "d", few)
    done = freeze(dataset.path, few)
    assert done.left_out == () and done.manifest.boards_again
    assert {entry.licence for entry in done.manifest.assets.values()} == {"MIT"}
    assert len(done.manifest.assets) > len(dataset.info.assets.sha256)
    carried = library_of(dataset)
    assert carried.folder == dataset.path / "objects" and carried.name == "procedural"
    assert boards_again(dataset.info.generator, carried, dataset.boards())[0] == dataset.boards()
    report = verify(dataset.path)
    assert report.ok and report.objects == len(dataset.info.assets.sha256)
    assert "license: mit" in (dataset.path / "README.md").read_text()


def test_changed_objects_are_found(tmp_path: Path, few: Library, empty_collection: None) -> None:
    dataset = drawn(tmp_path / "d", few)
    freeze(dataset.path, few)
    thaw(dataset.path)
    key = next(iter(dataset.info.assets.sha256))
    file = dataset.path / "objects" / key / "mobility.urdf"
    file.write_text(file.read_text() + "<!-- -->")
    found = faults(dataset.path)
    assert any(name.endswith("mobility.urdf") for name, _ in found)
    assert any(key in what for name, what in found if name == "objects")


def test_partnet_objects_are_never_carried(tmp_path: Path, partnet: Path, empty_collection: None) -> None:
    library = find(str(partnet))
    dataset = drawn(tmp_path / "d", library)
    done = freeze(dataset.path, library, licence="CC0-1.0")
    assert not (dataset.path / "objects").exists() and "PartNet-Mobility" in done.left_out[0]
    assert {entry.carried for entry in done.manifest.assets.values()} == {False}
    assert all("PartNet" in entry.licence for entry in done.manifest.assets.values())
    assert verify(dataset.path).objects == len(dataset.info.assets.sha256)
    assert faults(dataset.path) == []
    other = verify(dataset.path, assets="procedural")
    assert not other.ok and "absent" in other.problems[0].what


def test_objects_of_unknown_origin_need_a_stated_licence(
    tmp_path: Path, few_objects: Callable[[int], Path], empty_collection: None
) -> None:
    library = Library.load(few_objects(5))
    for licence in (None, "CC-BY-4.0"):
        dataset = drawn(tmp_path / str(licence), library)
        done = freeze(dataset.path, library, licence=licence)
        assert (dataset.path / "objects").exists() == (licence is not None)
        assert done.left_out == (() if licence else ("unknown",))
    assert {entry.licence for entry in done.manifest.assets.values()} == {"CC-BY-4.0"}
    without = drawn(tmp_path / "without", library)
    assert freeze(without.path, library, carry=False).left_out == ()
    assert not (without.path / "objects").exists()


@pytest.mark.parametrize("name", ["old\\notes.txt", "a\nb.txt"])
def test_objects_with_files_that_no_manifest_can_tell_are_not_carried(
    tmp_path: Path, few_objects: Callable[[int], Path], empty_collection: None, name: str
) -> None:
    """Else the dataset would be frozen by a manifest that nobody can read."""
    shutil.copytree(few_objects(5), tmp_path / "objects")
    for urdf in list((tmp_path / "objects").rglob("mobility.urdf")):
        (urdf.parent / name).touch()
    library = Library.load(tmp_path / "objects")
    dataset = drawn(tmp_path / "d", library)
    with pytest.raises(BusybotError, match="a file is called") as error:
        freeze(dataset.path, library, licence="CC-BY-4.0")
    assert "rename it" in str(error.value.hint) and not is_frozen(dataset.path)
    assert not (dataset.path / "objects").exists()
    freeze(dataset.path, library, carry=False)
    assert read_manifest(dataset.path).licence is None


def test_objects_that_an_interrupted_freeze_left_behind_are_no_library(tmp_path: Path) -> None:
    """The split file is written last; until then the objects are looked for where they were before."""
    library = find("procedural")
    config = BoardConfig(boards=1, group_size=1, seed=3)
    dataset = create_dataset(tmp_path / "d", config, library)
    some = next(iter(dataset.info.assets.sha256))
    (dataset.path / "objects" / some).mkdir(parents=True)
    shutil.copy(library.folder / some / "mobility.urdf", dataset.path / "objects" / some)
    assert library_of(dataset).sha256 == library.sha256
    shutil.copy(library.folder / "data.json", dataset.path / "objects")
    with pytest.raises(BusybotError):
        library_of(dataset)
