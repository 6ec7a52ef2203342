"""What is saved of damaged files is right, what cannot be saved is named, and no only copy is lost."""

import json
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode

from busybot.common.atomic_io import read_regular
from busybot.common.errors import BusybotError
from busybot.common.limits import Budget
from busybot.datasets import repair as module
from busybot.datasets.dataset import Dataset
from busybot.datasets.freeze import freeze
from busybot.datasets.repair import repair
from busybot.datasets.verify import verify
from busybot.episodes.episode import SALVAGED, Episode
from busybot.episodes.mcap import writer
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.records import MAGIC, each_record
from busybot.episodes.mcap.salvage import salvage
from busybot.episodes.mcap.writer import write_episode
from tests.episodes.folders import COLLECT, make_dataset
from tests.episodes.synthetic import make_episode, make_real_episode, make_task_episode
from tests.episodes.tamper import rewrite

SHARES = (0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 0.9999)


def noisy(episode: Episode) -> Episode:
    """Pictures that hardly compress, so that a cut somewhere leaves some of the steps."""
    rng = np.random.default_rng(0)
    episode.images = [replace(image, rgb=rng.integers(0, 256, image.rgb.shape, np.uint8)) for image in episode.images]
    return episode


def assert_beginning_of(part: Episode, whole: Episode, steps: int) -> None:
    assert part.steps == whole.steps[:steps] and part.frame_of == whole.frame_of[: steps + 1]
    assert part.board == whole.board and part.links == whole.links and len(part.goals) == len(whole.goals)
    for mine, theirs in zip(
        [*part.images, *part.goals], [*whole.images[: len(part.images)], *whole.goals], strict=True
    ):
        np.testing.assert_array_equal(mine.rgb, theirs.rgb)
        np.testing.assert_array_equal(mine.boxes, theirs.boxes)
        if theirs.depth is not None:
            np.testing.assert_array_equal(mine.depth, theirs.depth)


@pytest.mark.parametrize("make", [make_episode, make_real_episode, make_task_episode])
@pytest.mark.parametrize("images", ["jpeg", "png"])
def test_of_a_cut_file_all_whole_steps_are_saved(tmp_path: Path, make, images) -> None:
    file = tmp_path / "e.mcap"
    write_episode(file, noisy(make(0, steps=12)), images)
    data, whole = file.read_bytes(), read_episode(file)
    saved = {}
    for share in SHARES:
        try:
            found = salvage(data[: int(share * len(data))])
        except BusybotError as error:
            assert str(error)
            saved[share] = 0
            continue
        file.write_bytes(found.data)
        episode = read_episode(file)
        assert_beginning_of(episode, whole, found.steps)
        assert found.of == 12 and found.whole == (found.steps == 12)
        assert episode.settings.get(SALVAGED) == (None if found.whole else {"of": 12})
        saved[share] = found.steps
    counts = [saved[share] for share in SHARES]
    assert counts == sorted(counts) and counts[-1] == 12
    assert len({count for count in counts if 0 < count < 12}) >= 2, counts


def test_cut_within_the_head_of_a_chunk_all_before_it_is_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer, "CHUNK_BYTES", 40_000)
    file = tmp_path / "e.mcap"
    write_episode(file, noisy(make_episode(0, steps=12)))
    data = file.read_bytes()
    chunks = [place for place, code, _, _ in each_record(data, Budget(), len(MAGIC)) if code == Opcode.CHUNK]
    assert len(chunks) > 2
    saved = [salvage(data[: chunks[-1] + more]).steps for more in (5, 12, 30, 45)]
    assert len(set(saved)) == 1 and saved[0] > 0


