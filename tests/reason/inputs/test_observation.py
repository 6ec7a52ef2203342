"""What a reasoner sees: the whitelist, whatever the truth says, and the trigger that an action took hold of."""

from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.codec import LazyImages
from busybot.episodes.episode import Episode, Image, Link
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.schema import UNKNOWN_PIXEL
from busybot.reason.inputs.observation import (
    ObservedEpisode,
    acted_objects,
    actions_of,
    goal_of,
    observe_episode,
    pushes_of,
)
from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.registry import infer
from tests.episodes.synthetic import make_episode, make_task_episode
from tests.reason.scenes import Scene

VISIBLE_IN_A_STEP = {"pixel", "position", "direction"}


def garbled(episode: Episode) -> Episode:
    """The same recording with everything wrong that a reasoner must not read."""
    rng = np.random.default_rng(7)
    objects = len(episode.board.objects)

    def states() -> tuple[int, ...]:
        return tuple(int(state) for state in rng.integers(0, 3, objects))

    def image(number: int, original: Image) -> Image:
        boxes = original.boxes if number == 0 else rng.integers(0, 100, original.boxes.shape).astype(np.int16)
        segmentation = rng.integers(0, 9, original.rgb.shape[:2]).astype(np.uint16)
        return Image(original.rgb, original.depth, segmentation, boxes)

    changed = [before != after for before, after in pairwise(episode.frame_of)]  # then the last direction is seen
    steps = [
        replace(
            step,
            executed=(3, 3, step.executed[-1]) if seen else (3,),
            distance=9.0,
            changed_pixels=int(rng.integers(9999)),
            reward=1 - step.reward,
            acted_object=int(rng.integers(-1, objects)),
            acted_link="other",
            trigger_states_before=states(),
            trigger_states_after=states(),
            responder_states_before=states(),
            responder_states_after=states(),
            joint_positions_before=tuple(rng.random(objects)),
            joint_positions_after=tuple(rng.random(objects)),
            memory_after=(7, *states()),
            success=not step.success,
            vetoed=not step.vetoed,
        )
        for step, seen in zip(episode.steps, changed, strict=True)
    ]
    placed = tuple(
        replacement.model_copy(
            update={"position": (0.0, 0.0, 0.0), "yaw": 1.0, "scale": 9.0, "states": (1, 0), "key": "X/y"}
        )
        for replacement in episode.board.objects
    )
    board = episode.board.model_copy(update={"relations": (), "objects": placed, "seed": 99, "texture": "slate"})
    if board.task is not None:
        board = board.model_copy(update={"task": board.task.model_copy(update={"goal": (0, 0)})})
    return replace(
        episode,
        board=board,
        links=tuple(Link(0, "other", False) for _ in episode.links),
        images=[image(number, original) for number, original in enumerate(episode.images)],
        goals=[image(1, original) for original in episode.goals],
        steps=steps,
        policy="scripted",
        oracle=True,
        settings={},
        renderer={},
        versions={},
    )


def same(one: object, other: object) -> bool:
    """Equal down to the last array."""
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, list | tuple):
        return isinstance(other, list | tuple) and len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, BoardSequence) and isinstance(other, BoardSequence):
        return all(map(same, one.arrays.values(), other.arrays.values())) and same(one.links, other.links)
    if hasattr(one, "__dataclass_fields__"):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))  # type: ignore[arg-type]
    return one == other


def test_garbling_the_truth_changes_nothing_that_a_reasoner_sees() -> None:
    episode = make_episode(steps=12)
    wrong = garbled(episode)
    assert same(observe_episode(episode), observe_episode(wrong))
    np.testing.assert_array_equal(infer(episode).probabilities, infer(wrong).probabilities)


@pytest.mark.parametrize(
    ("about", "world"),
    [
        ({}, "gates"),
        ({"split": "novel-object"}, "gates"),
        ({"split": "imported"}, ""),
        ({"relations_known": False}, ""),
    ],
)
def test_of_boards_that_nobody_drew_no_world_is_told(about: dict[str, object], world: str) -> None:
    episode = make_episode(steps=1)
    board = episode.board.model_copy(update={"world": "gates", **about})
    assert observe_episode(replace(episode, board=board)).world == world


def test_the_direction_that_was_tried_last_is_seen_where_the_picture_changed() -> None:
    episode = make_episode(steps=12)
    tried = replace(episode, steps=[replace(step, direction=0, executed=(0, 5)) for step in episode.steps])
    changed = [before != after for before, after in pairwise(episode.frame_of)]
    observed = observe_episode(tried)
    assert any(changed) and not all(changed)
    pushes, actions = pushes_of(observed), actions_of(observed)
    for row, seen in enumerate(changed):
        np.testing.assert_allclose(pushes[row, 3:], DIRECTIONS[5 if seen else 0], atol=1e-6)
        np.testing.assert_allclose(actions[row, 3:], DIRECTIONS[0], atol=1e-6)
    assert np.array_equal(pushes[:, :3], actions[:, :3])


def test_of_a_goal_its_picture_alone_is_seen() -> None:
    episode = make_task_episode(steps=3)
    assert same(goal_of(episode), goal_of(garbled(episode))) and same(
        observe_episode(episode), observe_episode(garbled(episode))
    )
    assert {f.name for f in fields(goal_of(episode))} == {"rgb", "depth"}  # type: ignore[arg-type]
    assert goal_of(make_episode()) is None


