"""What differs between two datasets is said by episode and by kind."""

import shutil
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pytest

from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.diff import diff
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.tables import MADE_OF_KEY, read_shard, write_shard
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Dataset, Dataset]:
    made = make_dataset(tmp_path / "a")
    shutil.copytree(made.path, tmp_path / "b")
    return made, Dataset.open(tmp_path / "b")


def test_a_copy_is_equal_whatever_its_name(pair: tuple[Dataset, Dataset]) -> None:
    file = pair[1].path / "dataset.json"
    file.write_text(file.read_text().replace('"toys"', '"boys"'))
    found = diff(pair[0].path, pair[1].path)
    assert found.equal and not found.settings


def test_each_kind_of_difference_is_listed_with_its_episodes(pair: tuple[Dataset, Dataset]) -> None:
    first, second = pair
    edits = {
        0: {"direction": 17},
        1: {"changed_pixels": 1},
        3: {"trigger_states_after": (1, 0), "joint_positions_after": (0.5, 0.5)},
    }
    for index, values in edits.items():
        episode = make_episode(index)
        episode.steps[4] = replace(episode.steps[4], **values)
        if index == 1:
            episode.images[0].rgb[:30] = 255
            episode.versions = {"busybot": "0.1", "numpy": "2"}
        write_episode(second.episode_path(index), episode)
    write_episode(second.episode_path(2), make_episode(2))
    found = diff(first.path, second.path, workers=2)
    assert not found.equal
    assert (found.only_in_a, found.only_in_b, found.boards) == ([], [2], [])
    assert (found.actions, found.rewards, found.images) == ([0], [1], [1])
    assert (found.states, found.joints) == ([3], [3])
    assert found.versions == {"versions.busybot": [1]}
    assert set(found.episodes) == {0, 1, 3}
    assert (found.episodes[0].action, found.episodes[3].state) == (4, 4)
    assert found.episodes[1].frames[0] == 0 and found.episodes[1].image.colour > 0.1


@pytest.mark.parametrize("told", ["x", "[]", "3", "[" * 100_000])
def test_tables_whose_settings_are_no_settings_are_named(pair: tuple[Dataset, Dataset], told: str) -> None:
    file = pair[1].table_path("episodes", 0)
    rows = read_shard(file, "episodes")
    place, field = rows.schema.get_field_index("settings"), rows.schema.field("settings")
    others = rows.set_column(place, field, pa.array([told] * len(rows), field.type)).replace_schema_metadata(None)
    write_shard(file, "episodes", [others], made_of=rows.schema.metadata[MADE_OF_KEY].decode())
    with pytest.raises(BusybotError, match=r"b/tables/episodes/part-00000.parquet: episode 0: settings is no") as error:
        diff(pair[0].path, pair[1].path)
    assert "repair" in str(error.value.hint)


def test_settings_and_boards_are_compared(tmp_path: Path) -> None:
    first = make_dataset(tmp_path / "a", boards=2, finished=())
    second = make_dataset(tmp_path / "b", boards=3, finished=(), images="png")
    found = diff(first.path, second.path)
    assert found.boards == [2]
    assert found.settings == {"boards": (2, 3), "collect.images": ("jpeg", "png"), "generator.config.boards": (2, 3)}


def test_another_image_format_shows_in_the_images_alone(tmp_path: Path) -> None:
    first, second = (make_dataset(tmp_path / f, images=f).path for f in ("jpeg", "png"))
    found = diff(first, second)
    assert found.images == [0, 1, 3] and not found.actions and not found.states and not found.rewards
