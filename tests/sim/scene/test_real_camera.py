"""What each term of the real camera does to a picture, alone and with the others, and which changes it can tell."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from busybot.episodes.episode import Image
from busybot.sim.scene.real_camera import (
    GOAL_FRAME,
    HAND_NEAR,
    PERIOD,
    REAL,
    TERMS,
    CameraConfig,
    Photo,
    changed_area,
    take_photo,
    true_depth,
)
from busybot.sim.scene.render import RenderConfig

ORIGIN = (3, "train", 5)
ALL = CameraConfig.model_validate(REAL)
WIDTH, HEIGHT = 320, 240
FRAMES = range(60)


def picture() -> Image:
    """A board of soft stripes with four blocks on it, half a unit high."""
    across = np.arange(WIDTH) / WIDTH
    rgb = np.full((HEIGHT, WIDTH, 3), (150, 130, 100), np.uint8) + (20 * np.sin(40 * across)[:, None]).astype(np.int8)
    rgb, depth, segmentation = (
        rgb.astype(np.uint8),
        np.full((HEIGHT, WIDTH), 4.0, np.float32),
        np.zeros((HEIGHT, WIDTH), np.uint16),
    )
    boxes = []
    for number, (u, v) in enumerate(((40, 40), (200, 50), (60, 150), (220, 160))):
        block = (slice(v, v + 40), slice(u, u + 50))
        rgb[block], depth[block], segmentation[block] = (40, 80, 60 * number), 3.5, number + 1
        boxes.append((u, v, u + 50, v + 40))
    return Image(rgb, depth, segmentation, np.array(boxes, np.int16))


CLEAN = picture()


def photo(config: CameraConfig, frame: int, clean: Image = CLEAN) -> Photo:
    return take_photo(clean, config, ORIGIN, frame)


def alone(term: str) -> CameraConfig:
    return CameraConfig.model_validate({term: REAL[term]})


def differs(first: np.ndarray, second: np.ndarray) -> float:
    """Share of pixels."""
    return float((first != second).reshape(*first.shape[:2], -1).any(axis=-1).mean())


def test_without_terms_nothing_changes_and_nothing_is_written() -> None:
    shown = photo(CameraConfig(), 3)
    assert CameraConfig().clean and differs(shown.rgb, CLEAN.rgb) == 0 == differs(true_depth(shown), true_depth(CLEAN))
    assert {"camera", "randomise"}.isdisjoint(RenderConfig().model_dump(mode="json"))
    told = RenderConfig(camera=CameraConfig(noise=0.02, jpeg=80)).model_dump(mode="json")
    assert told["camera"] == {"noise": 0.02, "jpeg": 80} and RenderConfig.model_validate(told).camera.noise == 0.02
    assert not CameraConfig(jpeg=80).clean and CameraConfig(tolerance=0.2).clean


@pytest.mark.parametrize(
    "config", [*(pytest.param(alone(term), id=term) for term in TERMS), pytest.param(ALL, id="all")]
)
def test_a_frame_alone_is_that_of_the_sequence_and_the_truth_stays(config: CameraConfig) -> None:
    before = (CLEAN.rgb.copy(), true_depth(CLEAN).copy())
    shown = [photo(config, 0)]
    for _ in range(1, 12):
        shown.append(shown[-1].next(CLEAN))
    for frame in (11, 4, 7, 0):
        again = photo(config, frame)
        assert np.array_equal(again.rgb, shown[frame].rgb)
        assert again.depth is not None and np.array_equal(again.depth, shown[frame].depth)  # type: ignore[arg-type]
        assert again.rgb.dtype == np.uint8 and again.depth.dtype == np.float32
        assert again.segmentation is CLEAN.segmentation and again.boxes is CLEAN.boxes
        assert true_depth(again) is CLEAN.depth
    assert np.array_equal(CLEAN.rgb, before[0]) and np.array_equal(true_depth(CLEAN), before[1])
    other = [take_photo(CLEAN, config, (4, "train", 5), frame) for frame in range(12)]
    if config not in (alone("jpeg"), alone("hand")):  # one draws nothing, no hand may pass in so few frames
        assert any(differs(a.rgb, b.rgb) or (a.depth != b.depth).any() for a, b in zip(shown, other, strict=True))


def test_a_term_draws_the_same_beside_others() -> None:
    both = photo(CameraConfig(noise=0.01, depth_holes=0.05), 4)
    assert np.array_equal(both.rgb, photo(CameraConfig(noise=0.01), 4).rgb)
    assert np.array_equal(true_holes(both), true_holes(photo(CameraConfig(depth_holes=0.05), 4)))


def true_holes(shown: Photo) -> np.ndarray:
    assert shown.depth is not None
    return shown.depth == 0


def test_noise_has_its_deviation_and_is_another_one_in_each_frame() -> None:
    grey = replace(CLEAN, rgb=np.full_like(CLEAN.rgb, 128))
    first, second = (photo(CameraConfig(noise=0.02), frame, grey).rgb.astype(float) - 128 for frame in (1, 2))
    assert first.std() == pytest.approx(0.02 * 255, rel=0.03) and abs(first.mean()) < 0.1
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.02


def test_blur_takes_what_is_fine_and_leaves_what_is_broad() -> None:
    sharp, soft = (cv2.Laplacian(rgb, cv2.CV_64F).std() for rgb in (CLEAN.rgb, photo(CameraConfig(blur=2), 1).rgb))
    assert soft < 0.3 * sharp and abs(photo(CameraConfig(blur=2), 1).rgb.mean() - CLEAN.rgb.mean()) < 1


def test_exposure_drifts_slowly_up_to_its_stops() -> None:
    light = np.array([photo(CameraConfig(exposure=0.5), frame).rgb.mean() for frame in FRAMES]) / CLEAN.rgb.mean()
    stops = np.log2(light)
    assert 0.2 < np.abs(stops).max() < 0.53 and stops.min() < -0.1 and stops.max() > 0.1
    assert np.abs(np.diff(stops)).max() < 0.25


def test_jpeg_is_that_of_its_quality() -> None:
    poor, good = (np.abs(photo(CameraConfig(jpeg=q), 1).rgb.astype(int) - CLEAN.rgb).mean() for q in (20, 95))
    assert 0 < good < poor < 5
    assert np.array_equal(photo(CameraConfig(jpeg=80), 1).rgb, photo(CameraConfig(jpeg=80), 2).rgb)


def test_a_shake_displaces_colours_and_depth_by_at_most_its_length() -> None:
    window, moved = cv2.createHanningWindow((WIDTH, HEIGHT), cv2.CV_64F), []
    for frame in FRAMES:
        shown = photo(CameraConfig(shake=2), frame)
        grey = [rgb.mean(axis=-1) for rgb in (CLEAN.rgb, shown.rgb)]
        moved.append(cv2.phaseCorrelate(*grey, window)[0])
        assert shown.depth is not None
        places = np.argwhere(shown.depth < 3.9).mean(axis=0) - np.argwhere(true_depth(CLEAN) < 3.9).mean(axis=0)
        assert np.abs(places[::-1] - moved[-1]).max() < 0.7
    lengths = np.linalg.norm(moved, axis=1)
    assert lengths.max() < 2.2 and np.median(lengths) > 1 and np.abs(np.mean(moved, axis=0)).max() < 0.6


def test_a_shadow_passes_now_and_then_and_takes_its_share_of_light() -> None:
    light = [photo(CameraConfig(shadow=0.4), frame).rgb / np.maximum(CLEAN.rgb, 1.0) for frame in FRAMES]
    shaded = [bool((one < 0.75).mean() > 0.02) for one in light]
    assert not shaded[0] and 0.05 < np.mean(shaded) < 0.5
    assert min(one[CLEAN.rgb > 80].min() for one in light) == pytest.approx(0.6, abs=0.03)
    darkest = [one[..., 0][120] for one, dark in zip(light, shaded, strict=True) if dark]
    assert len({int(row.argmin()) for row in darkest}) > 1


@pytest.mark.long
def test_a_hand_hides_a_part_nearer_than_all_else_for_some_frames() -> None:
    hidden = {}
    for board in range(40):
        for frame in range(3 * PERIOD + 1):
            shown = take_photo(CLEAN, CameraConfig(hand=0.1), (0, "train", board), frame)
            hidden[board, frame] = shown.depth < 3.4  # type: ignore[operator]
            assert np.array_equal(differs(shown.rgb, CLEAN.rgb) > 0, hidden[board, frame].any())
    there = {place for place, mask in hidden.items() if mask.any()}
    assert not [place for place in there if place[1] == 0] and 0.06 < len(there) / (40 * 3 * PERIOD) < 0.14
    assert {0.02 < hidden[place].mean() < 0.5 for place in there} == {True}
    one = next(iter(sorted(there)))
    depth = take_photo(CLEAN, CameraConfig(hand=0.1), (0, "train", one[0]), one[1]).depth
    assert depth is not None and depth.min() == pytest.approx(HAND_NEAR * 3.5)
    assert np.array_equal(take_photo(CLEAN, CameraConfig(hand=0.25, shadow=0.5), ORIGIN, GOAL_FRAME).rgb, CLEAN.rgb)


def test_a_hand_before_nothing_has_no_depth() -> None:
    """A camera that looks past board and table sees nothing that a hand could be nearer than."""
    nothing = replace(CLEAN, depth=np.zeros_like(CLEAN.depth))
    for frame in FRAMES:
        depth = photo(CameraConfig(hand=0.25), frame, nothing).depth
        assert depth is not None and not depth.any()


def test_depth_frays_at_edges_only_and_has_holes_of_its_share() -> None:
    frayed = photo(CameraConfig(depth_edges=1), 2)
    assert frayed.depth is not None and CLEAN.segmentation is not None
    outline = cv2.morphologyEx((CLEAN.segmentation > 0).astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3)))
    beside = [cv2.dilate(outline, np.ones((side, side))) > 0 for side in (1, 9)]
    wrong = frayed.depth != CLEAN.depth
    assert wrong[beside[0]].mean() > 0.2 and not wrong[~beside[1]].any() and np.array_equal(frayed.rgb, CLEAN.rgb)
    holes = [true_holes(photo(CameraConfig(depth_holes=0.03), frame)) for frame in (1, 2)]
    assert [hole.mean() for hole in holes] == pytest.approx([0.03, 0.03], rel=0.05)
    assert (holes[0] & holes[1]).mean() < 0.01
    pieces = cv2.connectedComponents(holes[0].astype(np.uint8))[0] - 1
    assert holes[0].sum() / pieces > 4


def test_what_changes_is_told_from_what_the_camera_does() -> None:
    quiet = CameraConfig.model_validate({**REAL, "hand": 0, "shadow": 0})
    shown = [photo(quiet, frame) for frame in FRAMES]
    unlike = [changed_area(a.rgb, b.rgb, quiet.tolerance) for a, b in zip(shown, shown[1:], strict=False)]
    assert max(unlike) < 125  # a quarter of the area that is a reward, of the area
    lit = CLEAN.rgb.copy()
    lit[40:80, 40:90] = (230, 220, 120)
    for frame in FRAMES[:-1]:
        after = shown[frame].next(replace(CLEAN, rgb=lit))
        assert 1200 < changed_area(shown[frame].rgb, after.rgb, quiet.tolerance) < 4000
        assert changed_area(after.rgb, shown[frame].rgb, quiet.tolerance) > 1200
