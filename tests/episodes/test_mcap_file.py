"""Episodes survive the way to disk and back; what did not survive is refused by name."""

import hashlib
import json
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard

from busybot.episodes import mcap_topics as topics
from busybot.episodes.episode import Episode
from busybot.episodes.images import LazyImages
from busybot.episodes.mcap_file import read_episode, write_episode
from busybot.episodes.mcap_records import read_records
from busybot.episodes.protobuf import compressed_image_class, message_class
from busybot.errors import BusybotError
from tests.episodes.synthetic import make_episode, make_real_episode
from tests.episodes.tamper import rewrite

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "000000.mcap"
    write_episode(path, make_episode())
    return path


def same_but_images(a: Episode, b: Episode) -> None:
    for name in ("board", "links", "frame_of", "steps", "policy", "oracle", "settings", "renderer", "versions"):
        assert getattr(a, name) == getattr(b, name), name
    assert (a.camera.width, a.camera.height) == (b.camera.width, b.camera.height)
    np.testing.assert_array_equal(a.camera.matrix, b.camera.matrix)
    np.testing.assert_array_equal(a.camera.pose, b.camera.pose)
    np.testing.assert_array_equal(a.positions, b.positions)


def test_a_png_recording_comes_back_exactly(tmp_path: Path) -> None:
    episode = make_episode()
    size = write_episode(tmp_path / "e.mcap", episode, images="png")
    back = read_episode(tmp_path / "e.mcap")
    assert size == (tmp_path / "e.mcap").stat().st_size
    same_but_images(episode, back)
    assert len(back.images) == len(episode.images) < len(episode.frame_of)
    for ours, theirs in zip(episode.images, back.images, strict=True):
        np.testing.assert_array_equal(ours.rgb, theirs.rgb)
        np.testing.assert_array_equal(ours.segmentation, theirs.segmentation)
        np.testing.assert_array_equal(ours.boxes, theirs.boxes)
        np.testing.assert_allclose(ours.depth, theirs.depth, atol=2.1e-5)
        np.testing.assert_array_equal(ours.depth == 0, theirs.depth == 0)
        assert [x.dtype for x in vars(ours).values()] == [x.dtype for x in vars(theirs).values()]


def test_a_jpeg_recording_keeps_unchanged_blocks_bit_equal(tmp_path: Path) -> None:
    episode = make_episode()
    write_episode(tmp_path / "e.mcap", episode)
    back = read_episode(tmp_path / "e.mcap")
    same_but_images(episode, back)
    for k in range(1, len(episode.images)):
        unchanged = (episode.images[k].rgb == episode.images[k - 1].rgb).all(-1)
        blocks = unchanged.reshape(15, 8, 20, 8).all(axis=(1, 3)).repeat(8, 0).repeat(8, 1)
        assert blocks.mean() > 0.5
        np.testing.assert_array_equal(back.images[k].rgb[blocks], back.images[k - 1].rgb[blocks])
        assert np.abs(back.images[k].rgb.astype(int) - episode.images[k].rgb)[blocks].mean() < 10


def test_unchanged_frames_are_written_once(tmp_path: Path) -> None:
    episode = make_episode(steps=3)
    still = replace(episode, steps=episode.steps + [episode.steps[2]] * 20, frame_of=episode.frame_of + [2] * 20)
    small, large = write_episode(tmp_path / "a.mcap", episode), write_episode(tmp_path / "b.mcap", still)
    assert large - small < 8000
    assert len(read_records(tmp_path / "b.mcap").messages[topics.RGB]) == 3


def test_a_recording_from_elsewhere_needs_no_depth_segmentation_or_truth(tmp_path: Path) -> None:
    episode = make_real_episode()
    write_episode(tmp_path / "e.mcap", episode)
    back = read_episode(tmp_path / "e.mcap")
    same_but_images(episode, back)
    assert back.images[0].depth is None and back.images[0].segmentation is None
    assert (back.images[0].boxes == -1).all()
    assert np.isnan(back.positions).all()


def test_an_episode_without_steps_or_objects_in_view_is_an_episode(tmp_path: Path) -> None:
    write_episode(tmp_path / "e.mcap", make_episode(steps=0))
    assert read_episode(tmp_path / "e.mcap").frame_of == [0]


def test_lazy_images_are_the_eager_ones_and_know_boxes_without_decoding(file: Path) -> None:
    eager, lazy = read_episode(file), read_episode(file, images="lazy")
    assert isinstance(lazy.images, LazyImages)
    assert len(lazy.images) == len(eager.images)
    np.testing.assert_array_equal(lazy.images.encoded[1].boxes, eager.images[1].boxes)
    for a, b in zip(lazy.images, eager.images, strict=True):
        np.testing.assert_array_equal(a.rgb, b.rgb)
        np.testing.assert_array_equal(a.depth, b.depth)
    np.testing.assert_array_equal(lazy.images[-1].rgb, eager.images[-1].rgb)
    with pytest.raises(IndexError):
        lazy.images[len(eager.images)]


