"""Libraries know their splits, name what is bad, and are found again by the hashes of their objects."""

import json
import shutil
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from busybot.common.errors import BusybotError
from busybot.objects import cache
from busybot.objects.cache import places
from busybot.objects.library import Library
from busybot.objects.model import ObjectModel
from busybot.objects.partnet import loader
from busybot.objects.partnet.folder_snapshot import Snapshot
from busybot.objects.resolve import find, load_and_remember


@pytest.fixture
def small(procedural: Path, tmp_path: Path) -> Path:
    """A library of one switch, one lamp and a split file that weighs the lamp thrice."""
    folder = tmp_path / "small"
    for key in ("Switch/slider-01", "Lamp/globe-01"):
        shutil.copytree(procedural / key, folder / key)
    lists = {"Switch": {"train": ["slider-01"], "test": []}, "Lamp": {"train": ["globe-01"] * 3, "test": ["globe-01"]}}
    (folder / "data.json").write_text(json.dumps({"Reason": lists}))
    return folder


def test_repeated_ids_are_weights(small: Path) -> None:
    library = Library.load(small)
    assert library.name == "small"
    assert library.weights("train", "Lamp") == [("Lamp/globe-01", 3.0)]
    assert library.weights("novel", "Lamp") == [("Lamp/globe-01", 1.0)]
    assert library.weights("novel", "Switch") == []
    with pytest.raises(BusybotError, match="tomorrow"):
        library.weights("tomorrow", "Lamp")


def test_splits_of_the_paper(partnet: Path) -> None:
    library = Library.load(partnet)
    sizes = [[len(library.weights(s, c)) for s in ("train", "novel")] for c in ("Switch", "Door", "Lamp", "Toy")]
    assert sizes == [[32, 9], [5, 5], [3, 2], [1, 1]]
    assert dict(library.weights("train", "Switch"))["Switch/100955"] == 4


def test_without_a_split_file_the_catalogue_decides(partnet: Path, tmp_path: Path) -> None:
    shutil.copytree(partnet / "Switch" / "100934", tmp_path / "Switch" / "100934")
    assert Library.load(tmp_path).weights("train", "Switch") == [("Switch/100934", 1.0)]


def test_unknown_ids_are_refused_with_a_hint(small: Path) -> None:
    (small / "data.json").unlink()
    with pytest.raises(BusybotError, match="Lamp/globe-01") as caught:
        Library.load(small)
    assert "data.json" in str(caught.value.hint)


@pytest.mark.parametrize("text", ["", "[]", '{"Reason": 3}', '{"Reason": {"Lamp": {"train": "globe-01"}}}', "9" * 9999])
def test_bad_split_files_are_refused(small: Path, text: str) -> None:
    (small / "data.json").write_text(text)
    with pytest.raises(BusybotError, match=r"data\.json"):
        Library.load(small)


def test_an_unreadable_object_is_named(small: Path) -> None:
    (small / "Lamp" / "globe-01" / "mobility.urdf").write_text("<robot")
    with pytest.raises(BusybotError, match="globe-01"):
        Library.load(small)


def test_a_misplaced_object_is_named(small: Path) -> None:
    (small / "Lamp" / "globe-01").rename(small / "Lamp" / "globe-02")
    with pytest.raises(BusybotError, match="globe-02"):
        Library.load(small)


def test_links_in_a_library_are_refused(small: Path, procedural: Path) -> None:
    (small / "Lamp" / "cone-01").symlink_to(procedural / "Lamp" / "cone-01")
    with pytest.raises(BusybotError, match="is a link"):
        Library.load(small)


def test_missing_folders_and_objects(tmp_path: Path, small: Path) -> None:
    for place in (tmp_path / "nowhere", tmp_path):
        with pytest.raises(BusybotError):
            Library.load(place)
    with pytest.raises(BusybotError, match="Toy/none"):
        Library.load(small).get("Toy/none")


def test_found_by_hash_wherever_it_was_last_seen(small: Path) -> None:
    expected = {"Lamp/globe-01": find(str(small)).hashes()["Lamp/globe-01"]}
    # the default library holds the same lamp, but this one was seen last
    assert find(None, expected).folder == small.resolve()
    assert find(str(small), expected).get("Lamp/globe-01").sha256 == expected["Lamp/globe-01"]


