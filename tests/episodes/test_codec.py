"""What images lose on disk, and that nothing else than the image asked for is decoded."""

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.episodes import codec
from busybot.episodes.codec import DepthScale


@pytest.fixture
def depth() -> np.ndarray:
    rng = np.random.default_rng(0)
    values = rng.uniform(2.01, 4.62, (48, 64)).astype(np.float32)
    values[:4] = 0
    return values


def test_depth_of_a_board_is_kept_to_half_a_step_of_4e_5(depth: np.ndarray) -> None:
    scale = DepthScale.covering([depth])
    assert scale == DepthScale(2.0, 4e-5)
    back = scale.restore(codec.decode_plain(codec.encode_plain(scale.quantise(depth)), 64, 48))
    assert np.abs(back - depth).max() < 2.1e-5
    np.testing.assert_array_equal(back == 0, depth == 0)


def test_depth_once_stored_is_stored_again_without_loss(depth: np.ndarray) -> None:
    scale = DepthScale()
    once = scale.restore(scale.quantise(depth))
    np.testing.assert_array_equal(scale.restore(scale.quantise(once)), once)


@pytest.mark.parametrize(("low", "high"), [(0.3, 9.0), (0.001, 0.02), (5.0, 5.0), (2.0, 4.0)])
def test_other_cameras_get_a_scale_of_their_own(low: float, high: float) -> None:
    depth = np.linspace(low, high, 48 * 64, dtype=np.float32).reshape(48, 64)
    depth[0, 0], depth[1] = low, 0
    scale = DepthScale.covering([depth])
    back = scale.restore(scale.quantise(depth))
    np.testing.assert_array_equal(back == 0, depth == 0)
    assert np.abs(back - depth).max() <= scale.scale * 0.6
    assert scale.scale <= max((high - low) / 65000, low * 1.1e-6)


def test_depth_that_is_not_a_number_is_refused(depth: np.ndarray) -> None:
    depth[5, 5] = np.nan
    with pytest.raises(BusybotError, match="NaN"):
        DepthScale.covering([depth])


def test_a_picture_without_any_depth_keeps_the_default() -> None:
    assert DepthScale.covering([np.zeros((4, 4), np.float32)]) == DepthScale()
    assert DepthScale.covering([]) == DepthScale()


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_labels_come_back_exactly(kind: type) -> None:
    labels = np.random.default_rng(1).integers(0, np.iinfo(kind).max, (30, 50)).astype(kind)
    back = codec.decode_plain(codec.encode_plain(labels), 50, 30)
    assert back.dtype == kind
    np.testing.assert_array_equal(back, labels)


def test_rgb_keeps_its_order_of_channels() -> None:
    red = np.zeros((16, 16, 3), np.uint8)
    red[..., 0] = 255
    np.testing.assert_array_equal(codec.decode_rgb(codec.encode_rgb(red, "png"), 16, 16), red)
    assert np.abs(codec.decode_rgb(codec.encode_rgb(red, "jpeg"), 16, 16).astype(int) - red).max() < 4


def test_a_jpeg_row_that_did_not_change_has_the_same_bytes() -> None:
    """Restart markers: this is why a chunk stores unchanged parts once."""
    image = np.random.default_rng(2).integers(0, 255, (64, 64, 3)).astype(np.uint8)
    other = image.copy()
    other[:8] = 0
    ours, theirs = (codec.encode_rgb(x, "jpeg").split(b"\xff\xd1", 1)[1] for x in (image, other))
    assert ours == theirs


@pytest.mark.parametrize("image_format", ["jpeg", "png"])
def test_sizes_are_read_from_the_header(image_format: codec.ImageFormat) -> None:
    data = codec.encode_rgb(np.zeros((24, 56, 3), np.uint8), image_format)
    assert codec.image_size(data) == (56, 24)
    with pytest.raises(ValueError, match="56 x 24 pixels where 55 x 24"):
        codec.decode_rgb(data, 55, 24)


@pytest.mark.parametrize("data", [b"", b"\xff\xd8", b"\xff\xd8\xff\xe0\x00", b"\x89PNG\r\n\x1a\n", b"GIF89a" * 10])
def test_what_is_no_image_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="neither"):
        codec.image_size(data)
    with pytest.raises(ValueError, match="neither"):
        codec.decode_plain(data, 4, 4)
