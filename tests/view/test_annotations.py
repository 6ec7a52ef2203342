"""What pictures say about an episode: names, changes, verdicts."""

from dataclasses import replace

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.reason.models.base import InferredGraph
from busybot.view.annotations import (
    acted_object,
    anchors,
    changed_objects,
    check_inferred,
    delta,
    judged_edges,
    object_names,
    pairs_ever,
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