def test_without_its_goal_a_task_is_not_saved(tmp_path: Path) -> None:
    """A file is cut before, within and after the goal: what is saved has a whole goal."""
    file = tmp_path / "e.mcap"
    episode = noisy(make_task_episode(steps=2))
    rng = np.random.default_rng(1)
    episode.goals = [replace(goal, rgb=rng.integers(0, 256, goal.rgb.shape, np.uint8)) for goal in episode.goals]
    write_episode(file, episode, "png")
    data, outcomes = file.read_bytes(), set()
    for end in np.linspace(0, len(data), 60).astype(int):
        try:
            file.write_bytes(salvage(data[:end]).data)
        except BusybotError:
            outcomes.add("refused")
        else:
            assert read_episode(file).goal is not None
            outcomes.add("saved")
    assert outcomes == {"refused", "saved"}


def test_a_saved_part_can_be_cut_and_saved_again(tmp_path: Path) -> None:
    file = tmp_path / "e.mcap"
    write_episode(file, noisy(make_episode(steps=12)))
    data = file.read_bytes()
    first = salvage(data[: int(0.8 * len(data))])
    again = salvage(first.data[: int(0.8 * len(first.data))])
    file.write_bytes(again.data)
    assert again.steps < first.steps < 12
    assert read_episode(file).settings[SALVAGED] == {"of": 12}
    odd = noisy(make_episode(steps=12))
    write_episode(file, replace(odd, settings={**odd.settings, SALVAGED: 3}))
    data = file.read_bytes()
    file.write_bytes(salvage(data[: int(0.8 * len(data))]).data)
    assert read_episode(file).settings[SALVAGED] == {"of": 12}, "what somebody else wrote there is no number of steps"


def test_no_flipped_bit_makes_another_recording(tmp_path: Path) -> None:
    """Either all is saved as it was, or nothing: of a damaged chunk nobody can tell what is right."""
    file = tmp_path / "e.mcap"
    write_episode(file, make_episode())
    data, whole = file.read_bytes(), read_episode(file)
    rng = np.random.default_rng(1)
    outcomes = []
    for position in rng.integers(0, len(data), 200):
        damaged = bytearray(data)
        damaged[position] ^= 1 << int(rng.integers(8))
        try:
            found = salvage(bytes(damaged))
            file.write_bytes(found.data)
            episode = read_episode(file)
        except BusybotError:
            outcomes.append(False)
            continue
        outcomes.append(True)
        assert_beginning_of(episode, whole, 6)
    assert 0 < sum(outcomes) < len(outcomes)


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    """Episode 0 is sound, 1 cut at 70 %, 2 cut at its end, 3 a heap of zeros."""
    made = make_dataset(tmp_path / "d", finished=())
    for index in range(4):
        write_episode(made.episode_path(index), noisy(make_episode(index)))
    made.write_tables()
    for index, share in ((1, 0.7), (2, 0.999)):
        data = made.episode_path(index).read_bytes()
        made.episode_path(index).write_bytes(data[: int(share * len(data))])
    made.episode_path(3).write_bytes(bytes(5000))
    return made


def test_in_place_originals_are_kept_and_the_rest_is_sound(dataset: Dataset) -> None:
    before = {file.name: file.read_bytes() for file in (dataset.path / "episodes").iterdir()}
    (dataset.path / "tables/objects/part-00000.parquet").write_bytes(b"x")
    done = repair(dataset.path)
    assert (done.sound, [(v.episode, v.fate) for v in done.damaged]) == (
        1,
        [(1, "partial"), (2, "whole"), (3, "dropped")],
    )
    assert all(verdict.why for verdict in done.damaged)
    partial = done.damaged[0]
    assert 0 < partial.steps < partial.of == 6
    kept = {file.name: file.read_bytes() for file in (dataset.path / "damaged").iterdir()}
    assert kept == {name: before[name] for name in ("000001.mcap", "000002.mcap", "000003.mcap")}
    assert dataset.finished() == {0, 1, 2} and verify(dataset.path).ok
    assert dataset.episode_path(0).read_bytes() == before["000000.mcap"]
    again = repair(dataset.path)
    assert (again.sound, again.damaged) == (3, ())
    Dataset.open(dataset.path).begin_collecting(COLLECT)  # collecting can continue


