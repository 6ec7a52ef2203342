"""The store of features: computed once, beside the dataset, whole or not at all, and never another episode's."""

import os
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs.feature_store import Features, features_of, store_of, write_table
from busybot.reason.inputs.observation import observe_episode
from busybot.reason.inputs.sequence import sequence_of
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode
from tests.reason.inputs.test_observation import same


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return make_dataset(tmp_path / "toys")


def files_of(features: Features) -> list[Path]:
    return sorted(features.folder.iterdir())


def snapshot(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}


def test_every_episode_has_the_features_of_its_encoder(dataset: Dataset) -> None:
    features = features_of(dataset, workers=1)
    assert list(features) == [0, 1, 3] and features.new == 3
    for index in features:
        episode = read_episode(dataset.episode_path(index))
        np.testing.assert_array_equal(features[index], make_extractor().of_episode(episode))
        assert same(features.sequence(index), sequence_of(observe_episode(episode), features[index]))
    assert isinstance(features[0], np.memmap)


def test_they_lie_beside_the_dataset_and_change_nothing_in_it(dataset: Dataset) -> None:
    before = snapshot(dataset.path)
    features = features_of(dataset, workers=1)
    assert features.folder.parent == dataset.path.with_name("toys.features")
    assert snapshot(dataset.path) == before


def test_what_is_there_is_not_computed_again(dataset: Dataset) -> None:
    features = features_of(dataset, workers=1)
    times = [file.stat().st_mtime_ns for file in files_of(features)]
    again = features_of(dataset, workers=1)
    assert again.new == 0 and [file.stat().st_mtime_ns for file in files_of(again)] == times


def test_a_stopped_computation_goes_on(dataset: Dataset) -> None:
    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        features_of(dataset, workers=1, progress=stop)
    told: list[tuple[int, int]] = []
    assert features_of(dataset, workers=1, progress=lambda *counts: told.append(counts)).new == 1
    assert told == [(1, 1)]


def test_leftovers_of_killed_writers_go(dataset: Dataset) -> None:
    features = features_of(dataset, workers=1)
    leftover = features.folder / f".{files_of(features)[0].name}.999999999.tmp"
    leftover.write_bytes(b"half")
    features_of(dataset, workers=1)
    assert not leftover.exists()


@pytest.mark.parametrize("damage", [b"", b"\x93NUMPY\x01\x00half", None])
def test_a_damaged_file_is_computed_again(dataset: Dataset, damage: bytes | None) -> None:
    features = features_of(dataset, workers=1)
    expected = np.array(features[1])
    file = files_of(features)[1]
    if damage is None:
        file.rename(file.with_name("elsewhere"))
        file.symlink_to("elsewhere")
    else:
        file.write_bytes(damage)
    again = features_of(dataset, workers=1)
    assert again.new == 1 and not file.is_symlink()
    np.testing.assert_array_equal(again[1], expected)


def test_a_file_that_is_damaged_later_is_told(dataset: Dataset) -> None:
    features = features_of(dataset, workers=1)
    files_of(features)[0].write_bytes(b"")
    with pytest.raises(BusybotError, match="000000-"):
        features[0]


def test_an_episode_that_was_recorded_again_gets_new_features(dataset: Dataset) -> None:
    before = features_of(dataset, workers=1)
    names = [file.name for file in files_of(before)]
    write_episode(dataset.episode_path(1), make_episode(1, steps=9))
    dataset.write_tables()
    after = features_of(dataset, workers=1)
    assert after.new == 1 and after[1].shape[0] == 10
    now = [file.name for file in files_of(after)]
    assert len(now) == 3 and set(names) - set(now) == {names[1]}


def test_only_some_episodes_leave_the_others_alone(dataset: Dataset) -> None:
    features_of(dataset, workers=1)
    some = features_of(dataset, episodes=[3], workers=1)
    assert list(some) == [3] and some.new == 0 and len(files_of(some)) == 3
    with pytest.raises(BusybotError, match="board 2 has no episode"):
        features_of(dataset, episodes=[0, 2])


def test_encoders_do_not_share_files(dataset: Dataset) -> None:
    embedded, oracle = features_of(dataset, workers=1), features_of(dataset, "embedded-mask", workers=1)
    assert embedded.folder != oracle.folder and oracle.new == 3
    assert oracle.oracle and not embedded.oracle


def test_a_store_can_be_named(dataset: Dataset, tmp_path: Path) -> None:
    features = features_of(dataset, store=tmp_path / "elsewhere", workers=1)
    assert features.folder.parent == tmp_path / "elsewhere"
    assert not dataset.path.with_name("toys.features").exists()


def test_the_cache_takes_over_where_nothing_can_be_written(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    features = features_of(dataset, workers=1)
    assert features.folder.is_relative_to(os.environ["BUSYBOT_CACHE"]) and features.new == 3
    other = make_dataset(dataset.path.parent / "more" / "toys")
    assert store_of(other) != store_of(dataset), "datasets of one name do not share a store"


def test_a_dataset_without_episodes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BusybotError, match="none of its 4 boards has an episode"):
        features_of(make_dataset(tmp_path / "toys", finished=()))


def test_a_damaged_episode_is_named(dataset: Dataset) -> None:
    path = dataset.episode_path(1)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 255
    path.write_bytes(data)  # of the same size: the tables do not notice
    with pytest.raises(BusybotError, match="000001.mcap"):
        features_of(dataset, workers=1)


def test_an_oracle_names_the_episode_without_segmentation(dataset: Dataset) -> None:
    episode = make_episode(0)
    for image in episode.images:
        image.segmentation = None
    write_episode(dataset.episode_path(0), episode)
    with pytest.raises(BusybotError, match="000000.mcap: .*no segmentation"):
        features_of(dataset, "embedded-mask", workers=1)


@pytest.mark.long
def test_workers_compute_the_same(dataset: Dataset, tmp_path: Path) -> None:
    one, two = (features_of(dataset, store=tmp_path / str(workers), workers=workers) for workers in (1, 2))
    assert snapshot(one.folder) == snapshot(two.folder) and len(files_of(one)) == 3


def test_as_a_table_for_other_programs(dataset: Dataset, tmp_path: Path) -> None:
    features = features_of(dataset, workers=1)
    write_table(tmp_path / "tables" / "features.parquet", features)
    table = pq.read_table(tmp_path / "tables" / "features.parquet")
    assert table.schema.metadata[b"encoder"] == b"embedded"
    rows = table.to_pydict()
    responders = observe_episode(read_episode(dataset.episode_path(1))).responders
    assert len(rows["episode"]) == sum(len(features[i]) * len(responders) for i in features)
    for number in (0, 17, len(rows["episode"]) - 1):
        expected = features[rows["episode"][number]][rows["frame"][number], rows["object"][number]]
        np.testing.assert_array_equal(np.array(rows["feature"][number], np.float16), expected)


def test_what_was_changed_since_is_computed_again(dataset: Dataset) -> None:
    features = features_of(dataset, workers=1)
    [file, *_] = files_of(features)
    told, damaged = features[0].copy(), bytearray(file.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    file.write_bytes(damaged)
    with pytest.raises(BusybotError, match="changed since it was written"):
        features[0]
    again = features_of(dataset, workers=1)
    assert again.new == 1
    np.testing.assert_array_equal(again[0], told)
