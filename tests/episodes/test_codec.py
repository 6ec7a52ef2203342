"""What images lose on disk, and that nothing else than the image asked for is decoded."""

import cv2
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


def _scenes(height: int = 96, width: int = 128) -> list[np.ndarray]:
    """A picture, and the same with changes in some rows of blocks, in all and in none."""
    rng = np.random.default_rng(2)
    small = rng.integers(0, 255, (height // 8, width // 8, 3)).astype(np.uint8)
    first = cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)
    some, moved = first.copy(), np.roll(first, 3, axis=0)
    some[20:29, 10:50] = 255 - some[20:29, 10:50]
    some[-1, -1] = 0
    return [first, some, moved, first]


@pytest.mark.parametrize("image_format", ["jpeg", "png"])
@pytest.mark.parametrize("size", [(96, 128), (96, 123), (91, 128)])
def test_rows_that_are_copied_are_those_that_would_be_decoded(size: tuple[int, int], image_format: str) -> None:
    pictures = [codec.encode_rgb(scene, image_format) for scene in _scenes(*size)]  # type: ignore[arg-type]
    rows = codec.RowDecoder(pictures[0], size[1], size[0])
    for data in [*pictures, *pictures[::-1]]:
        np.testing.assert_array_equal(rows.decode(data), codec.decode_rgb(data, size[1], size[0]))
    with pytest.raises(ValueError, match="pixels"):
        rows.decode(codec.encode_rgb(_scenes(48, 64)[0], image_format))  # type: ignore[arg-type]


def test_only_rows_that_changed_are_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    pictures = [codec.encode_rgb(scene, "jpeg") for scene in _scenes()]
    rows, decode, heights = codec.RowDecoder(pictures[0], 128, 96), codec.decode_rgb, list[int]()

    def noting(data: bytes, width: int, height: int) -> np.ndarray:
        heights.append(height)
        return decode(data, width, height)

    monkeypatch.setattr(codec, "decode_rgb", noting)
    for data in pictures:
        rows.decode(data)
    assert heights == [24, 96], "rows 2, 3 and the last; all; none of the same picture"


@pytest.mark.parametrize("sampling", ["411", "420", "422", "440", "444"])
@pytest.mark.parametrize("interval", [0, 4, 8, 16, 32])
def test_pictures_of_other_encoders_are_decoded_all_the_same(sampling: str, interval: int) -> None:
    factor = getattr(cv2, f"IMWRITE_JPEG_SAMPLING_FACTOR_{sampling}")
    flags = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, factor, cv2.IMWRITE_JPEG_RST_INTERVAL, interval]
    for more in ([], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1], [cv2.IMWRITE_JPEG_OPTIMIZE, 1]):
        pictures = [cv2.imencode(".jpg", scene, [*flags, *more])[1].tobytes() for scene in _scenes()]
        rows = codec.RowDecoder(pictures[0], 128, 96)
        for data in [*pictures, codec.encode_rgb(_scenes()[1], "jpeg")]:
            np.testing.assert_array_equal(rows.decode(data), codec.decode_rgb(data, 128, 96))


def test_damaged_pictures_are_refused_or_decoded_but_nothing_else_happens() -> None:
    pictures = [codec.encode_rgb(scene, "jpeg") for scene in _scenes()]
    rng, rows = np.random.default_rng(3), codec.RowDecoder(pictures[0], 128, 96)
    for _ in range(300):
        data = bytearray(pictures[1])
        for place in rng.integers(0, len(data), rng.integers(1, 4)):
            data[place] = int(rng.integers(256))
        try:
            assert rows.decode(bytes(data[: rng.integers(1, len(data) + 1)])).shape == (96, 128, 3)
        except ValueError:
            continue
