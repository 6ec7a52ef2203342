"""Three hashes: what they see and what they do not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from busybot.episodes.digests import Digests, combine, episode_digests
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from tests.episodes.synthetic import make_episode, make_real_episode, make_task_episode


def digests(episode: Episode, path: Path, images: str = "png") -> Digests:
    write_episode(path, episode, images)
    return episode_digests(read_episode(path))


def test_equal_episodes_have_equal_digests_whatever_the_file_is_called(tmp_path: Path) -> None:
    assert digests(make_episode(), tmp_path / "a.mcap") == digests(make_episode(), tmp_path / "folder" / "b.mcap")


def test_lazy_and_eager_reading_give_the_same(tmp_path: Path) -> None:
    expected = digests(make_episode(), tmp_path / "a.mcap")
    assert episode_digests(read_episode(tmp_path / "a.mcap", images="lazy")) == expected


def test_the_image_format_touches_the_content_alone(tmp_path: Path) -> None:
    png, jpeg = (digests(make_episode(), tmp_path / "a.mcap", images) for images in ("png", "jpeg"))
    assert (png.board, png.trace) == (jpeg.board, jpeg.trace)
    assert png.content != jpeg.content


@pytest.mark.parametrize(
    "change",
    [
        lambda e: replace(e, versions={"busybot": "99"}),
        lambda e: replace(e, renderer={"device": "another"}),
        lambda e: replace(e, settings={}),
        lambda e: replace(e, policy="another"),
    ],
)
def test_versions_and_hosts_do_not_matter(tmp_path: Path, change: Callable[[Episode], Episode]) -> None:
    expected = digests(make_episode(), tmp_path / "a.mcap")
    assert digests(change(make_episode()), tmp_path / "a.mcap") == expected


def first_step(**values: object) -> Callable[[Episode], Episode]:
    return lambda e: replace(e, steps=[replace(e.steps[0], **values), *e.steps[1:]])


@pytest.mark.parametrize(
    ("change", "seen_by_trace"),
    [
        (first_step(direction=0, executed=(0,)), True),
        (first_step(pixel=(1, 2)), True),
        (first_step(position=(0.5, 0.5, 0.5)), True),
        (first_step(acted_link="link_9"), True),
        (first_step(success=False), True),
        (first_step(trigger_states_before=(7, 7)), True),
        (first_step(changed_pixels=12345), False),
        (first_step(joint_positions_after=(0.1, 0.11)), False),
        (lambda e: replace(e, positions=e.positions + np.float32(0.1)), False),
    ],
)
def test_what_the_digests_see(tmp_path: Path, change: Callable[[Episode], Episode], seen_by_trace: bool) -> None:
    before, after = digests(make_episode(), tmp_path / "a.mcap"), digests(change(make_episode()), tmp_path / "b.mcap")
    assert (before.trace != after.trace) == seen_by_trace
    assert before.content != after.content
    assert before.board == after.board


@pytest.mark.parametrize("name", ["rgb", "depth", "segmentation"])
def test_one_pixel_changes_the_content(tmp_path: Path, name: str) -> None:
    episode = make_episode()
    before = digests(episode, tmp_path / "a.mcap")
    pixels = getattr(episode.images[-1], name)
    pixels[20, 20] = 1 if name != "depth" else 3.0
    after = digests(episode, tmp_path / "a.mcap")
    assert after.content != before.content and after.trace == before.trace


def test_a_goal_counts_as_content(tmp_path: Path) -> None:
    episode = make_task_episode()
    whole = digests(episode, tmp_path / "a.mcap")
    without = digests(replace(episode, goals=[]), tmp_path / "a.mcap")
    assert episode.goal is not None
    episode.goal.rgb[20, 20] = 1
    other = digests(episode, tmp_path / "a.mcap")
    assert len({whole.content, without.content, other.content}) == 3
    assert whole.trace == without.trace == other.trace and whole.board == other.board
    assert whole.board != digests(make_episode(), tmp_path / "a.mcap").board


def test_missing_images_have_a_digest_of_their_own(tmp_path: Path) -> None:
    assert digests(make_real_episode(), tmp_path / "a.mcap").content


def test_a_dataset_is_ordered_by_index_not_by_arrival() -> None:
    assert combine("trace", [(1, "b"), (0, "a")]) == combine("trace", [(0, "a"), (1, "b")])
    assert combine("trace", [(0, "b"), (1, "a")]) != combine("trace", [(0, "a"), (1, "b")])
    assert combine("trace", [(0, "a")]) != combine("trace", [(1, "a")])
    assert combine("trace", []) != combine("content", [])
