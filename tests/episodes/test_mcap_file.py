"""Episodes survive the way to disk and back, and others can read the files too."""

import gc
import hashlib
import subprocess
import sys
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from busybot.common.errors import BusybotError
from busybot.episodes.codec import LazyImages
from busybot.episodes.episode import Episode
from busybot.episodes.mcap import channels
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.records import read_records
from busybot.episodes.mcap.writer import write_episode
from tests.episodes.synthetic import make_episode, make_real_episode, make_task_episode

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
    assert len(read_records(tmp_path / "b.mcap").payloads[channels.RGB]) == 3


def test_a_recording_from_elsewhere_needs_no_depth_segmentation_or_truth(tmp_path: Path) -> None:
    episode = make_real_episode()
    write_episode(tmp_path / "e.mcap", episode)
    back = read_episode(tmp_path / "e.mcap")
    same_but_images(episode, back)
    assert back.images[0].depth is None and back.images[0].segmentation is None
    assert (back.images[0].boxes == -1).all()
    assert np.isnan(back.positions).all()


@pytest.mark.parametrize("decoding", ["eager", "lazy"])
def test_a_goal_comes_back_with_its_task(tmp_path: Path, decoding: str) -> None:
    episode = make_task_episode()
    write_episode(tmp_path / "e.mcap", episode, images="png")
    back = read_episode(tmp_path / "e.mcap", decoding)  # type: ignore[arg-type]
    same_but_images(episode, back)
    assert back.board.task == episode.board.task and back.board.task is not None
    assert episode.goal is not None and back.goal is not None and len(back.images) == len(episode.images)
    for name in ("rgb", "segmentation", "boxes"):
        np.testing.assert_array_equal(getattr(back.goal, name), getattr(episode.goal, name))
    np.testing.assert_allclose(back.goal.depth, episode.goal.depth, atol=2.1e-5)
    messages = read_records(tmp_path / "e.mcap").payloads
    assert all(len(messages[topic]) == 1 for topic in channels.GOAL)


def test_without_a_goal_nothing_is_written_of_one(file: Path) -> None:
    assert read_episode(file).goal is None and read_episode(file, images="lazy").goal is None
    assert not read_records(file).payloads.keys() & set(channels.GOAL)
    twice = replace(make_task_episode(), goals=2 * list(make_task_episode().goals))
    with pytest.raises(BusybotError, match="2 goal images"):
        write_episode(file, twice)


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


def test_decoded_pictures_are_freed_with_their_last_use(file: Path) -> None:
    images = read_episode(file, images="lazy").images
    image = images[0]
    picture = weakref.ref(image.rgb)
    del images
    np.testing.assert_array_equal(image.depth, read_episode(file).images[0].depth, "what is held decodes on")
    gc.disable()
    try:
        del image
        assert picture() is None, "nothing waits for the garbage collector"
    finally:
        gc.enable()


def test_the_same_episode_gives_the_same_bytes_in_every_process(file: Path, tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from busybot.episodes.mcap.writer import write_episode;"
        "from tests.episodes.synthetic import make_episode;"
        "write_episode(Path(sys.argv[1]), make_episode(5)); write_episode(Path(sys.argv[1]), make_episode(0))"
    )
    environment = {"PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "7", "TZ": "Asia/Tokyo"}
    subprocess.run([sys.executable, "-c", code, tmp_path / "o.mcap"], env=environment, cwd=tmp_path, check=True)
    assert hashlib.sha256((tmp_path / "o.mcap").read_bytes()).digest() == hashlib.sha256(file.read_bytes()).digest()


def test_times_are_simulation_times(file: Path) -> None:
    with file.open("rb") as stream:
        times = [message.log_time for _, _, message in make_reader(stream).iter_messages(channels.STEP)]
    assert times == [k * 1_000_000_000 for k in range(6)]


def test_every_message_of_the_scene_shows_the_board(file: Path) -> None:
    with file.open("rb") as stream:
        scenes = [message.data for _, _, message in make_reader(stream).iter_messages(channels.SCENE)]
    assert len(scenes) == 7 and all(b"board" in data for data in scenes)
    assert [b"action" in data for data in scenes] == [False, *[True] * 6]


def test_everything_privileged_lies_under_truth(file: Path) -> None:
    public = {topic for topic in read_records(file).schema_names if not topic.startswith("/truth/")}
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
        "outside of the image": replace(episode, steps=[replace(episode.steps[0], pixel=(160, 0))] * 6),
        "are not finite": replace(episode, steps=[replace(episode.steps[0], position=(0.0, 0.0, 1e300))] * 6),
        "joint positions": replace(episode, steps=[replace(episode.steps[0], joint_positions_after=(0, np.nan))] * 6),
        "too large": replace(episode, board=episode.board.model_copy(update={"seed": 2**63})),
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