def test_the_same_episode_gives_the_same_bytes_in_every_process(file: Path, tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from busybot.episodes.mcap_file import write_episode;"
        "from tests.episodes.synthetic import make_episode;"
        "write_episode(Path(sys.argv[1]), make_episode(5)); write_episode(Path(sys.argv[1]), make_episode(0))"
    )
    environment = {"PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo"}
    subprocess.run([sys.executable, "-c", code, tmp_path / "o.mcap"], env=environment, cwd=tmp_path, check=True)
    assert hashlib.sha256((tmp_path / "o.mcap").read_bytes()).digest() == hashlib.sha256(file.read_bytes()).digest()


def test_times_are_simulation_times(file: Path) -> None:
    times = [time for time, _ in read_records(file).messages[topics.STEP]]
    assert times == [k * 1_000_000_000 for k in range(6)]


def test_everything_privileged_lies_under_truth(file: Path) -> None:
    public = {topic for topic in read_records(file).schemas if not topic.startswith("/truth/")}
    assert public == {
        "/camera/rgb",
        "/camera/depth",
        "/camera/calibration",
        "/tf",
        "/objects",
        "/scene",
        "/step",
        "/log",
    }


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.7, 0.95, 0.9999])
def test_a_truncated_file_is_refused(file: Path, share: float) -> None:
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(BusybotError, match="000000.mcap") as error:
        read_episode(file)
    assert error.value.mend


def test_any_flipped_bit_is_noticed_or_harmless(file: Path) -> None:
    data, expected = file.read_bytes(), read_episode(file)
    rng = np.random.default_rng(0)
    refused = 0
    for position in rng.integers(0, len(data), 150):
        damaged = bytearray(data)
        damaged[position] ^= 1 << int(rng.integers(8))
        file.write_bytes(damaged)
        try:
            back = read_episode(file)
        except BusybotError:
            refused += 1
        else:
            same_but_images(expected, back)
            np.testing.assert_array_equal(back.images[-1].rgb, expected.images[-1].rgb)
    assert refused > 145


def test_garbage_and_absence_are_refused(tmp_path: Path) -> None:
    for name, data in (("empty", b""), ("text", b"hello" * 99), ("magic", b"\x89MCAP0\r\n" * 2)):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(BusybotError, match=name):
            read_episode(tmp_path / name)
    for path in (tmp_path, tmp_path / "absent.mcap"):
        with pytest.raises(BusybotError, match="no such file"):
            read_episode(path)


def test_bytes_after_the_end_are_refused(file: Path) -> None:
    file.write_bytes(file.read_bytes() + b"more")
    with pytest.raises(BusybotError, match="4 bytes follow"):
        read_episode(file)


def test_a_foreign_mcap_file_is_refused(file: Path) -> None:
    rewrite(file, metadata=lambda values: {})
    with pytest.raises(BusybotError, match="not a recording of busybot"):
        read_episode(file)


def test_a_newer_minor_version_is_read_and_a_newer_major_refused(file: Path) -> None:
    rewrite(file, metadata=lambda values: {**values, "schema_version": "1.9"})
    assert len(read_episode(file).steps) == 6
    rewrite(file, metadata=lambda values: {**values, "schema_version": "2.0"})
    with pytest.raises(BusybotError, match="episode schema 2.0") as error:
        read_episode(file)
    assert "version" in str(error.value.mend)


def edit_image(topic: str, data: bytes) -> bytes:
    """Let the first RGB picture claim 60000 x 60000 pixels."""
    if topic != topics.RGB:
        return data
    message = compressed_image_class().FromString(data)
    message.data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 60000, 60000) + message.data[24:]
    return message.SerializeToString()


def edit_step(topic: str, data: bytes, **values: int) -> bytes:
    if topic != topics.STEP:
        return data
    message = message_class("Step").FromString(data)
    for name, value in values.items():
        setattr(message, name, value)
    return message.SerializeToString()


@pytest.mark.parametrize(
    ("what", "edits"),
    [
        ("60000", {"message": edit_image}),
        ("directions", {"message": lambda t, d: edit_step(t, d, direction=99)}),
        ("out of order", {"message": lambda t, d: edit_step(t, d, index=3)}),
        ("in order", {"message": lambda t, d: edit_step(t, d, image_after=0, image_before=0)}),
        ("reward", {"message": lambda t, d: edit_step(t, d, reward=7)}),
        ("messages on /truth/links", {"message": lambda t, d: None if t == topics.LINKS else d}),
        ("pictures on /camera/depth", {"metadata": lambda m: {**m, "images": "100000000"}}),
        ("depth scale", {"metadata": lambda m: {**m, "depth_scale": "nan"}}),
        ("board.json", {"attachment": lambda n, d: b"{}" if n == "board.json" else d}),
        ("recording.json", {"attachment": lambda n, d: None if n == "recording.json" else d}),
        ("schema 'x'", {"schema": lambda name: "x" if name == "busybot.v1.Step" else name}),
        ("DecodeError", {"message": lambda t, d: b"\xff\xff" if t == topics.STEP else d}),
    ],
)
def test_contradictions_are_refused_by_name(file: Path, what: str, edits: dict) -> None:
    rewrite(file, **edits)
    with pytest.raises(BusybotError, match="000000.mcap") as error:
        read_episode(file)
    assert what in str(error.value), error.value


