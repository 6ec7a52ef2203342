"""Disturbances of recordings: what is disturbed and what is not; and the figure of their results."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from benchmarks.studies.disturbances import DISTURBANCES, DisturbedBoard, noisy, recording_of
from benchmarks.studies.reason_robustness import f1, main
from busybot.episodes.episode import Episode, Link
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.evaluation.ground_truth import NOTHING_HELD
from busybot.reason.inputs.observation import acted_objects
from busybot.view.figures.curves import robustness_figure
from tests.episodes.synthetic import make_episode, make_real_episode


def with_bodies(episode: Episode) -> Episode:
    """The lower half of every trigger does not move."""
    links = (*episode.links, Link(0, "body", False), Link(3, "body", False))
    for image in episode.images:
        assert image.segmentation is not None
        for number, code in ((0, 6), (3, 7)):
            v0, v1 = int(image.boxes[number][1]), int(image.boxes[number][3])
            lower = image.segmentation[(v0 + v1) // 2 : v1]
            lower[lower == number + 1] = code
    return replace(episode, links=links)


RECORDING = recording_of(with_bodies(make_episode(steps=12)))


def disturbed(name: str, strength: float, seed: int = 0) -> DisturbedBoard:
    apply = DISTURBANCES[name].apply
    assert apply is not None
    return apply(RECORDING, strength, np.random.default_rng(seed))


def pictures(recording: DisturbedBoard) -> np.ndarray:
    return np.stack([recording.observed.frame(number).rgb for number in range(13)])


def changed_frames(recording: DisturbedBoard) -> np.ndarray:
    return np.asarray((pictures(recording) != pictures(RECORDING)).any(axis=(1, 2, 3)))


APPLIED = [name for name, one in DISTURBANCES.items() if one.apply is not None]


@pytest.mark.parametrize("name", APPLIED)
def test_equal_generators_disturb_alike_and_leave_the_recording_alone(name: str) -> None:
    before, boxes = pictures(RECORDING), RECORDING.observed.boxes.copy()
    strength = DISTURBANCES[name].strengths[-1]
    one, other = disturbed(name, strength), disturbed(name, strength)
    np.testing.assert_array_equal(pictures(one), pictures(other))
    assert one.observed.actions == other.observed.actions and one.observed.roles == RECORDING.observed.roles
    np.testing.assert_array_equal(one.observed.boxes, other.observed.boxes)
    np.testing.assert_array_equal(pictures(RECORDING), before)
    np.testing.assert_array_equal(RECORDING.observed.boxes, boxes)


@pytest.mark.parametrize("name", [name for name in APPLIED if name not in ("slips", "misses")])
def test_the_truth_is_untouched(name: str) -> None:
    assert disturbed(name, DISTURBANCES[name].strengths[-1]).truth is RECORDING.truth


@pytest.mark.parametrize("name", ["slips", "misses"])
def test_additional_actions_change_nothing_and_the_others_do_what_they_did(name: str) -> None:
    found = disturbed(name, 0.5)
    truth, shown = found.truth, pictures(found)
    assert len(found.observed.actions) == len(truth.links) == 12 and truth.states.shape == (13, 5)
    for k in np.flatnonzero(~truth.success):
        assert (truth.states[k] == truth.states[k + 1]).all() and (shown[k] == shown[k + 1]).all()
    done, original = (
        [action for action, success in zip(one.observed.actions, one.truth.success, strict=True) if success]
        for one in (found, RECORDING)
    )
    assert 0 < len(done) < len(original) and done == original[: len(done)]


def test_a_slip_holds_the_link_and_a_miss_the_same_trigger_beside_it() -> None:
    slip, miss = disturbed("slips", 1.0), disturbed("misses", 1.0)
    assert set(slip.observed.actions) == {RECORDING.observed.actions[0]} and set(slip.truth.links) == {
        RECORDING.truth.links[0]
    }
    assert set(acted_objects(miss.observed)) == {RECORDING.episode.steps[0].acted_object}
    assert set(miss.truth.kinds) == {(NOTHING_HELD,)} and set(miss.truth.links) == {-1}
    image = RECORDING.episode.image(0)
    assert image.segmentation is not None
    for action in miss.observed.actions:
        assert image.segmentation[action.pixel[1], action.pixel[0]] in (6, 7)
        assert action.direction == RECORDING.observed.actions[0].direction
    assert not slip.truth.success.any() and not miss.truth.success.any()


def test_a_missing_frame_shows_the_one_before() -> None:
    assert set(disturbed("missing", 1.0).observed.image_of) == {0}
    image_of = disturbed("missing", 0.3).observed.image_of
    lost = [k for k in range(1, 13) if image_of[k] != RECORDING.observed.image_of[k]]
    assert lost and all(image_of[k] == image_of[k - 1] for k in lost)


@pytest.mark.parametrize("name", ["patch", "hand"])
def test_the_first_frame_is_never_covered_and_a_share_of_the_others_is(name: str) -> None:
    all_of_them, none, some = (changed_frames(disturbed(name, share)) for share in (1.0, 0.0, 0.3))
    assert not all_of_them[0] and all_of_them[1:].all() and not none.any() and 0 < some.sum() < 8


def test_a_hand_is_nearer_than_everything_and_a_patch_has_no_depth() -> None:
    hand, patch = (disturbed(name, 1.0).observed.frame(1).depth for name in ("hand", "patch"))
    before = RECORDING.observed.frame(1).depth
    assert hand is not None and patch is not None and before is not None
    assert (hand != before).any() and hand[hand != before].max() < before[before > 0].min()
    assert (patch != before).any() and (patch[patch != before] == 0).all()


def test_noise_has_the_length_that_is_asked_for() -> None:
    features = np.asarray(make_extractor().of(RECORDING.observed), np.float32)
    moved = noisy(features, 0.5, np.random.default_rng(0)) - features
    lengths = np.linalg.norm(moved, axis=-1)
    assert lengths[:, [1, 2, 4]].mean() == pytest.approx(0.5, rel=0.05) and (lengths[:, [0, 3]] == 0).all()
    camera = pictures(disturbed("camera", 5)).astype(int) - pictures(RECORDING)
    assert camera[:, :, 20:40].std() == pytest.approx(5, rel=0.1)


def test_boxes_stay_in_the_picture_and_swapped_ones_are_those_of_responders() -> None:
    for seed in range(20):
        boxes = disturbed("boxes", 50, seed).observed.boxes
        assert (boxes[:, :2] >= 0).all() and (boxes[:, 2:] > boxes[:, :2]).all() and (boxes <= [160, 120] * 2).all()
    swapped = disturbed("swapped", 1.0).observed.boxes
    places = np.flatnonzero((swapped != RECORDING.observed.boxes).any(axis=1))
    assert len(places) == 2 and set(places) <= {1, 2, 4}
    np.testing.assert_array_equal(swapped[places], RECORDING.observed.boxes[places[::-1]])


def test_less_quality_is_farther_from_the_recording() -> None:
    errors = [np.abs(pictures(disturbed("jpeg", s)).astype(int) - pictures(RECORDING)).mean() for s in (20, 80)]
    assert 0 < errors[0] < errors[1] < 30


def test_a_recording_without_states_is_refused() -> None:
    with pytest.raises(ValueError, match="does not know states"):
        recording_of(make_real_episode())


def scores(**values: Any) -> dict[str, Any]:
    return {"edge_p": 0.9, "edge_r": 0.8, "pred_a": None, "edge_f1": 0.85, **values}


def result() -> dict[str, Any]:
    models = {"event": scores(pred_a=0.7), "lookup": scores(pred_a=0.6), "lookup at best": scores(pred_a=0.65)}
    counted = {**models, "count": scores(), "count at best": scores(edge_p=None)}
    rows = {
        "undisturbed": [{"strength": 0.0, "boards": 3, "known": 0.96, "models": counted}],
        "features": [{"strength": 0.2, "boards": 3, "known": 0.96, "models": models}],
        "missing": [{"strength": 0.1, "boards": 3, "known": 0.9, "models": counted}],
    }
    told = {name: {"what": one.what, "unit": one.unit} for name, one in DISTURBANCES.items()}
    return {"models": {"event": {}}, "rows": rows, "disturbances": told}


def test_names_in_the_figure_are_no_formulas(tmp_path: Path) -> None:
    evil = json.loads(json.dumps(result()).replace("event", "$\\\\frac{$").replace("pixels", "$\\\\frac{$"))
    assert robustness_figure(tmp_path / "f.png", evil).exists()


def test_the_figure(tmp_path: Path) -> None:
    drawn = np.asarray(cv2.imread(str(robustness_figure(tmp_path / "f.png", result()))))
    assert drawn.shape[1] > 1200 and (drawn < 200).any()


def test_nothing_claimed_is_worth_nothing() -> None:
    assert f1({"edge_p": None, "edge_r": 0.0}) == 0 and f1({"edge_p": 1.0, "edge_r": 0.5}) == pytest.approx(2 / 3)


def test_what_is_no_disturbance_makes_no_row(tmp_path: Path) -> None:
    words = ["--data", str(tmp_path), "--model", "event=event", "--out", str(tmp_path / "out.json")]
    with pytest.raises(SystemExit, match=r"there is no boxs; choose among (.|\n)*boxes"):
        main([*words, "--only", "jpeg,boxs"])