@pytest.mark.parametrize("decoding", ["eager", "lazy"])
def test_a_goal_on_disk_shows_the_same(tmp_path: Path, decoding: str) -> None:
    episode = make_task_episode(steps=2)
    write_episode(tmp_path / "e.mcap", episode, "png")
    goal = goal_of(read_episode(tmp_path / "e.mcap", decoding))  # type: ignore[arg-type]
    assert goal is not None and episode.goal is not None
    np.testing.assert_array_equal(goal.rgb, episode.goal.rgb)
    np.testing.assert_allclose(goal.depth, episode.goal.depth, atol=2.1e-5)


def test_the_comparison_above_can_fail() -> None:
    episode = make_episode(steps=3)
    moved = [replace(episode.steps[0], pixel=(1, 1)), *episode.steps[1:]]
    assert not same(observe_episode(episode), observe_episode(replace(episode, steps=moved)))


def test_every_field_of_a_step_is_either_seen_or_garbled() -> None:
    """A new field of `Step` must be put on one side or the other."""
    episode = make_episode(steps=3)
    before, after = episode.steps[0], garbled(episode).steps[0]
    unchanged = {f.name for f in fields(before) if getattr(before, f.name) == getattr(after, f.name)}
    assert unchanged == VISIBLE_IN_A_STEP


@pytest.mark.parametrize("decoding", ["eager", "lazy"])
def test_a_recording_on_disk_shows_the_same(tmp_path: Path, decoding: str) -> None:
    episode = make_episode(steps=6)
    path = tmp_path / "e.mcap"
    write_episode(path, episode, "png")
    read = observe_episode(read_episode(path, decoding))  # type: ignore[arg-type]
    assert all(image.segmentation is None and not len(image.boxes) for image in read.images)
    assert read.roles == observe_episode(episode).roles
    np.testing.assert_array_equal(read.boxes, episode.images[0].boxes)
    np.testing.assert_array_equal(read.frame(6).rgb, episode.image(6).rgb)
    np.testing.assert_allclose(infer(read).probabilities, infer(episode).probabilities)


def test_the_first_images_leave_out_what_comes_later() -> None:
    observed = observe_episode(make_episode(steps=6)).first(3)
    assert (len(observed.actions), len(observed.image_of)) == (2, 3)
    assert len(observe_episode(make_episode(steps=2)).first(23).actions) == 2


def test_candidates_go_from_triggers_to_responders() -> None:
    observed = observe_episode(make_episode())
    rows, columns = np.nonzero(observed.candidates)
    assert {(int(i), int(j)) for i, j in zip(rows, columns, strict=True)} == {(i, j) for i in (0, 3) for j in (1, 2, 4)}


def acted(boxes: list[tuple[int, int, int, int]], pixel: tuple[int, int], roles: str = "tttr") -> int:
    names = tuple({"t": "trigger", "r": "responder"}[role] for role in roles[: len(boxes)])
    observed: ObservedEpisode = Scene(names, boxes, [[], []], [pixel]).observed()
    return int(acted_objects(observed)[0])


def test_the_box_that_holds_the_pixel_was_acted_on() -> None:
    assert acted([(0, 0, 20, 20), (40, 0, 60, 20)], (45, 5)) == 1


def test_a_box_ends_before_its_last_coordinate() -> None:
    assert acted([(0, 0, 20, 20), (20, 0, 40, 20)], (20, 5)) == 1


def test_of_two_boxes_the_smaller_was_acted_on() -> None:
    assert acted([(0, 0, 60, 60), (10, 10, 30, 30)], (15, 15)) == 1


def test_of_two_equal_boxes_the_one_with_the_nearer_centre_was_acted_on() -> None:
    assert acted([(0, 0, 40, 40), (10, 0, 50, 40)], (35, 20)) == 1


def test_a_lever_that_sticks_out_of_its_box_still_belongs_to_it() -> None:
    assert acted([(0, 0, 20, 20), (60, 0, 80, 20)], (25, 10)) == 0


def test_far_from_all_triggers_nothing_was_acted_on() -> None:
    assert acted([(0, 0, 20, 20)], (100, 100)) == -1


def test_responders_and_unseen_triggers_are_not_acted_on() -> None:
    assert acted([(-1, -1, -1, -1), (60, 60, 80, 80)], (70, 70), roles="tr") == -1


def test_what_was_not_chosen_in_a_picture_took_hold_of_nothing_that_boxes_tell() -> None:
    """Not of what shows in the corner of the picture, either."""
    assert acted([(0, 0, 20, 20)], (0, 0)) == 0 and acted([(0, 0, 20, 20)], UNKNOWN_PIXEL) == -1


def test_what_is_looked_at_again_is_decoded_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded = make_episode()
    write_episode(tmp_path / "e.mcap", recorded)
    episode = read_episode(tmp_path / "e.mcap", "lazy")
    frames = range(len(episode.frame_of))
    once, twice = observe_episode(episode), observe_episode(episode, again=True)
    assert len(set(once.image_of)) > 2  # more than are kept of what is looked at in order
    shown = [[observed.frame(k).rgb for k in (*frames, *frames)] for observed in (once, twice)]
    assert all(np.array_equal(one, other) for one, other in zip(*shown, strict=True))
    first, again = shown[1][: len(frames)], shown[1][len(frames) :]
    assert all(one is other for one, other in zip(first, again, strict=True))
    assert shown[0][0] is not shown[0][len(frames)]
    monkeypatch.setattr("busybot.reason.inputs.observation.KEPT", 0)
    small = observe_episode(episode, again=True)
    assert small.frame(0).rgb is small.frame(0).rgb and isinstance(small.images, LazyImages) and small.images.keeps == 2
