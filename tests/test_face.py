"""What `import busybot` offers: cheap to import, lazy to decode, and the same as what it is made of."""

import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import torch
from torch.utils.data import DataLoader

import busybot
from busybot.common.errors import BusybotError
from busybot.episodes import codec
from busybot.episodes.mcap import pictures
from busybot.episodes.mcap.pictures import Kept
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from busybot.episodes.tables import MADE_OF_KEY, read_shard, write_shard
from busybot.frames import SharedBlocks, Shuffled
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode

ROOT = Path(__file__).resolve().parents[1]
REGISTERED = "assert {'busybot/Board-v0', 'busybot/BoardPixels-v0'} <= set(gymnasium.registry)"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_dataset(tmp_path / "d")
    return tmp_path / "d"


@pytest.fixture(autouse=True)
def nothing_kept_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "_KEPT", Kept(pictures.KEPT_BYTES))


def run(code: str) -> None:
    """In a process of its own."""
    done = subprocess.run([sys.executable, "-c", f"import sys; {code}"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_dataset_is_shown_in_a_line(folder: Path) -> None:
    shown = repr(busybot.load_dataset(folder))
    assert str(folder) in shown and "boards" in shown and len(shown) < len(str(folder)) + 80


@pytest.mark.parametrize(
    "code",
    [
        "import busybot; assert not {'numpy', 'gymnasium', 'torch', 'pydantic'} & set(sys.modules)",
        f"import busybot, gymnasium; {REGISTERED}; assert 'sapien' not in sys.modules",
        f"import gymnasium, busybot; {REGISTERED}",
        # Gymnasium has no entry points any more; whoever only has an id names the package in it
        "import gymnasium; gymnasium.make('busybot:busybot/Board-v0', render={'width': 32, 'height': 24}).close()",
        # somebody only asked whether it is there
        f"import importlib.util, busybot; importlib.util.find_spec('gymnasium'); import gymnasium; {REGISTERED}",
    ],
)
def test_importing_is_cheap_and_registers_in_any_order(code: str) -> None:
    run(code)


@pytest.mark.parametrize(("absent", "extra"), [("torch", "learn"), ("sapien", "sim")])
def test_a_light_install_says_what_is_missing(tiny: Path, absent: str, extra: str) -> None:
    """`tools/check_install.py` tries it in environments where these are really absent."""
    wanted = "frames()" if extra == "learn" else "info"
    run(f"""sys.modules[{absent!r}] = None
import busybot
from busybot.common.errors import BusybotError, naming_extras
data = busybot.load_dataset({str(tiny)!r})
assert data[0].rgb[3].shape == (480, 640, 3) and len(data.to_pandas())
try:
    with naming_extras():
        data.{wanted}
        import {absent}
except BusybotError as error:
    assert str(error).startswith("{absent} is not installed"), error
    assert "make setup" in error.hint and "[{extra}]" in error.hint
else:
    raise SystemExit("nothing was said")""")


def test_all_that_is_offered_is_there() -> None:
    assert set(busybot.__all__) <= set(dir(busybot))
    assert all(getattr(busybot, name).__doc__ for name in busybot.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        busybot.nothing  # noqa: B018


def test_types_are_part_of_the_wheel() -> None:
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]["*"]
    assert "py.typed" in data and (ROOT / "busybot" / "py.typed").exists()


def test_addresses(folder: Path) -> None:
    for address in (folder, str(folder), f"file://{folder}", f"file://localhost{folder}"):
        assert busybot.load_dataset(address).path == folder
    with pytest.raises(BusybotError, match="another machine") as error:
        busybot.load_dataset("file://elsewhere/d")
    assert error.value.hint
    with pytest.raises(BusybotError, match="no such folder"):
        busybot.load_dataset(folder / "none")


def test_data_i_is_the_episode_of_board_i(folder: Path) -> None:
    data = busybot.load_dataset(folder)
    assert len(data) == 3 and [episode.board.index for episode in data] == [0, 1, 3]
    assert data[-1].board.index == 3 and bool(data)
    with pytest.raises(BusybotError, match="board 2 has no episode") as error:
        data[2]
    assert "busybot collect" in str(error.value.hint)
    for index in (4, -5):
        with pytest.raises(IndexError, match="no episode") as error:
            data[index]
        assert "0 to 3" in str(error.value)
    with pytest.raises(TypeError, match="slice"):
        data[0:2]  # type: ignore[index]
    assert len(repr(data[0])) < 200 and "board 0" in repr(data[0])


def test_views_of_an_episode_are_what_was_recorded(folder: Path) -> None:
    episode, whole = busybot.load_dataset(folder)[1], read_episode(folder / "episodes" / "000001.mcap")
    frames = len(episode.steps) + 1
    assert len(episode.rgb) == len(episode.depth) == len(episode.boxes) == frames
    for t in range(frames):
        np.testing.assert_array_equal(episode.rgb[t], whole.image(t).rgb)
        np.testing.assert_array_equal(episode.depth[t], whole.image(t).depth)
        np.testing.assert_array_equal(episode.boxes[t], whole.image(t).boxes)
    np.testing.assert_array_equal(episode.rgb[-2:][1], whole.image(frames - 1).rgb)
    assert episode.actions.shape == (len(episode.steps), 6) and episode.actions.dtype == np.float32
    np.testing.assert_allclose(episode.actions[2, :3], episode.steps[2].position)
    np.testing.assert_allclose(np.linalg.norm(episode.actions[:, 3:], axis=1), 1, rtol=1e-6)
    with pytest.raises(IndexError):
        episode.rgb[frames]


def test_asking_for_rgb_decodes_rgb_alone(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("decoded")

    monkeypatch.setattr(codec, "decode_plain", refuse)
    episode = busybot.load_dataset(folder)[0]
    assert episode.rgb[3].dtype == np.uint8 and (episode.boxes >= -1).all()
    assert busybot.load_dataset(folder).frames()[2]["rgb"].dtype == torch.uint8
    with pytest.raises(AssertionError, match="decoded"):
        episode.depth[3]


def test_an_episode_holds_no_pictures_and_knows_its_file_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = busybot.load_dataset(folder)
    episode, frames = data[0], data.frames()
    monkeypatch.setattr(pictures, "_KEPT", Kept(0))
    assert episode.rgb[0].any() and not pictures._KEPT._entries and not episode.images._recent  # type: ignore
    write_episode(data.episode_path(0), make_episode(0, steps=5))
    for ask in (lambda: episode.rgb[4], lambda: frames[0]):
        with pytest.raises(BusybotError, match=r"000000\.mcap: it was recorded again") as error:
            ask()
        assert error.value.hint
    assert len(data[0].steps) == 5
    with pytest.raises(BusybotError, match="not made of the episodes"):
        data.frames()


def test_tables_that_contradict_themselves_are_refused(folder: Path) -> None:
    """Whatever they say that they were made of."""
    data = busybot.load_dataset(folder)
    for column, value, told in (
        ("episode", 7, "episode 7"),
        ("image_before", -1, "picture -1"),
        ("image_before", 9, "picture 9"),
    ):
        place, kept = data.table_path("steps", 0), data.table_path("steps", 0).read_bytes()
        rows = read_shard(place, "steps")
        values = pa.array([value, *rows[column].to_pylist()[1:]], rows.schema.field(column).type)
        changed = rows.set_column(rows.schema.names.index(column), rows.schema.field(column), values)
        write_shard(place, "steps", [changed], made_of=rows.schema.metadata[MADE_OF_KEY].decode())
        with pytest.raises(BusybotError, match=told):
            data.frames()[0]
        place.write_bytes(kept)


def test_what_is_kept_stays_within_its_limit(folder: Path) -> None:
    files = [pictures.PictureFile(folder / "episodes" / f"00000{i}.mcap") for i in (0, 1, 3)]
    each = files[0].holding("/camera/rgb", 0).bytes
    kept = Kept(2 * each + each // 2)
    read = [kept.get(file, lambda file=file: file.holding("/camera/rgb", 0)) for file in files]
    assert list(kept._entries) == files[1:] and kept._bytes == sum(one.bytes for one in read[1:]) <= kept.most
    assert kept.get(files[1], lambda: pytest.fail("read again")) is read[1]
    assert list(kept._entries) == [files[2], files[1]]


def test_frames_are_the_steps_in_any_order(folder: Path) -> None:
    data = busybot.load_dataset(folder)
    frames = data.frames("rgb", "depth", "next_rgb", "next_depth")
    assert len(frames) == sum(len(episode.steps) for episode in data)
    for index in (7, 0, len(frames) - 1, 8):
        item = frames[index]
        episode, t = data[int(item["episode"])], int(item["step"])
        for name, views in (("rgb", episode.rgb), ("depth", episode.depth)):
            np.testing.assert_array_equal(item[name], views[t])
            np.testing.assert_array_equal(item[f"next_{name}"], views[t + 1])
        assert item["position"].tolist() == list(episode.steps[t].position)
        assert (int(item["direction"]), int(item["reward"])) == (episode.steps[t].direction, episode.steps[t].reward)
    with pytest.raises(IndexError):
        frames[len(frames)]
    with pytest.raises(BusybotError, match="no pictures 'colour'"):
        data.frames("colour")  # type: ignore[arg-type]


def test_depth_that_was_not_recorded_is_refused_before_it_is_read(tmp_path: Path) -> None:
    data = busybot.load_dataset(make_dataset(tmp_path / "flat", boards=1, finished=[]).path)
    episode = make_episode(0)
    write_episode(
        data.episode_path(0), replace(episode, images=[replace(image, depth=None) for image in episode.images])
    )
    data.write_tables()
    assert data.frames("next_rgb")[0]["next_rgb"].dtype == torch.uint8
    for picture in ("depth", "next_depth"):
        with pytest.raises(BusybotError, match="000000.mcap: recorded without depth"):
            data.frames("rgb", picture)


def test_batches_of_frames(tiny: Path) -> None:
    """Also of a dataset that was recorded before tables had checksums."""
    frames = busybot.load_dataset(tiny).frames()
    order = frames.shuffled(seed=1, together=4)
    batch = next(iter(DataLoader(frames, 6, sampler=order)))
    assert batch["rgb"].shape == (6, 480, 640, 3) and batch["position"].shape == (6, 3)
    assert set(batch["step"].shape) == set(batch["reward"].shape) == {6}


def test_batches_of_workers_stay_what_they_were_while_they_are_held(folder: Path) -> None:
    frames = busybot.load_dataset(folder).frames("rgb", "next_depth")
    loader = DataLoader(frames, 4, num_workers=1, collate_fn=frames.collate)
    held = [(batch["rgb"][1:, ..., :2], batch["next_depth"]) for batch in loader]  # views, too
    assert len(held) == -(-len(frames) // 4) > 3
    for number, (rgb, depth) in enumerate(held):
        own = [frames[index] for index in range(4 * number, min(4 * number + 4, len(frames)))]
        for row, item in zip(rgb, own[1:], strict=True):
            np.testing.assert_array_equal(row, item["rgb"][..., :2])
        np.testing.assert_array_equal(depth, np.stack([item["next_depth"] for item in own]))
    plain = next(iter(DataLoader(frames, 4, collate_fn=frames.collate)))
    np.testing.assert_array_equal(plain["rgb"], np.stack([frames[index]["rgb"] for index in range(4)]))


def test_a_block_is_lent_again_when_all_views_are_gone() -> None:
    blocks, values = SharedBlocks(), [torch.full((2, 3), number, dtype=torch.float32) for number in range(4)]
    rebuild, arguments = blocks.stacked(values).__reduce__()
    received = rebuild(*arguments)
    view = received[3, 1:]
    other = blocks.stacked([one + 10 for one in values]).block
    assert len(blocks._blocks) == 2 and other is not arguments[0] and received.tolist() == torch.stack(values).tolist()
    del received
    assert blocks.stacked(values[:2]).block is not arguments[0] and view.tolist() == [[3.0] * 3]
    del view
    assert blocks.stacked(values).block is arguments[0] and len(blocks._blocks) == 3


def test_shuffled_goes_through_all_and_stays_with_some() -> None:
    episodes = np.repeat(np.arange(10), 6)
    order = Shuffled(episodes, seed=3, together=2)
    first, second = list(order), list(order)
    assert sorted(first) == list(range(60)) == sorted(second) and first != second and len(order) == 60
    assert list(Shuffled(episodes, seed=3, together=2)) == first
    for start in range(0, 60, 12):
        assert len({episodes[index] for index in first[start : start + 12]}) == 2


def test_tables_without_what_learners_may_not_see(folder: Path) -> None:
    data = busybot.load_dataset(folder)
    steps = data.to_pandas()
    assert len(steps) == len(data.frames()) and "success" not in steps and "reward" in steps
    assert "success" in data.to_pandas("steps", privileged=True) and len(data.to_pandas("episodes")) == 3
    with pytest.raises(BusybotError, match="choose among episodes"):
        data.to_pandas("boards")


def test_boards_by_seed() -> None:
    board = busybot.make_board(4, relations="one-to-one")
    assert board == busybot.make_board(4, relations="one-to-one") != busybot.make_board(5, relations="one-to-one")
    assert {relation.kind for relation in board.relations} == {"one-to-one"}
    with pytest.raises(BusybotError, match="split"):
        busybot.make_board(split="none")
    for several in ({"boards": 3}, {"group_size": 3}):
        with pytest.raises(BusybotError, match=f"make_board: {next(iter(several))}: one board is drawn"):
            busybot.make_board(4, "procedural", **several)


@pytest.mark.long
def test_models_of_any_skill_and_graphs(tiny: Path, tmp_path: Path) -> None:
    assert type(busybot.load_model("procedural")).__name__ == "AffordanceModel"
    assert type(busybot.load_model("event")).__name__ == "EventReasoner"
    with pytest.raises(BusybotError, match="no model of that name"):
        busybot.load_model("none")
    shutil.copytree(tiny, tmp_path / "tiny")  # features are kept beside it
    data = busybot.load_dataset(tmp_path / "tiny")
    graphs = data.graphs()
    assert len(graphs) == len(data)
    assert graphs[2]["step"].action.shape == (len(data[2].steps), 6)
    np.testing.assert_allclose(graphs[2]["step"].action, data[2].actions)
