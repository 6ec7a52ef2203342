"""Files that are truncated, damaged, foreign or made to exhaust the reader: refused, by name, with a mend."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import zstandard

from busybot.common.errors import BusybotError
from busybot.episodes.mcap import channels
from busybot.episodes.mcap.channels import message_class
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from tests.episodes.synthetic import make_episode, make_task_episode
from tests.episodes.tamper import rewrite


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "000000.mcap"
    write_episode(path, make_episode())
    return path


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.7, 0.95, 0.9999])
def test_a_truncated_file_is_refused(file: Path, share: float) -> None:
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(BusybotError, match="000000.mcap") as error:
        read_episode(file)
    assert error.value.hint


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
            assert back.steps == expected.steps and back.board == expected.board
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
    assert "version" in str(error.value.hint)


def edit_image(topic: str, data: bytes) -> bytes:
    """Let the first RGB picture claim 60000 x 60000 pixels."""
    if topic != channels.RGB:
        return data
    message = message_class(channels.SCHEMAS[channels.RGB]).FromString(data)
    message.data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 60000, 60000) + message.data[24:]
    return message.SerializeToString()


def edit_step(topic: str, data: bytes, **values: int) -> bytes:
    if topic != channels.STEP:
        return data
    message = message_class(channels.SCHEMAS[channels.STEP]).FromString(data)
    for name, value in values.items():
        setattr(message, name, value)
    return message.SerializeToString()


def shorten_position(topic: str, data: bytes) -> bytes:
    if topic != channels.STEP:
        return data
    message = message_class(channels.SCHEMAS[channels.STEP]).FromString(data)
    del message.position[-1]
    return message.SerializeToString()


@pytest.mark.parametrize(
    ("what", "edits"),
    [
        ("60000", {"message": edit_image}),
        ("directions", {"message": lambda t, d: edit_step(t, d, direction=99)}),
        ("out of order", {"message": lambda t, d: edit_step(t, d, index=3)}),
        ("in order", {"message": lambda t, d: edit_step(t, d, image_after=0, image_before=0)}),
        ("position has 2 components, not 3", {"message": shorten_position}),
        ("reward", {"message": lambda t, d: edit_step(t, d, reward=7)}),
        ("messages on /truth/links", {"message": lambda t, d: None if t == channels.LINKS else d}),
        ("5 pictures on /camera/rgb", {"metadata": lambda m: {**m, "images": "100000000"}}),
        ("depth scale", {"metadata": lambda m: {**m, "depth_scale": "nan"}}),
        ("board.json", {"attachment": lambda n, d: b"{}" if n == "board.json" else d}),
        ("recording.json", {"attachment": lambda n, d: None if n == "recording.json" else d}),
        ("schema 'x'", {"schema": lambda name: "x" if name == "busybot.v1.Step" else name}),
        ("DecodeError", {"message": lambda t, d: b"\xff\xff" if t == channels.STEP else d}),
    ],
)
def test_contradictions_are_refused_by_name(file: Path, what: str, edits: dict) -> None:
    rewrite(file, **edits)
    with pytest.raises(BusybotError, match="000000.mcap") as error:
        read_episode(file)
    assert what in str(error.value), error.value


@pytest.mark.parametrize(
    ("what", "edits"),
    [
        ("1 pictures on /goal/rgb", {"metadata": lambda m: {**m, "goals": "2"}}),
        ("1 pictures on /goal/rgb", {"metadata": lambda m: {name: m[name] for name in m if name != "goals"}}),
        ("no images on /goal/rgb", {"message": lambda t, d: None if t == channels.GOAL_RGB else d}),
        ("ValueError", {"message": lambda t, d: None if t == channels.GOAL_BOXES else d}),
        ("task", {"attachment": lambda n, d: d.replace(b'"goal": [1, 1]', b'"goal": [1]')}),
    ],
)
def test_goals_that_do_not_fit_are_refused(file: Path, what: str, edits: dict) -> None:
    write_episode(file, make_task_episode())
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
        if topic != channels.DEPTH:
            return data
        message = message_class(channels.SCHEMAS[channels.RGB]).FromString(data)
        message.data = message.data[:60] + bytes(len(message.data) - 60)
        return message.SerializeToString()

    rewrite(file, message=edit)
    with pytest.raises(BusybotError, match="image 0"):
        read_episode(file)