def test_a_package_that_brings_no_folder_is_named_and_others_are_found(
    small: Path, registered: list[EntryPoint]
) -> None:
    registered.append(EntryPoint("theirs", "tests.objects.test_library:nothing", "busybot.objects"))
    with pytest.raises(BusybotError, match="tests.objects.test_library:nothing.* returns a NoneType, not a library's"):
        find("theirs")
    assert find(None, Library.load(small).hashes())
    with pytest.raises(BusybotError, match="Door/none is absent"):
        find(None, {"Door/none": "0" * 64})


def nothing() -> None:
    """What a stranger's package may return."""


def test_changed_and_absent_objects_are_refused_by_name(small: Path) -> None:
    with pytest.raises(BusybotError, match="Lamp/globe-01 differs"):
        find(str(small), {"Lamp/globe-01": "0" * 64})
    with pytest.raises(BusybotError, match="Door/none is absent"):
        find(None, {"Door/none": "0" * 64})


def test_real_objects_are_found_by_the_environment(
    partnet: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path))
    monkeypatch.setenv("BUSYBOT_PARTNET_DIR", str(partnet))
    expected = Library.load(partnet).hashes()
    assert find(None, expected).folder.samefile(partnet)


def test_loading_leaves_the_cache_alone_and_finding_remembers(
    small: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path / "cache"))
    expected = Library.load(small).hashes()
    assert not (tmp_path / "cache").exists()
    find(str(small))
    assert places(expected) == [small.resolve()]


def test_a_damaged_index_does_no_harm(small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path / "cache"))
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache" / "libraries.json").write_text('[{"path": 3}]')
    library = find(str(small))
    assert find(None, library.hashes()).sha256 == library.sha256


def test_a_cache_that_cannot_be_written_does_no_harm(small: Path, parsed: list[str], tmp_path: Path) -> None:
    for name in ("libraries.json", f"parsed-{cache._parser_hash()}.json"):
        (tmp_path / "cache" / name).mkdir(parents=True)
    assert list(find(str(small)).objects) == parsed == ["Lamp/globe-01", "Switch/slider-01"]


@pytest.fixture
def parsed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """Keys of the objects that are parsed in this process, which begins with nothing in its caches."""
    keys: list[str] = []
    parse = loader.parse_object

    def counted(snapshot: Snapshot) -> ObjectModel:
        model = parse(snapshot)
        keys.append(model.key)
        return model

    monkeypatch.setattr(loader, "parse_object", counted)
    monkeypatch.setenv("BUSYBOT_CACHE", str(tmp_path / "cache"))
    forget()
    return keys


def forget() -> None:
    """As a new process does."""
    loader._parse.cache_clear()
    cache._read_parsed.cache_clear()


def test_objects_are_parsed_once_for_all_processes(small: Path, parsed: list[str], tmp_path: Path) -> None:
    library = load_and_remember(small)
    assert parsed == ["Lamp/globe-01", "Switch/slider-01"]
    forget()
    assert load_and_remember(small) == library and len(parsed) == 2
    moved = small.rename(tmp_path / "moved")
    forget()
    again = load_and_remember(moved)
    assert len(parsed) == 2 and again.get("Lamp/globe-01").folder == moved / "Lamp" / "globe-01"


def test_what_changed_is_parsed_anew(small: Path, parsed: list[str]) -> None:
    before = load_and_remember(small).get("Lamp/globe-01")
    file = small / "Lamp" / "globe-01" / "object_meta_info.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"Scale": before.scale / 2}))
    forget()
    assert load_and_remember(small).get("Lamp/globe-01").scale == before.scale / 2
    assert parsed[2:] == ["Lamp/globe-01"]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"a": {"category": "Lamp"}}', "\x00"])
def test_a_damaged_cache_costs_time_only(small: Path, parsed: list[str], tmp_path: Path, text: str) -> None:
    library = load_and_remember(small)
    (file,) = (tmp_path / "cache").glob("parsed-*.json")
    file.write_text(text)
    forget()
    assert load_and_remember(small) == library and len(parsed) == 4
    forget()
    assert load_and_remember(small) == library and len(parsed) == 4, "it was written anew"