def test_elsewhere_the_damaged_dataset_stays_as_it_is(dataset: Dataset, tmp_path: Path) -> None:
    before = {file: file.read_bytes() for file in dataset.path.rglob("*") if file.is_file()}
    done = repair(dataset.path, tmp_path / "out")
    assert [v.fate for v in done.damaged] == ["partial", "whole", "dropped"]
    assert {file: file.read_bytes() for file in dataset.path.rglob("*") if file.is_file()} == before
    out = Dataset.open(tmp_path / "out")
    assert out.info == dataset.info and out.finished() == {0, 1, 2} and verify(out.path).ok
    assert repair(dataset.path, tmp_path / "out") == done, "again, nothing else happens"
    make_dataset(tmp_path / "other", boards=2, finished=())
    for place in (tmp_path / "other", dataset.path, dataset.path / "within"):
        with pytest.raises(BusybotError, match="another dataset|itself"):
            repair(dataset.path, place)


def test_elsewhere_what_was_collected_since_stays(dataset: Dataset, tmp_path: Path) -> None:
    """What is there is not written again, either: a repetition continues."""
    repair(dataset.path, tmp_path / "out")
    out = Dataset.open(tmp_path / "out")
    for index in (1, 3):
        write_episode(out.episode_path(index), noisy(make_episode(index)))
    files = sorted((out.path / "episodes").iterdir())
    before = [(file.name, file.read_bytes(), file.stat().st_ino) for file in files]
    done = repair(dataset.path, out.path)
    assert [(v.episode, v.fate) for v in done.damaged] == [(1, "there"), (2, "whole"), (3, "there")]
    files = sorted((out.path / "episodes").iterdir())
    assert [(file.name, file.read_bytes(), file.stat().st_ino) for file in files] == before
    assert verify(out.path).ok and len(out.table("episodes")) == 4 and not (out.path / "damaged").exists()


def test_elsewhere_what_is_replaced_or_removed_is_kept(dataset: Dataset, tmp_path: Path) -> None:
    repair(dataset.path, tmp_path / "out")
    out = Dataset.open(tmp_path / "out")
    write_episode(out.episode_path(3), noisy(make_episode(3)))
    for index in (0, 3):
        data = out.episode_path(index).read_bytes()
        out.episode_path(index).write_bytes(data[: int(0.7 * len(data))])
    before = {index: out.episode_path(index).read_bytes() for index in (0, 1, 3)}
    assert [v.fate for v in repair(dataset.path, out.path, keep_partial=False).damaged] == [
        "dropped",
        "whole",
        "dropped",
    ]
    assert {int(file.stem): file.read_bytes() for file in (out.path / "damaged").iterdir()} == before
    assert out.finished() == {0, 2} and verify(out.path).ok
    write_episode(dataset.episode_path(1), noisy(make_episode(1)))
    out.episode_path(1).write_bytes(before[1])
    assert repair(dataset.path, out.path).sound == 2 and verify(out.path).ok
    assert out.episode_path(1).read_bytes() == dataset.episode_path(1).read_bytes(), "a whole one is better than a part"


