"""HDF5 and LeRobot's tables from strangers, as `tests.hostile` found them: errors that name the file, no other file."""

import json
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from busybot.common.errors import BusybotError
from busybot.datasets.exporting.lerobot import RGB
from busybot.datasets.exporting.targets import export_recordings
from busybot.datasets.importing import camera_pictures, containers
from busybot.datasets.importing import lerobot as reader
from busybot.datasets.importing.camera_folder import ImportOptions
from busybot.datasets.importing.sources import import_source
from tests.datasets.camera_folders import read_rows, write_table, write_video
from tests.datasets.test_imports_of_containers import TOPIC, folder_of, state_rows, with_keys, write_hdf5, write_mcap
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode
from tests.hostile.containers import _one_frame, repeated_frame

CAMERA, TIMES, LOG = "observations/images/cam_0", "observations/timestamp", "busybox/state_json"


def hdf5_folder(tmp_path: Path) -> Path:
    """A recording of pictures and states in one HDF5 file; beside it one with a secret picture."""
    episode = make_episode(0)
    folder = folder_of(tmp_path, episode)
    with_keys(folder)
    log = [{"box": {"values": row.tolist()}} for row in state_rows(episode)[0]]
    write_hdf5(folder / "x.h5", episode, True, log)
    write_hdf5(tmp_path / "secret.h5", make_episode(1), False)
    (tmp_path / "raw").write_bytes(bytes(7 * 120 * 160 * 3))
    return folder


def refused(folder: Path, match: str, named: str = "x.h5") -> None:
    with pytest.raises(BusybotError, match=match) as error:
        import_source(folder, folder.with_name("made"))
    assert named in error.value.what and error.value.hint
    assert not [path.name for path in folder.parent.iterdir() if "made" in path.name]


@pytest.mark.long
def test_a_file_in_which_the_library_finds_no_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The heap of texts holds an object of no bytes: HDF5 2.0 steps over it for ever."""
    folder = hdf5_folder(tmp_path)
    whole = (folder / "x.h5").read_bytes()
    heap = whole.index(b"GCOL") + 16
    import_source(folder, None)  # the reader has started: 2 s would be few for that
    (folder / "x.h5").write_bytes(whole[:heap] + bytes(2000) + whole[heap + 2000 :])
    monkeypatch.setattr(containers, "PIECE_SECONDS", 2.0)
    monkeypatch.setattr(containers._reader(), "_timeout_s", 2.0)
    refused(folder, "it is damaged: no end after 2 s at busybox/state_json")
    monkeypatch.undo()
    (folder / "x.h5").write_bytes(whole)
    assert import_source(folder, None).recordings[0]["states"], "another reader is started"


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("kind", ["mcap", "hdf5", "avi"])
def test_a_file_without_pictures_is_named(kind: str, timed: bool, tmp_path: Path) -> None:
    episode = make_episode(0)
    folder, none, camera = folder_of(tmp_path, episode), replace(episode, frame_of=[]), {"mcap": TOPIC, "hdf5": "cam_0"}
    if kind == "mcap":
        write_mcap(folder / "x.mcap", none)
    elif kind == "hdf5":
        write_hdf5(folder / "x.hdf5", none, False)
    else:
        write_video(folder / "x.avi", [episode.image(0).rgb])
        film = (folder / "x.avi").read_bytes()
        (folder / "x.avi").write_bytes(film[: film.index(b"movi") + 4])
    if not timed:
        rows = read_rows(folder / "actions.csv")
        write_table(folder / "actions.csv", [{k: v for k, v in row.items() if k != "time"} for row in rows])
    with pytest.raises(BusybotError, match=f"x.{kind}: no picture.*{camera.get(kind, '')}") as error:
        import_source(folder, None, ImportOptions(fps=30.0 if kind == "avi" else None))
    assert error.value.hint


BUDGETS: dict[str, dict[str, float]] = {
    "more than 4 frames": {"MAX_VIDEO_FRAMES": 4},
    "more than 100000 pixels in all": {"MAX_VIDEO_PIXELS": 100_000, "MAX_VIDEO_RATIO": 0},
    "more than the 0 s": {"MAX_VIDEO_SECONDS": 0.0},
    "frames of 160 x 120 pixels, at most 1000": {"MAX_IMAGE_PIXELS": 1000},
}


@pytest.mark.parametrize("told", BUDGETS)
def test_a_video_costs_no_more_than_is_said(tmp_path: Path, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether its frames are counted or named."""
    episode = make_episode(0)
    folder = folder_of(tmp_path, episode)
    write_video(folder / "x.mp4", [episode.image(number).rgb for number in range(7)])
    write_table(
        folder / "actions.csv", [row | {"time": n + 0.5} for n, row in enumerate(read_rows(folder / "actions.csv"))]
    )
    assert import_source(folder, None, ImportOptions(fps=1.0)).recordings[0]["frames"] == 7
    for name, limit in BUDGETS[told].items():
        monkeypatch.setattr(camera_pictures, name, limit)
    for fps in (1.0, None):
        with pytest.raises(BusybotError, match=f"x.mp4: {told}") as error:
            import_source(folder, tmp_path / "made", ImportOptions(fps=fps))
        assert error.value.hint and not (tmp_path / "made").exists()
        write_table(folder / "frames.csv", [{"time": float(number)} for number in range(7)])


