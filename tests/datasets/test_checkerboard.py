"""The camera found from drawn pictures of a checkerboard is the one that drew them."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.datasets.importing import checkerboard
from busybot.datasets.importing.checkerboard import Checkerboard, calibrate
from busybot.datasets.importing.sources import import_source
from tests.cli.commands import busybot
from tests.datasets.camera_folders import write_camera_folder
from tests.episodes.synthetic import make_episode

WIDTH, HEIGHT, FOCAL = 640, 480, 600.0
BOARD, SIDE, ACROSS = Checkerboard(7, 5, 2.5), 2.5, 40.0
"""A square has 2.5 cm, the board is 40 cm wide."""
TURNS = {
    "flat": (0.25, 0.0, 0.1),
    "a": (0.6, 0.1, 0.0),
    "b": (-0.2, 0.5, 0.2),
    "c": (0.3, -0.5, -0.3),
    "d": (0.7, 0.4, 0.1),
    "facing": (0.0, 0.0, 0.0),
    "turned": (0.0, 0.0, 0.2),
    "back": (0.0, 0.0, -0.2),
    "little": (0.05, 0.0, 0.0),
}


def pose_of(name: str) -> np.ndarray:
    """From the camera's frame to the checkerboard's: 50 cm away, turned."""
    lying = cv2.Rodrigues(np.array(TURNS[name]))[0] @ np.diag([1.0, -1.0, -1.0])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = lying, lying @ [1.0, -0.5, -50.0]
    return pose


def drawn(name: str, bend: float = 0.0) -> np.ndarray:
    """The checkerboard as a pinhole camera sees it."""
    scale = 40  # pixels of a square of the flat pattern
    pattern = np.full((8 * scale, 10 * scale), 255, np.uint8)
    for row in range(6):
        for column in range(8):
            if (row + column) % 2 == 0:
                pattern[(row + 1) * scale : (row + 2) * scale, (column + 1) * scale : (column + 2) * scale] = 0
    to_plane = np.array([[SIDE / scale, 0, -5 * SIDE], [0, -SIDE / scale, 4 * SIDE], [0, 0, 1]])
    inverse = np.linalg.inv(pose_of(name))
    matrix = np.array([[FOCAL, 0, WIDTH / 2 - 8], [0, FOCAL, HEIGHT / 2 + 5], [0, 0, 1]])
    seen = matrix @ inverse[:3][:, [0, 1, 3]] @ to_plane
    picture = cv2.warpPerspective(pattern, seen, (WIDTH, HEIGHT), borderValue=200, flags=cv2.INTER_AREA)
    if bend:
        bent = np.array([bend, 0, 0, 0, 0])
        picture = cv2.undistort(picture, matrix, bent)
    return cv2.GaussianBlur(picture, (3, 3), 0)


def pictures(folder: Path, names: str = "flat a b c d", bend: float = 0.0) -> Path:
    folder.mkdir(parents=True)
    for name in names.split():
        cv2.imwrite(str(folder / f"{name}.png"), drawn(name, bend))
    return folder


def test_matrix_and_pose_are_found(tmp_path: Path) -> None:
    told = calibrate(pictures(tmp_path / "board"), BOARD, "flat.png", ACROSS)
    matrix, pose = np.array(told["camera"]["matrix"]), np.array(told["camera"]["pose"])
    assert told["pictures"] == 5 and told["error"] < 0.3 and told["camera"]["unit"] == ACROSS / 4
    assert matrix[0, 0] == pytest.approx(FOCAL, rel=0.01) and matrix[1, 1] == pytest.approx(matrix[0, 0])
    assert matrix[:2, 2] == pytest.approx([WIDTH / 2 - 8, HEIGHT / 2 + 5], abs=4)
    assert np.linalg.norm(pose[:3, 3] - pose_of("flat")[:3, 3]) < 0.6, "of 50 cm"
    assert np.abs(pose[:3, :3] - pose_of("flat")[:3, :3]).max() < 0.02


def test_the_command_writes_what_an_import_reads(tmp_path: Path) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0))
    words = [
        "--corners",
        "7x5",
        "--side",
        "2.5",
        "--width",
        "40",
        "--flat",
        "flat.png",
        "--out",
        str(folder / "camera.json"),
    ]
    done = busybot("dataset", "calibrate", str(pictures(tmp_path / "board")), *words, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["pictures"] == 5
    assert import_source(folder, None).recordings[0]["camera"] == "known"
    again = busybot("dataset", "calibrate", str(tmp_path / "board"), *words)
    assert again.returncode == 1 and "camera.json" in again.stderr, "nothing is overwritten"


@pytest.mark.parametrize("names", ["facing turned back", "facing turned a", "facing turned back little", "flat"])
def test_pictures_of_one_slant_tell_no_focal_length(names: str, tmp_path: Path) -> None:
    folder, first = pictures(tmp_path / "board", names), f"{names.split()[0]}.png"
    if names == "flat":  # the same picture three times
        for name in ("again.png", "more.png"):
            (folder / name).write_bytes((folder / first).read_bytes())
    with pytest.raises(BusybotError, match="tell no focal length") as error:
        calibrate(folder, BOARD, first, ACROSS)
    assert "several slants" in error.value.hint


@pytest.mark.parametrize("names", ["facing turned back", "facing turned a", "facing turned back little"])
def test_nor_do_they_with_other_noise(names: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where every focal length fits, noise decides at which one a search ends, and how sure it seems of it."""
    folder, first = pictures(tmp_path / "board", names), f"{names.split()[0]}.png"
    found = {name: (np.asarray(at), shape) for name, (at, shape) in checkerboard._found(folder, BOARD).items()}
    noise = np.random.default_rng(0)
    for deviation in np.repeat([1e-4, 0.02, 0.2], 5):
        noisy = {name: (np.float32(noise.normal(at, deviation)), shape) for name, (at, shape) in found.items()}
        monkeypatch.setattr(checkerboard, "_found", lambda *_, told=noisy: told)
        with pytest.raises(BusybotError, match="tell no focal length"):
            calibrate(folder, BOARD, first, ACROSS)


