"""Pictures with times in one file, and a device's log of its states: the same as from a folder of pictures."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.exporting.lerobot import RGB
from busybot.datasets.exporting.targets import export_recordings
from busybot.datasets.importing import states
from busybot.datasets.importing.camera_folder import ImportOptions
from busybot.datasets.importing.sources import import_source
from busybot.datasets.verify import verify
from busybot.episodes.codec import encode_rgb
from busybot.episodes.episode import Episode
from busybot.episodes.mcap import channels
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset
from tests.datasets.camera_folders import read_rows, write_camera_folder, write_table
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode

TOPIC = "/camera/image"


def folder_of(tmp_path: Path, episode: Episode) -> Path:
    """A recording without its pictures, whose times are 100 s, 101 s, ..."""
    folder = write_camera_folder(tmp_path / "table", episode, times=True)
    for file in [*folder.glob("*.png"), folder / "frames.csv"]:
        file.unlink()
    return folder


def write_mcap(
    file: Path, episode: Episode, topics: tuple[str, ...] = (TOPIC,), more: Sequence[Callable[[Writer], None]] = ()
) -> None:
    name = "foxglove.CompressedImage"
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start()
        schema = writer.register_schema(name, "protobuf", channels.message_schema(name))
        for topic in topics:
            channel = writer.register_channel(topic, "protobuf", schema)
            for number in range(len(episode.frame_of)):
                data = encode_rgb(episode.image(number).rgb, "png")
                message = channels.message_class(name)(data=data, format="png").SerializeToString()
                at = int((100 + number) * 1e9)
                writer.add_message(channel, at, message, at)
        for change in more:
            change(writer)
        writer.finish()


def dangling(writer: Writer) -> None:
    """A channel of a schema that is not in the file."""
    writer.add_message(writer.register_channel("/joints", "cdr", 99), 0, b"x", 0)


def in_json(writer: Writer) -> None:
    """Another camera, as JSON."""
    schema = writer.register_schema("foxglove.CompressedImage", "jsonschema", b"{}")
    writer.add_message(writer.register_channel("/json", "json", schema), 0, b"{}", 0)


def write_hdf5(file: Path, episode: Episode, packed: bool, states: list[Any] | None = None, cameras: int = 1) -> None:
    h5py = pytest.importorskip("h5py", reason="h5py is not installed: `make extras`")
    pictures = [episode.image(number).rgb for number in range(len(episode.frame_of))]
    with h5py.File(file, "w") as root:
        rows: np.ndarray = np.array(pictures)
        if packed:
            data = [encode_rgb(picture, "jpeg") for picture in pictures]
            longest = max(map(len, data))
            rows = np.array([np.frombuffer(one.ljust(longest, b"\0"), np.uint8) for one in data])
        for number in range(cameras):
            root[f"observations/images/cam_{number}"] = rows
        root["observations/timestamp"] = 100.0 + np.arange(len(pictures))
        if states is not None:
            root.create_dataset("busybox/state_json", data=[json.dumps(s) for s in states], dtype=h5py.string_dtype())
            root["busybox/timestamp"] = 100.0 + np.arange(len(pictures))


def imported(folder: Path, **options: Any) -> Dataset:
    made = import_source(folder, folder.with_name("made"), ImportOptions(**options)).dataset
    assert made is not None and verify(made.path).ok
    return made


def test_foxglove_images_in_mcap(tmp_path: Path) -> None:
    episode = make_episode(0)
    folder = folder_of(tmp_path, episode)
    write_mcap(folder / "recording.mcap", episode, (TOPIC, "/wrist"))
    with pytest.raises(BusybotError, match="which of its 2 cameras") as error:
        import_source(folder, None)
    assert "--camera" in str(error.value.hint)
    made = imported(folder, camera=TOPIC)[0]
    assert made.frame_of == episode.frame_of and np.array_equal(made.rgb[6], episode.rgb[6])
    with pytest.raises(BusybotError, match="no camera '/roof'"):
        import_source(folder, None, ImportOptions(camera="/roof"))


def test_a_channel_that_cannot_be_read_leaves_a_camera_usable(tmp_path: Path) -> None:
    episode = make_episode(0)
    folder = folder_of(tmp_path, episode)
    write_mcap(folder / "recording.mcap", episode, more=[dangling])
    assert import_source(folder, None).recordings[0]["frames"] == 7
    write_mcap(folder / "recording.mcap", episode, more=[dangling, in_json])
    with pytest.raises(BusybotError, match="which of its 2 cameras"):
        import_source(folder, None)
    with pytest.raises(BusybotError, match="/json is encoded as json"):
        import_source(folder, None, ImportOptions(camera="/json"))
    assert imported(folder, camera=TOPIC)[0].frame_of == episode.frame_of


@pytest.mark.parametrize("packed", [False, True])
def test_pictures_in_hdf5(packed: bool, tmp_path: Path) -> None:
    episode = make_episode(0)
    folder = folder_of(tmp_path, episode)
    write_hdf5(folder / "episode_0.hdf5", episode, packed)
    made = imported(folder)[0]
    assert made.frame_of == episode.frame_of
    assert np.abs(made.rgb[6].astype(int) - episode.rgb[6]).mean() < (3 if packed else 1e-9)


def state_rows(episode: Episode) -> tuple[np.ndarray, list[int]]:
    """States of all objects in each frame, those of triggers among them; and the triggers."""
    triggers = [number for number, one in enumerate(episode.board.objects) if one.role == "trigger"]
    first = episode.steps[0]
    shown = [first.responder_states_before, *(step.responder_states_after for step in episode.steps)]
    held = [first.trigger_states_before, *(step.trigger_states_after for step in episode.steps)]
    rows = np.array(shown)
    rows[:, triggers] = np.array(held)
    return rows, triggers


def with_keys(folder: Path) -> None:
    rows = read_rows(folder / "objects.csv")
    write_table(folder / "objects.csv", [row | {"state": f"box.{n}"} for n, row in enumerate(rows)])


def log_of(rows: np.ndarray) -> str:
    lines = [{"ts": 99.5 + n, "device": "box", "values": row.tolist()} for n, row in enumerate(rows)]
    return "".join(f"{json.dumps(line)}\n" for line in lines)


def test_a_log_of_states_is_joined_by_time(tmp_path: Path) -> None:
    episode = make_episode(0)
    folder = write_camera_folder(tmp_path / "table", episode, times=True)
    rows, triggers = state_rows(episode)
    with_keys(folder)
    (folder / "states.jsonl").write_text(log_of(rows))
    made = imported(folder)
    again = made[0]
    assert made.table("episodes").to_pylist()[0]["truth"] and len(again.links) == len(triggers)
    for old, new in zip(episode.steps, again.steps, strict=True):
        assert new.trigger_states_after == old.trigger_states_after
        assert new.responder_states_after == old.responder_states_after
        assert new.success == (old.trigger_states_before != old.trigger_states_after)
    result = evaluate_dataset(made, ReasonEvaluation("lookup", 4), workers=1)
    assert result["predicted_steps"] == 3 and result["pred_a"] is not None and result["edge_r_bound"] is not None


def test_a_log_of_millions_of_lines_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    episode = make_episode(0)
    folder = write_camera_folder(tmp_path / "table", episode, times=True)
    with_keys(folder)
    rows = state_rows(episode)[0]
    (folder / "states.jsonl").write_text(log_of(rows).replace("\n", "\r\n\n"))
    monkeypatch.setattr(states, "MOST_LINES", len(rows))
    assert import_source(folder, None).recordings[0]["states"]
    monkeypatch.setattr(states, "MOST_LINES", len(rows) - 1)
    with pytest.raises(BusybotError, match=rf"states.jsonl: it has more than {len(rows) - 1} lines"):
        import_source(folder, None)


def test_states_beside_pictures_in_hdf5(tmp_path: Path) -> None:
    episode = make_episode(0)
    folder, (rows, _) = folder_of(tmp_path, episode), state_rows(episode)
    with_keys(folder)
    write_hdf5(
        folder / "episode_0.hdf5", episode, True, [{"box": {"values": row.tolist()}, "eink": None} for row in rows]
    )
    steps = imported(folder)[0].steps
    assert [step.responder_states_after for step in steps] == [step.responder_states_after for step in episode.steps]


def lines(change: Callable[[list[str]], list[str]]) -> Callable[[Path], object]:
    def changed(folder: Path) -> None:
        file = folder / "states.jsonl"
        file.write_text("\n".join(change(file.read_text().splitlines())))

    return changed


WRONG: dict[str, tuple[Callable[[Path], object], str]] = {
    "another zone": (lines(lambda told: [line.replace('"ts": ', '"ts": 72') for line in told]), "its log is from 7299"),
    "backwards": (lines(lambda told: told[::-1]), "states.jsonl: line 2: its time .* before"),
    "no JSON": (lines(lambda told: [told[0], "{"]), "states.jsonl: line 2: not valid JSON"),
    "no values": (lines(lambda told: ['{"ts": 1, "values": "on"}']), "states.jsonl: line 1: its values are no numbers"),
    "beyond": (
        lines(lambda told: [f'{{"ts": 1, "values": [{"9" * 400}]}}']),
        "states.jsonl: line 1: its values .* 1e+",
    ),
    "a picture of before": (
        lambda folder: [
            write_table(
                folder / "frames.csv",
                [
                    row | {"time": str(n if n == 2 else 100 + n)}
                    for n, row in enumerate(read_rows(folder / "frames.csv"))
                ],
            ),
            write_table(
                folder / "actions.csv",
                [{k: v for k, v in row.items() if k != "time"} for row in read_rows(folder / "actions.csv")],
            ),
        ],
        "its log is from .*, the pictures from 2 s to",
    ),
    "no time": (lines(lambda told: ['{"values": [1]}']), "states.jsonl: line 1: no ts"),
    "no such key": (
        lines(lambda told: [line.replace("box", "case") for line in told]),
        "no line of the log tells of 'box.0'",
    ),
    "analog values": (
        lines(lambda told: [f'{{"ts": {n}, "device": "box", "values": [{n}, 0, 0, 0, 0]}}' for n in range(90, 110)]),
        "'box.0': 20 different values",
    ),
    "an empty log": (lines(lambda told: [""] * 9), "objects have states, but nobody logged any"),
    "no log": (lambda folder: (folder / "states.jsonl").unlink(), "objects have states, but nobody logged any"),
    "no times": (
        lambda folder: [
            write_table(
                folder / name, [{k: v for k, v in row.items() if k != "time"} for row in read_rows(folder / name)]
            )
            for name in ("frames.csv", "actions.csv")
        ],
        "states are joined by time",
    ),
}


@pytest.mark.parametrize("fault", WRONG)
def test_what_is_wrong_with_a_log_is_named(fault: str, tmp_path: Path) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0), times=True)
    with_keys(folder)
    (folder / "states.jsonl").write_text(log_of(state_rows(make_episode(0))[0]))
    spoil, message = WRONG[fault]
    spoil(folder)
    with pytest.raises(BusybotError, match=message) as error:
        import_source(folder, tmp_path / "made")
    assert error.value.hint and not (tmp_path / "made").exists()


def test_files_that_are_damaged_or_lead_elsewhere(tmp_path: Path) -> None:
    episode = make_episode(0)
    folder = folder_of(tmp_path, episode)
    (folder / "x.mcap").write_bytes(b"\x89MCAP0\r\n" + b"x" * 99)
    with pytest.raises(BusybotError, match="x.mcap: not a whole MCAP file"):
        import_source(folder, None)
    (folder / "x.mcap").unlink()
    h5py = pytest.importorskip("h5py", reason="h5py is not installed: `make extras`")
    (folder / "x.h5").write_bytes(b"nothing")
    with pytest.raises(BusybotError, match="x.h5: it cannot be read as HDF5"):
        import_source(folder, None)
    write_hdf5(tmp_path / "secret.h5", episode, False)
    with h5py.File(folder / "x.h5", "w") as root:
        root["observations/timestamp"] = np.arange(7.0)
        root["observations/images/cam"] = h5py.ExternalLink(str(tmp_path / "secret.h5"), "observations/images/cam_0")
    with pytest.raises(BusybotError, match="it has no observations/images/cam"):
        import_source(folder, None)
    write_hdf5(folder / "x.h5", episode, False)
    with h5py.File(folder / "x.h5", "a") as root:
        del root["observations/timestamp"]
        root["observations/timestamp"] = np.arange(3.0)
    with pytest.raises(BusybotError, match="3 times for 7 pictures"):
        import_source(folder, None)


def test_a_dataset_in_lerobots_layout(tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data")
    export_recordings(dataset, "lerobot", tmp_path / "lerobot")
    with pytest.raises(BusybotError, match="which of its cameras"):
        import_source(tmp_path / "lerobot", None)
    made = imported(tmp_path / "lerobot", camera=RGB)
    assert made.info.boards == 3
    for old, new in zip(dataset, made, strict=True):
        assert np.array_equal(old.rgb[6], new.rgb[6]) and new.frame_of == old.frame_of
        assert [(step.pixel, step.direction) for step in old.steps] == [(s.pixel, s.direction) for s in new.steps]
    info = tmp_path / "lerobot" / "meta" / "info.json"
    told = json.loads(info.read_text())
    told["features"]["action"]["names"] = ["joint"] * 6
    info.write_text(json.dumps(told))
    with pytest.raises(BusybotError, match="where something was held") as error:
        import_source(tmp_path / "lerobot", None, ImportOptions(camera=RGB))
    assert "--tables" in str(error.value.hint)
    for place, index in enumerate((0, 1, 3)):
        folder = write_camera_folder(tmp_path / "tables" / f"{place:06d}", make_episode(index), times=True)
        rows = [row | {"time": number + 0.5} for number, row in enumerate(read_rows(folder / "actions.csv"))]
        write_table(folder / "actions.csv", rows)
    named = import_source(
        tmp_path / "lerobot", tmp_path / "named", ImportOptions(camera=RGB, tables=tmp_path / "tables")
    )
    assert named.kind == "lerobot" and named.dataset is not None
    first = named.dataset[0]
    assert first.board.relations and np.array_equal(first.image(0).boxes, make_episode(0).image(0).boxes)
    assert np.array_equal(first.rgb[6], dataset[0].rgb[6])