def test_a_small_file_of_a_million_frames_is_refused_early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = folder_of(tmp_path, make_episode(0))
    (folder / "x.mp4").write_bytes(repeated_frame(_one_frame(160, 120), 10**6))
    monkeypatch.setattr(camera_pictures, "MAX_VIDEO_FRAMES", 2000)
    with pytest.raises(BusybotError, match="x.mp4: more than 2000 frames"):
        import_source(folder, None, ImportOptions(fps=1.0))


def replaced(place: str, value: Any) -> Callable[[Any, Any], None]:
    def change(root: Any, h5py: Any) -> None:
        del root[place]
        root[place] = value(h5py) if callable(value) else value

    return change


def virtual(root: Any, h5py: Any) -> None:
    layout = h5py.VirtualLayout((7, 120, 160, 3), "u1")
    layout[:] = h5py.VirtualSource("../secret.h5", CAMERA, (7, 120, 160, 3))
    del root[CAMERA]
    root.create_virtual_dataset(CAMERA, layout)


def stored_elsewhere(root: Any, h5py: Any) -> None:
    del root[CAMERA]
    raw = str(Path(root.filename).parents[1] / "raw")
    root.create_dataset(CAMERA, (7, 120, 160, 3), "u1", external=[(raw, 0, h5py.h5f.UNLIMITED)])


def unpacked_bomb(root: Any, h5py: Any) -> None:
    """A chunk that says it has 3 MB and unpacks to 1.5 GB."""
    del root[CAMERA]
    made = root.create_dataset(CAMERA, (7, 1000, 1000, 3), "u1", chunks=(1, 1000, 1000, 3), compression="gzip")
    packer = zlib.compressobj(1)
    packed = b"".join(packer.compress(bytes(50_000_000)) for _ in range(30)) + packer.flush()
    made.id.write_direct_chunk((0, 0, 0, 0), packed)


def huge(root: Any, h5py: Any) -> None:
    """So many pixels that their number, as an int64, is 0."""
    del root[CAMERA]
    root.create_dataset(CAMERA, (7, 2**32, 2**32, 3), "u1", chunks=(1, 64, 64, 3))


def odd_name(root: Any, h5py: Any) -> None:
    folder = root["observations/images"]
    h5py.h5o.link(folder["cam_0"].id, folder.id, b"\xff\xfe")