@pytest.mark.parametrize(
    ("option", "value"),
    [("--side", "inf"), ("--side", "nan"), ("--width", "inf"), ("--corners", "7" * 5_000 + "x5"), ("--corners", "2x5")],
)
def test_options_out_of_range_are_refused(option: str, value: str, tmp_path: Path) -> None:
    words = {
        "--corners": "7x5",
        "--side": "2.5",
        "--width": "40",
        "--flat": "flat.png",
        "--out": tmp_path / "made.json",
    }
    done = busybot("dataset", "calibrate", tmp_path, *(w for pair in (words | {option: value}).items() for w in pair))
    assert done.returncode == 2 and option in done.stderr and not list(tmp_path.iterdir())


@pytest.mark.parametrize("shift", [80, 200])
def test_a_picture_that_was_cut_is_named(shift: int, tmp_path: Path) -> None:
    folder = pictures(tmp_path / "board")
    cv2.imwrite(str(folder / "b.png"), np.roll(drawn("b"), shift, axis=1))
    with pytest.raises(BusybotError, match=r"b.png: the other pictures tell a focal length of 60\d pixels"):
        calibrate(folder, BOARD, "flat.png", ACROSS)
    (folder / "b.png").unlink()
    assert calibrate(folder, BOARD, "flat.png", ACROSS)["pictures"] == 4


def test_what_is_wrong_is_named_and_nothing_is_written(tmp_path: Path) -> None:
    few = pictures(tmp_path / "few", "flat a")
    with pytest.raises(BusybotError, match="2 of 2 pictures show"):
        calibrate(few, BOARD, "flat.png", ACROSS)
    with pytest.raises(BusybotError, match=r"table.png: there is no such picture"):
        calibrate(few, BOARD, "table.png", ACROSS)
    cv2.imwrite(str(few / "b.png"), drawn("b")[:400])
    with pytest.raises(
        BusybotError, match=r"b.png: 640 x 400 pixels, a.png|flat.png: .* pixels, a.png|640 x 400"
    ) as error:
        calibrate(few, BOARD, "flat.png", ACROSS)
    assert "b.png" in error.value.what
    with pytest.raises(BusybotError, match="0 of 5 pictures show 9 x 6"):
        calibrate(pictures(tmp_path / "other"), Checkerboard(9, 6, 1.0), "flat.png", ACROSS)
    with pytest.raises(BusybotError, match="without distortion"):
        calibrate(pictures(tmp_path / "bent", bend=-2.0), BOARD, "flat.png", ACROSS)
    with pytest.raises(BusybotError, match="no such folder"):
        calibrate(tmp_path / "nothing", BOARD, "flat.png", ACROSS)