def test_a_camera_beyond_reason_is_refused(file: Path) -> None:
    def edit(name: str, data: bytes) -> bytes:
        values = json.loads(data)
        if "camera" in values:
            values["camera"]["width"] = 10**9
        return json.dumps(values).encode()

    rewrite(file, attachment=edit)
    with pytest.raises(BusybotError, match="1000000000 x 120 pixels"):
        read_episode(file)


def test_a_decompression_bomb_is_refused_before_it_explodes(tmp_path: Path) -> None:
    bomb = zstandard.compress(bytes(1 << 20))
    chunk = (
        struct.pack("<QQQI", 0, 0, 1 << 40, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(bomb)) + bomb
    )
    record = b"\x06" + struct.pack("<Q", len(chunk)) + chunk
    header = b"\x01" + struct.pack("<QII", 8, 0, 0)
    (tmp_path / "bomb.mcap").write_bytes(b"\x89MCAP0\r\n" + header + record)
    with pytest.raises(BusybotError, match="bomb.mcap"):
        read_episode(tmp_path / "bomb.mcap")
    lying = struct.pack("<QQQI", 0, 0, 16, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(bomb)) + bomb
    (tmp_path / "bomb.mcap").write_bytes(b"\x89MCAP0\r\n" + header + b"\x06" + struct.pack("<Q", len(lying)) + lying)
    with pytest.raises(BusybotError, match="contradicts itself"):
        read_episode(tmp_path / "bomb.mcap")


def test_a_corrupt_picture_is_refused_when_it_is_decoded(file: Path) -> None:
    def edit(topic: str, data: bytes) -> bytes:
        if topic != topics.DEPTH:
            return data
        message = compressed_image_class().FromString(data)
        message.data = message.data[:60] + bytes(len(message.data) - 60)
        return message.SerializeToString()

    rewrite(file, message=edit)
    with pytest.raises(BusybotError, match="image 0"):
        read_episode(file)


def test_inconsistent_episodes_are_not_written(tmp_path: Path) -> None:
    episode = make_episode()
    image = episode.images[0]
    faulty = {
        "frames": replace(episode, frame_of=episode.frame_of[:-1]),
        "rgb is float64": replace(episode, images=[replace(image, rgb=image.rgb / 255.0), *episode.images[1:]]),
        "boxes": replace(episode, images=[replace(image, boxes=image.boxes[:2]), *episode.images[1:]]),
        "link 9": replace(
            episode,
            images=[replace(image, segmentation=np.full_like(image.segmentation, 9)), *episode.images[1:]],
        ),
        "NaN": replace(episode, images=[replace(image, depth=image.depth * np.float32("nan")), *episode.images[1:]]),
        "trigger states": replace(episode, steps=[replace(episode.steps[0], trigger_states_after=(1,))] * 6),
        "object 77": replace(episode, steps=[replace(episode.steps[0], acted_object=77)] * 6),
    }
    for what, wrong in faulty.items():
        with pytest.raises(BusybotError) as error:
            write_episode(tmp_path / "e.mcap", wrong)
        assert what in str(error.value), error.value
        assert not list(tmp_path.iterdir())
    write_episode(tmp_path / "e.mcap", episode)
    assert len(read_episode(tmp_path / "e.mcap").steps) == 6


def test_rerun_finds_nothing_wrong_with_the_file(file: Path) -> None:
    rerun = Path(sys.executable).with_name("rerun")
    if not rerun.exists():
        pytest.skip("the command rerun is not installed")
    done = subprocess.run([rerun, "mcap", "check", file], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    rows = [line for line in done.stdout.splitlines() if "/camera/rgb" in line]
    assert rows and rows[0].startswith("ok")


def test_other_readers_decode_the_file_with_its_own_schemas(file: Path) -> None:
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    with open(file, "rb") as stream:
        messages = list(make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    seen = {channel.topic: decoded for _, channel, _, decoded in messages}
    step, expected = seen["/step"], make_episode().steps[-1]
    assert step.changed_pixels == expected.changed_pixels and list(step.executed) == list(expected.executed)
    assert seen["/truth/relations"].relations[0].triggers[0].link == "link_0"
    assert seen["/tf"].transforms[0].translation.z == 4
    assert seen["/camera/calibration"].K[2] == 80