def test_a_file_of_any_size_is_kept_without_being_in_memory(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    huge = b"x" * 5_000_000
    dataset.episode_path(1).write_bytes(huge)
    read: list[int] = []

    def reading(path: Path, most: int, *hint: str) -> bytes:
        read.append(most)
        return read_regular(path, most, *hint)

    monkeypatch.setattr(module, "MAX_RECORDING_BYTES", 4_000_000)
    monkeypatch.setattr(module, "read_regular", reading)
    assert repair(dataset.path).damaged[0].fate == "dropped"
    assert (dataset.path / "damaged/000001.mcap").read_bytes() == huge and max(read) == 4_000_000


def test_parts_can_be_dropped_so_that_they_are_recorded_again(dataset: Dataset) -> None:
    done = repair(dataset.path, keep_partial=False)
    assert [v.fate for v in done.damaged] == ["dropped", "whole", "dropped"]
    assert dataset.finished() == {0, 2} and verify(dataset.path).ok
    write_episode(dataset.episode_path(1), noisy(make_episode(1)))
    data = dataset.episode_path(1).read_bytes()
    dataset.episode_path(1).write_bytes(data[: int(0.7 * len(data))])
    assert repair(dataset.path).damaged[0].fate == "partial"
    assert [v.fate for v in repair(dataset.path, keep_partial=False).damaged] == ["dropped"], "also those kept before"
    assert {file.name for file in (dataset.path / "damaged").iterdir()} >= {"000001.mcap", "000001.mcap.1"}


def test_what_contradicts_the_tables_is_not_kept(dataset: Dataset) -> None:
    other = noisy(make_episode(1))
    other.steps[0] = replace(other.steps[0], direction=(other.steps[0].direction + 1) % 18)
    for share in (0.7, 0.999):
        write_episode(dataset.episode_path(1), other)
        data = dataset.episode_path(1).read_bytes()
        dataset.episode_path(1).write_bytes(data[: int(share * len(data))])
        verdict = repair(dataset.path, dataset.path.with_name(f"out{share}")).damaged[0]
        assert verdict.fate == "dropped" and "tables" in verdict.why


def with_depth_scale(data: bytes, was: bytes, now: bytes) -> bytes:
    """The file with another value in its metadata, which have no checksum of their own."""
    key = b"depth_scale" + struct.pack("<I", len(was))
    assert data.count(key + was) == 1 and len(was) == len(now)
    return data.replace(key + was, key + now)


@pytest.mark.parametrize("share", [0.7, 1.0])
@pytest.mark.parametrize("tables", [True, False])
def test_a_damaged_scale_of_depth_is_not_taken_for_right(dataset: Dataset, share: float, tables: bool) -> None:
    write_episode(dataset.episode_path(1), noisy(make_episode(1)))
    data = with_depth_scale(dataset.episode_path(1).read_bytes(), b"4e-05", b"5e-05")
    dataset.episode_path(1).write_bytes(data[: int(share * len(data))])
    if not tables:
        shutil.rmtree(dataset.path / "tables")
    verdict = repair(dataset.path).damaged[0]
    assert (verdict.episode, verdict.fate) == (1, "dropped") and ("scale of depth" in verdict.why or tables)
    assert (dataset.path / "damaged/000001.mcap").read_bytes() == data[: int(share * len(data))]


def test_an_unusual_scale_of_depth_is_believed_where_a_checksum_or_the_tables_confirm_it(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "far", boards=2, finished=())
    far = noisy(make_episode(1))
    far.images = [replace(image, depth=None if image.depth is None else image.depth * 5) for image in far.images]
    write_episode(dataset.episode_path(1), far)
    data = dataset.episode_path(1).read_bytes()
    assert salvage(data[:-40]).certain and not salvage(data[: int(0.7 * len(data))]).certain
    dataset.write_tables()
    end = next(position for position, opcode, _, _ in each_record(data, Budget(), 8) if opcode == Opcode.DATA_END)
    assert not salvage(data[:end]).certain
    dataset.episode_path(1).write_bytes(data[:end])
    assert repair(dataset.path).damaged[0].fate == "whole"
    np.testing.assert_allclose(dataset[1].depth[0], far.images[0].depth, atol=1e-3)


def test_episodes_of_another_board_are_dropped(dataset: Dataset) -> None:
    shutil.copy(dataset.episode_path(0), dataset.episode_path(1))
    verdict = repair(dataset.path).damaged[0]
    assert (verdict.fate, verdict.why) == ("dropped", "its board is not board 1 of the dataset")


def test_a_part_must_say_how_long_the_whole_was(dataset: Dataset) -> None:
    repair(dataset.path)

    def lie(name: str, data: bytes) -> bytes:
        values = json.loads(data)
        if "settings" in values:
            values["settings"][SALVAGED] = {"of": 99}
        return json.dumps(values).encode()

    rewrite(dataset.episode_path(1), attachment=lie)
    assert any("steps, the dataset says 6" in problem.what for problem in verify(dataset.path).problems)


def test_a_frozen_dataset_is_repaired_elsewhere(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "d", boards=2, finished=range(2))
    freeze(dataset.path, None)
    with pytest.raises(BusybotError, match="frozen") as error:
        repair(dataset.path)
    assert "--out" in str(error.value.hint)
    assert repair(dataset.path, tmp_path / "out").sound == 2
    assert Dataset.open(tmp_path / "out").hashes() == dataset.hashes()


def test_elsewhere_it_has_the_objects_that_the_damaged_dataset_carries(tmp_path: Path) -> None:
    tiny = Path(__file__).resolve().parents[2] / "datasets" / "tiny"
    shutil.copytree(tiny, tmp_path / "d", copy_function=shutil.copyfile)
    carried = {file.relative_to(tiny): file.read_bytes() for file in (tiny / "objects").rglob("*") if file.is_file()}
    assert carried
    for _ in range(2):  # a repetition finds them there
        repair(tmp_path / "d", tmp_path / "out")
        assert {name: (tmp_path / "out" / name).read_bytes() for name in carried} == carried
    file = next((tmp_path / "d" / "objects").rglob("*.urdf"))
    file.write_bytes(file.read_bytes()[:99])
    repair(tmp_path / "d", tmp_path / "without")
    assert not (tmp_path / "without" / "objects").exists(), "those of the hashes are looked for elsewhere"


def test_links_are_refused(dataset: Dataset, tmp_path: Path) -> None:
    shutil.move(dataset.episode_path(1), tmp_path / "outside")
    (dataset.path / "episodes/000001.mcap").symlink_to(tmp_path / "outside")
    with pytest.raises(BusybotError, match="link"):
        repair(dataset.path)
    assert (tmp_path / "outside").exists() and not (dataset.path / "damaged").exists()


@pytest.mark.parametrize("moment", range(5))
def test_stopped_at_any_moment_it_ends_the_same(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: int
) -> None:
    shutil.copytree(dataset.path, tmp_path / "whole")
    repair(tmp_path / "whole")
    written = 0

    def stop(path: Path, data: bytes, root: Path) -> None:
        nonlocal written
        written += 1
        if written > moment:
            raise KeyboardInterrupt
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)

    with monkeypatch.context() as patched:
        patched.setattr(module, "write_atomically", stop)
        patched.setattr(module, "copy_file", lambda source, path, root: stop(path, source.read_bytes(), root))
        with pytest.raises(KeyboardInterrupt):
            repair(dataset.path)
    repair(dataset.path)

    def files(path: Path) -> dict[str, bytes]:
        return {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}

    assert files(dataset.path) == files(tmp_path / "whole")


@pytest.mark.parametrize("lack", [MemoryError(), zstandard.ZstdError("decompression error: Allocation error : full")])
def test_too_little_memory_is_no_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lack: Exception) -> None:
    """A larger machine reads the file; nothing is saved of it, and nothing dropped."""
    dataset = make_dataset(tmp_path / "data", 1, (0,))
    file = dataset.episode_path(0)
    before = file.read_bytes()

    class Starved:
        def __init__(self, **_: object):
            pass

        def decompress(self, *_: object, **__: object) -> bytes:
            raise lack

    monkeypatch.setattr(zstandard, "ZstdDecompressor", Starved)
    for work in (lambda: read_episode(file), lambda: salvage(before)):
        with pytest.raises(MemoryError):
            work()
    with pytest.raises((MemoryError, BusybotError), match=r"000000\.mcap") as told:
        repair(dataset.path, workers=1)
    assert "memory" in str(told.value) or isinstance(told.value, MemoryError)
    assert file.read_bytes() == before and not (dataset.path / "damaged").exists()
