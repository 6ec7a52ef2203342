"""What pictures say about an episode: names, changes, verdicts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from busybot.boards.spec import IMPORTED
from busybot.common.errors import BusybotError
from busybot.episodes.mcap.reader import read_episode
from busybot.reason.models.base import InferredGraph
from busybot.sim.scene.real_camera import REAL, CameraConfig, take_photo
from busybot.view.annotations import (
    acted_object,
    anchors,
    board_bounds,
    changed_objects,
    check_inferred,
    delta,
    judged_edges,
    object_names,
    pairs_ever,
    rewards_known,
    true_edges,
)
from tests.episodes.synthetic import DELTA, make_episode, make_real_episode


def graph(*edges: tuple[int, int, float], objects: int = 5, steps: int = 1) -> InferredGraph:
    probabilities = np.zeros((steps, objects, objects))
    for cause, effect, probability in edges:
        probabilities[-1, cause, effect] = probability
    return InferredGraph("guess", probabilities)


def test_objects_are_named_by_category_and_index() -> None:
    assert object_names(make_episode().board) == ["switch 0", "lamp 1", "door 2", "switch 3", "toy 4"]


@pytest.mark.parametrize("segmented", [True, False])
def test_changed_objects_are_the_trigger_and_what_it_drives(segmented: bool) -> None:
    episode = make_episode(steps=6)
    if not segmented:
        episode.images = [replace(image, segmentation=None) for image in episode.images]
    drives = {0: {0, 1}, 3: {3, 2}, -1: set()}
    for index, step in enumerate(episode.steps):
        assert set(changed_objects(episode, index)) == drives[step.acted_object]


def test_image_encoding_is_no_change() -> None:
    episode = make_episode(steps=3)
    noise = np.random.default_rng(0).integers(-6, 7, episode.images[0].rgb.shape)
    noisy = np.clip(episode.images[0].rgb + noise, 0, 255).astype(np.uint8)
    episode.images.append(replace(episode.images[0], rgb=noisy))
    episode.frame_of = [0, len(episode.images) - 1, 0, 0]
    assert changed_objects(episode, 0) == []


def test_what_a_real_camera_adds_is_no_change() -> None:
    """Every photo has noise, shakes, and hangs in another light."""
    episode = read_episode(Path(__file__).parents[2] / "datasets" / "tiny" / "episodes" / "000003.mcap", "eager")
    photos = [
        take_photo(episode.images[number], CameraConfig(**REAL), (0, "train", 3), frame)
        for frame, number in enumerate(episode.frame_of)
    ]
    real = replace(episode, images=photos, frame_of=list(range(len(photos))))
    true = [set(changed_objects(episode, step)) for step in range(len(episode.steps))]
    seen = [set(changed_objects(real, step)) for step in range(len(episode.steps))]
    responders = {index for index, one in enumerate(episode.board.objects) if one.role == "responder"}
    wrong = [one ^ other for one, other in zip(true, seen, strict=True)]
    assert sum(map(len, true)) == 26 and sum(map(len, wrong)) <= 10, "small switches, and a hand"
    assert sum(len(one & responders) for one in wrong) <= 2


def test_boxes_of_the_first_image_serve_where_they_are_all_that_is_known() -> None:
    """As in what was imported, where nobody counted changed pixels, nor knows where in the picture a board ends."""
    episode = make_episode(steps=6)
    first, *others = episode.images
    bare = [replace(one, segmentation=None, boxes=np.full_like(one.boxes, -1)) for one in others]
    facts = {IMPORTED: {"camera": "image"}}
    known = replace(episode, images=[replace(first, segmentation=None), *bare], settings=facts)
    for step in range(len(episode.steps)):
        assert set(changed_objects(known, step)) == set(changed_objects(episode, step))
        assert acted_object(known, step) == acted_object(episode, step)
    assert rewards_known(episode) and not rewards_known(known)
    low, high = board_bounds(known, 0)
    assert [*low, *high] == [0, 0, episode.camera.width, episode.camera.height]
    assert (board_bounds(episode, 0)[0] > 0).any()


def test_the_acted_object_is_the_one_whose_box_holds_the_pixel() -> None:
    episode = make_episode(steps=4)
    for index, step in enumerate(episode.steps):
        if step.acted_object >= 0:
            assert acted_object(episode, index) == step.acted_object
    episode.steps[0] = replace(episode.steps[0], pixel=(0, 0))
    assert acted_object(episode, 0) == -1


def test_edges_are_right_wrong_or_missed() -> None:
    board = make_episode().board
    assert [(edge.cause, edge.effect) for edge in true_edges(board)] == [(0, 1), (3, 2)]
    verdicts = {(e.cause, e.effect): e.verdict for e in judged_edges(board, graph((0, 1, 0.9), (0, 4, 0.6)), 1)}
    assert verdicts == {(0, 1): "correct", (0, 4): "wrong", (3, 2): "missed"}


def test_an_edge_that_was_claimed_before_the_first_step_alone_has_a_place() -> None:
    board, prior = make_episode().board, np.zeros((5, 5))
    prior[0, 4] = 0.9
    guess = replace(graph((0, 1, 0.9)), prior=prior)
    edges = {(edge.cause, edge.effect) for steps in range(6) for edge in judged_edges(board, guess, steps)}
    assert (0, 4) in edges
    assert set(pairs_ever(board, guess)) == edges


def test_beliefs_start_at_nothing_and_stay_after_the_last_step() -> None:
    guess = graph((0, 1, 0.9), steps=2)
    assert guess.after(0).max() == 0
    assert guess.after(1)[0, 1] == 0
    assert guess.after(2)[0, 1] == guess.after(30)[0, 1] == 0.9


@pytest.mark.parametrize(
    "wrong", [graph(objects=4), InferredGraph("flat", np.zeros((5, 5))), graph((0, 1, np.nan))], ids=str
)
def test_an_inference_about_another_board_is_refused(wrong: InferredGraph) -> None:
    with pytest.raises(BusybotError, match="inferred graph"):
        check_inferred(make_episode(), wrong)


def test_delta_is_read_wherever_the_recorder_wrote_it() -> None:
    episode = make_episode()
    assert delta(episode) == DELTA
    episode.settings = {"seed": 0, "interaction": {"delta": 777}}
    assert delta(episode) == 777
    assert delta(make_real_episode()) > 0


def test_objects_without_boxes_stand_where_the_board_has_them() -> None:
    boxed, real = make_episode(), make_real_episode()
    assert np.isfinite(anchors(real)).all()
    np.testing.assert_allclose(anchors(real), anchors(boxed), atol=2)