NAN = np.array([100.0, 101, np.nan, 103, 104, 105, 106])
CHANGES: dict[str, tuple[Callable[[Any, Any], None], str | None]] = {
    "circle": (replaced("observations/images", lambda h5py: h5py.SoftLink("/observations/images")), "no camera is in"),
    "another file": (
        replaced("observations", lambda h5py: h5py.ExternalLink("../secret.h5", "observations")),
        "no camera is in it",
    ),
    "virtual": (virtual, "cam_0 is no array in this file"),
    "stored elsewhere": (stored_elsewhere, "cam_0 is no array in this file"),
    "no values": (replaced(TIMES, lambda h5py: h5py.Empty("f8")), "timestamp is no array in this file"),
    "no number": (replaced(TIMES, NAN), r"timestamp\[2\] is no time: nan"),
    "complex": (replaced(TIMES, NAN * 1j), "timestamp holds complex128, neither numbers nor texts"),
    "texts as times": (replaced(TIMES, NAN.astype("S9")), r"timestamp\[0\] is no time: 100.0"),
    "numbers as texts": (replaced(LOG, np.arange(7)), "state_json holds numbers"),
    "no UTF-8": (replaced(LOG, np.array([b"\xff"] * 7)), r"state_json\[0\]: 'utf-8' codec"),
    "empty pictures": (replaced(CAMERA, np.zeros((7, 0, 0, 3), np.uint8)), r"cam_0 is uint8 \(7, 0, 0, 3\)"),
    "huge": (huge, r"cam_0 is uint8 \(7, 4294967296, 4294967296, 3\)"),
    "bomb": (unpacked_bomb, "cam_0.*|it is damaged|memory"),
    "a name of no text": (odd_name, None),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_an_hdf5_file_may_hold(change: str, tmp_path: Path) -> None:
    folder, (spoil, message) = hdf5_folder(tmp_path), CHANGES[change]
    h5py = pytest.importorskip("h5py", reason="h5py is not installed: `make extras`")
    with h5py.File(folder / "x.h5", "a") as root:
        spoil(root, h5py)
    if message is None:
        assert import_source(folder, None).recordings[0]["frames"] == 7
    else:
        refused(folder, message)


def lerobot(tmp_path: Path) -> tuple[Path, pa.Table]:
    """A dataset of LeRobot's layout, its one table, and what is in it."""
    export_recordings(make_dataset(tmp_path / "data", boards=2, finished=(0, 1)), "lerobot", tmp_path / "lerobot")
    (file,) = (tmp_path / "lerobot").glob("data/*/*.parquet")
    return file, pq.read_table(file)


def cells(name: str, row: int, value: Any) -> Callable[[pa.Table], pa.Table]:
    def change(table: pa.Table) -> pa.Table:
        values = table[name].to_pylist()
        values[row] = value
        return table.set_column(table.column_names.index(name), name, pa.array(values))

    return change


TABLES: dict[str, tuple[Callable[[pa.Table], pa.Table], str]] = {
    "no pixel": (cells("pixel", 1, None), "row 1: the action has no pixel"),
    "half a pixel": (cells("pixel", 1, [3]), "row 1: the action has no pixel"),
    "no action": (cells("action", 1, None), "row 1: the action has no pixel"),
    "holes": (cells("action", 1, [None] * 6), "row 1: the action has no pixel"),
    "no time": (cells("timestamp", 2, float("nan")), "row 2: no episode_index, or no timestamp"),
    "backwards": (cells("timestamp", 2, 0.0), "row 2: of episode 0, but not after .*row 1"),
    "no column": (lambda table: table.drop_columns(["timestamp"]), "it has 0 columns 'timestamp'"),
    "twice": (lambda table: table.append_column("pixel", table["pixel"]), "it has 2 columns 'pixel'"),
    "many rows": (lambda table: pa.concat_tables([table] * 9), "126 rows, at most 100 are read"),
}


@pytest.mark.parametrize("change", TABLES)
def test_what_a_table_may_hold(change: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(containers, "MOST_FRAMES", 100)
    (file, table), (spoil, message) = lerobot(tmp_path), TABLES[change]
    pq.write_table(spoil(table), file)
    with pytest.raises(BusybotError, match=message) as error:
        import_source(tmp_path / "lerobot", tmp_path / "made", ImportOptions(camera=RGB))
    assert file.name in error.value.what and error.value.hint and not (tmp_path / "made").exists()


def test_an_episode_in_two_tables_is_not_read_from_the_first(tmp_path: Path) -> None:
    """Its pictures were once taken from the first file alone, whatever the rows of the second say."""
    file, table = lerobot(tmp_path)
    pq.write_table(table.slice(0, 3), file)
    pq.write_table(table.slice(3), file.with_name("file-001.parquet"))
    with pytest.raises(BusybotError, match="file-001.parquet: row 0: of episode 0, but not after"):
        import_source(tmp_path / "lerobot", None, ImportOptions(camera=RGB))


def test_a_long_episode_is_refused_before_anything_is_made_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reader, "MOST_ROWS", 6)
    file, _ = lerobot(tmp_path)
    with pytest.raises(BusybotError, match=f"{file.name}: row 6: episode 0 has more than 6 rows"):
        import_source(tmp_path / "lerobot", None, ImportOptions(camera=RGB))


def test_pages_that_are_damaged_are_told_of(tmp_path: Path) -> None:
    file, _ = lerobot(tmp_path)
    data = bytearray(file.read_bytes())
    data[4:4000] = bytes(3996)
    file.write_bytes(data)
    with pytest.raises(BusybotError, match="cannot be read") as error:
        import_source(tmp_path / "lerobot", tmp_path / "made", ImportOptions(camera=RGB))
    assert file.name in error.value.what and not (tmp_path / "made").exists()


def test_rows_are_found_in_any_group(tmp_path: Path) -> None:
    file = tmp_path / "x.parquet"
    pq.write_table(pa.table({"picture": [bytes([n]) for n in range(50)]}), file, row_group_size=7)
    for numbers in ([0], [13, 14], [6, 7, 48, 49], list(range(50))):
        assert [found[0] for found in containers.container_pictures(file, "picture", numbers)] == numbers
    with pytest.raises(BusybotError, match="it has no row 50"):
        list(containers.container_pictures(file, "picture", [3, 50]))


def test_a_log_that_does_not_fit_is_named(tmp_path: Path) -> None:
    folder = hdf5_folder(tmp_path)
    (folder / "states.jsonl").write_text(json.dumps({"ts": 5000.0, "device": "box", "values": [0] * 5}) + "\n")
    refused(folder, "states.jsonl: 'box.0': its log is from", "states.jsonl")


def test_a_link_in_place_of_what_a_dataset_says_of_itself(tmp_path: Path) -> None:
    lerobot(tmp_path)
    info = tmp_path / "lerobot" / "meta" / "info.json"
    info.unlink()
    info.symlink_to("nowhere")
    with pytest.raises(BusybotError, match="meta/info.json: there is no such file"):
        import_source(tmp_path / "lerobot", None, ImportOptions(camera=RGB))
