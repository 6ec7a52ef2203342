"""Pictures and CSV tables to a dataset: what the folder holds comes back, what is wrong in it is named."""

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.exporting.targets import export_recordings
from busybot.datasets.freeze import freeze
from busybot.datasets.importing.images import import_export
from busybot.datasets.importing.recording import unknown_step
from busybot.datasets.importing.sources import import_source
from busybot.datasets.repair import repair
from busybot.datasets.verify import verify
from busybot.episodes.codec import ImageFormat
from busybot.episodes.episode import Episode, Step
from busybot.episodes.mcap.reader import read_episode
from busybot.episodes.mcap.writer import write_episode
from tests.cli.commands import busybot
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode, make_task_episode


def public(step: Step) -> tuple:
    """What an export without `--privileged` has of an action."""
    distance = float(np.float32(step.distance))
    values = (step.pixel, step.position, step.direction, step.executed, step.changed_pixels, step.reward)
    return *values, distance


@pytest.mark.parametrize("images", ["jpeg", "png"])
def test_what_was_exported_comes_back(images: ImageFormat, tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", images=images)
    export_recordings(dataset, "images", tmp_path / "images")
    made = import_export(tmp_path / "images", tmp_path / "made")
    assert made.info.boards == 3 and made.finished() == {0, 1, 2}
    for number, index in enumerate(sorted(dataset.finished())):
        was, now = read_episode(dataset.episode_path(index)), read_episode(made.episode_path(number))
        assert now.frame_of == was.frame_of and [*map(public, now.steps)] == [*map(public, was.steps)]
        for old, new in zip(was.images, now.images, strict=True):
            assert np.array_equal(old.rgb, new.rgb) and new.segmentation is None
            assert np.array_equal(old.depth, new.depth)
        assert np.array_equal(was.images[0].boxes, now.images[0].boxes)
        assert np.array_equal(was.positions, now.positions, equal_nan=True)
        assert np.array_equal(was.camera.matrix, now.camera.matrix) and np.array_equal(was.camera.pose, now.camera.pose)
        assert [one.role for one in now.board.objects] == [one.role for one in was.board.objects]
        assert not now.board.relations and not now.links and not now.steps[0].trigger_states_before
    assert verify(tmp_path / "made").ok
    rows = made.table("episodes").to_pylist()
    assert not any(row["truth"] or row["segmentation"] for row in rows) and all(row["depth"] for row in rows)


def test_a_second_way_out_and_back_changes_nothing(tmp_path: Path) -> None:
    export_recordings(make_dataset(tmp_path / "data"), "images", tmp_path / "one")
    export_recordings(import_export(tmp_path / "one", tmp_path / "made"), "images", tmp_path / "two")
    again = import_export(tmp_path / "two", tmp_path / "again")
    assert again.hashes() == Dataset.open(tmp_path / "made").hashes()


@pytest.mark.parametrize("to", ["parquet", "hf", "croissant"])
@pytest.mark.parametrize("images", ["jpeg", "png"])
def test_tables_come_back_as_pictures_and_csv_do(to: str, images: ImageFormat, tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", images=images)
    made = {}
    for name in ("images", to):
        export_recordings(dataset, name, tmp_path / name)
        made[name] = import_export(tmp_path / name, tmp_path / f"made-{name}")
    assert made[to].hashes() == made["images"].hashes() and made[to].info.boards == 3
    told = import_source(tmp_path / to, None)
    assert told.kind == "parquet" and [one["actions"] for one in told.recordings] == [6, 6, 6]


def without_objects(episode: Episode) -> Episode:
    """As from a camera's folder without `objects.csv`."""
    bare, none = unknown_step((5, 5), (0.0, 0.0, 0.0), 0), np.zeros((0, 4), np.int16)
    return replace(
        episode,
        board=episode.board.model_copy(update={"objects": (), "relations": ()}),
        links=(),
        positions=np.zeros((0, 3), np.float32),
        images=[replace(image, segmentation=None, boxes=none) for image in episode.images],
        steps=[bare] * len(episode.steps),
    )


def put(dataset: Dataset, episode: Episode) -> None:
    """An episode with a board of its own."""
    dataset.replace_board(episode.board)
    write_episode(dataset.episode_path(episode.board.index), episode)


def retold(table: str, **columns: Any) -> Callable[[Path], object]:
    """Other columns in a table, made of its rows."""

    def changed(folder: Path) -> None:
        file = folder / "data" / table / "part-00000.parquet"
        rows = pq.read_table(file)
        for name, make in columns.items():
            place, values = rows.schema.get_field_index(name), rows[name].to_pylist()
            rows = rows.set_column(place, rows.schema.field(name), pa.array(make(values), rows.schema.field(name).type))
        pq.write_table(rows, file, row_group_size=7)

    return changed


def retyped(table: str, name: str, value: Any) -> Callable[[Path], object]:
    """A column in whose cells is something else, of another type."""

    def changed(folder: Path) -> None:
        file = folder / "data" / table / PART
        rows = pq.read_table(file)
        pq.write_table(rows.set_column(rows.schema.get_field_index(name), name, pa.array([value] * len(rows))), file)

    return changed


def repeated(folder: Path) -> None:
    """The last recording has another row of its own."""
    file = folder / "data" / "episodes" / PART
    rows = pq.read_table(file)
    pq.write_table(pa.concat_tables([rows, rows.slice(len(rows) - 1)]), file)


def spoilt(values: list[Any], place: int, value: Any) -> list[Any]:
    return [*values[:place], value, *values[place + 1 :]]


@pytest.mark.parametrize("to", ["images", "parquet"])
def test_recordings_of_unequal_length_belong_together(to: str, tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", boards=2, finished=[0])
    write_episode(dataset.episode_path(1), make_episode(1, steps=3))
    export_recordings(dataset, to, tmp_path / "out")
    made = import_export(tmp_path / "out", tmp_path / "made")
    assert made.info.collect is not None and made.info.collect.steps == 6
    assert verify(made.path).ok and repair(made.path).damaged == ()
    freeze(made.path, None)
    assert verify(made.path).ok and Dataset.open(made.path).table("episodes")["steps"].to_pylist() == [6, 3]


@pytest.mark.parametrize("to", ["images", "parquet"])
def test_recordings_without_objects_come_back(to: str, tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", boards=2, finished=[0])
    put(dataset, without_objects(make_episode(1)))
    export_recordings(dataset, to, tmp_path / "out")
    made = import_export(tmp_path / "out", tmp_path / "made")
    assert [len(board.objects) for board in made.boards()] == [5, 0] and verify(made.path).ok
    shutil.rmtree(dataset.path)
    dataset = make_dataset(dataset.path, boards=1, finished=[])
    put(dataset, without_objects(make_episode()))
    export_recordings(dataset, to, tmp_path / "bare")
    assert verify(import_export(tmp_path / "bare", tmp_path / "again").path).ok


def test_no_table_of_objects_where_there_are_some_is_a_fault(tmp_path: Path) -> None:
    export_recordings(make_dataset(tmp_path / "data", boards=1, finished=[0]), "images", tmp_path / "out")
    file = tmp_path / "out" / "episodes" / "000000" / "objects.csv"
    for text in (file.read_text().splitlines()[0], ""):
        file.write_text(text)
        with pytest.raises(BusybotError, match="objects.csv: it has no line with values"):
            import_export(tmp_path / "out", tmp_path / "made")


@pytest.mark.parametrize("to", ["images", "parquet"])
def test_the_picture_of_a_goal_comes_back(to: str, tmp_path: Path) -> None:
    dataset = make_dataset(tmp_path / "data", boards=2, finished=[0])
    put(dataset, make_task_episode(1))
    export_recordings(dataset, to, tmp_path / "out")
    made = import_export(tmp_path / "out", tmp_path / "made")
    was, now = dataset[1].goal, made[1].goal
    assert was is not None and now is not None and made[0].goal is None
    assert np.array_equal(was.rgb, now.rgb) and now.depth is None and (now.boxes == -1).all()
    assert verify(made.path).ok


PART = "part-00000.parquet"
ODD_TABLES: dict[str, tuple[Callable[[Path], object], str]] = {
    "no recordings of an object": (
        retold("objects", episode=lambda v: [0] * len(v)),
        "episode 1 is in the table `episodes` and not in `objects`",
    ),
    "a recording that is told of twice": (repeated, "episodes/part-00000.parquet: episode 1 has 2 rows, and not one"),
    "a recording in two places": (retold("frames", episode=lambda v: spoilt(v, 3, 1)), "is in two places"),
    "no number": (retold("frames", episode=lambda v: spoilt(v, 0, -1)), "row 1: -1 is no number"),
    "numbers in lists": (retyped("objects", "episode", [0]), r"row 1: \[0\] is no number"),
    "numbers with names": (retyped("episodes", "episode", {"a": 0}), "row 1: {'a': 0} is no number"),
    "text for pictures": (retyped("frames", "rgb", "x.png"), f"{PART}: row 1: rgb: it holds no picture"),
    "numbers for pictures": (retyped("frames", "rgb", {"bytes": 3, "path": "x"}), "row 1: rgb: it holds no picture"),
    "no bytes of pictures": (retyped("frames", "rgb", {"a": 3}), "frame 0: neither a PNG nor a JPEG"),
    "a number for a goal": (retyped("episodes", "goal", 3), f"{PART}: row 1: goal: it holds no picture"),
    "no picture": (retold("frames", rgb=lambda v: spoilt(v, 8, None)), f"{PART}: row 9: rgb"),
    "a picture that is none": (
        retold("frames", rgb=lambda v: spoilt(v, 8, {"bytes": b"x", "path": "y"})),
        "episode 1: frame 1: neither a PNG nor a JPEG",
    ),
    "two pictures of one name": (
        retold("frames", rgb=lambda v: spoilt(v, 8, {"bytes": b"x", "path": v[7]["path"]})),
        "row 9: another picture is called",
    ),
    "no direction": (retold("frames", direction=lambda v: spoilt(v, 8, None)), "line 9: an action needs"),
    "a damaged table": (lambda folder: (folder / "data" / "objects" / PART).write_bytes(b"PAR1"), f"objects/{PART}"),
    "a link": (
        lambda folder: (folder / "data" / "frames" / "more.parquet").symlink_to("/dev/zero"),
        "more.parquet: a link",
    ),
    "no table": (lambda folder: shutil.rmtree(folder / "data" / "episodes"), "episodes: it has no rows"),
}


@pytest.mark.parametrize("fault", ODD_TABLES)
def test_what_is_wrong_in_tables_is_named(fault: str, tmp_path: Path) -> None:
    export_recordings(make_dataset(tmp_path / "data", boards=2, finished=[0, 1]), "parquet", tmp_path / "tables")
    spoil, message = ODD_TABLES[fault]
    spoil(tmp_path / "tables")
    with pytest.raises(BusybotError, match=message) as error:
        import_export(tmp_path / "tables", tmp_path / "made")
    assert error.value.hint and str(tmp_path / "tables") in error.value.what
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "tables"]


def change(file: str, line: int, **cells: str) -> Callable[[Path], object]:
    """Other cells in a line of a table, counted as editors do."""

    def changed(folder: Path) -> None:
        with (folder / file).open(newline="") as text:
            rows = list(csv.DictReader(text))
        names = list(rows[0])
        rows[line - 2].update(cells)
        with (folder / file).open("w", newline="") as text:
            writer = csv.DictWriter(text, names)
            writer.writeheader()
            writer.writerows(rows)

    return changed


FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no such picture": (change("frames.csv", 3, rgb="rgb/77777.jpg"), "77777.jpg: there is no such file"),
    "a picture elsewhere": (change("frames.csv", 3, rgb="../../../../secret.png"), "leaves the folder"),
    "a picture that is none": (change("frames.csv", 2, rgb="frames.csv"), "frame 0: neither a PNG nor a JPEG"),
    "a frame is missing": (change("frames.csv", 4, frame="7"), "frames.csv: its frames are not numbered"),
    "no direction": (change("frames.csv", 3, direction=""), "frames.csv: line 3: an action needs"),
    "unknown direction": (change("frames.csv", 3, direction="18"), "line 3: there are 18 directions"),
    "no number": (change("frames.csv", 5, position_x="left"), r"frames.csv: line 5: position_x"),
    "no finite number": (change("frames.csv", 5, position_x="nan"), r"frames.csv: line 5: position_x"),
    "a pixel outside": (change("frames.csv", 2, pixel_u="160"), "outside of the image"),
    "a huge box": (change("objects.csv", 2, first_box_u0="70000"), "objects.csv: line 2: first_box_u0"),
    "two roles": (change("objects.csv", 3, role="trigger, responder"), "objects.csv: role"),
    "objects in disorder": (change("objects.csv", 3, object="4"), "not numbered"),
    "another size": (change("episodes.csv", 2, width="161"), "161 x 120 are expected"),
    "a huge size": (change("episodes.csv", 2, width="90000"), "90000 x 120 pixels"),
    "no camera": (change("episodes.csv", 2, camera_matrix="[1, 2]"), "the camera's matrix has 9 numbers"),
    "a camera that is none": (change("episodes.csv", 2, camera_matrix=json.dumps([0] * 9)), "focal lengths"),
    "no list": (change("episodes.csv", 2, camera_pose="[" * 100_000), "episodes.csv: line 2"),
    "a negative seed": (change("episodes.csv", 2, seed="-1"), "episodes.csv: line 2: seed"),
    "a huge seed": (change("episodes.csv", 2, seed=str(2**70)), "episodes.csv: line 2: seed"),
    "no table": (lambda folder: (folder / "objects.csv").unlink(), "objects.csv: there is no such file"),
    "an empty table": (lambda folder: (folder / "frames.csv").write_text("frame,rgb\n"), "no line with values"),
    "no text": (lambda folder: (folder / "frames.csv").write_bytes(b"frame\n\xff\xfe"), "frames.csv: cannot be read"),
    "an open quote": (lambda folder: (folder / "frames.csv").write_text('frame,rgb\n0,"rgb'), "frames.csv: line"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_wrong_is_named_and_nothing_half_written(fault: str, tmp_path: Path) -> None:
    export_recordings(make_dataset(tmp_path / "data", boards=2, finished=[0, 1]), "images", tmp_path / "images")
    spoil, message = FAULTS[fault]
    spoil(tmp_path / "images" / "episodes" / "000001")
    before = sorted(path.name for path in tmp_path.iterdir())
    with pytest.raises(BusybotError, match=message) as error:
        import_export(tmp_path / "images", tmp_path / "made")
    assert "000001" in error.value.what and error.value.hint
    assert sorted(path.name for path in tmp_path.iterdir()) == before


@pytest.mark.parametrize(("column", "value"), [("policy", "curious"), ("seed", "7"), ("split", "test")])
@pytest.mark.parametrize("to", ["images", "parquet"])
def test_recordings_that_a_dataset_cannot_hold_together(to: str, column: str, value: str, tmp_path: Path) -> None:
    """A dataset says one policy, seed and split of all its recordings."""
    export_recordings(make_dataset(tmp_path / "data", boards=2, finished=[0, 1]), to, tmp_path / "out")
    if to == "images":
        change("episodes.csv", 2, **{column: value})(tmp_path / "out" / "episodes" / "000001")
        files = [f"00000{number}/episodes.csv: line 2" for number in range(2)]
    else:
        other = int(value) if column == "seed" else value
        retold("episodes", **{column: lambda values: [*values[:-1], other]})(tmp_path / "out")
        files = [f"{PART}: line {number}" for number in (1, 2)]
    for out in (None, tmp_path / "made"):
        with pytest.raises(BusybotError, match=f"{column} is .*{value}") as error:
            import_source(tmp_path / "out", out)
        assert all(file in error.value.what for file in files) and error.value.hint
    assert not (tmp_path / "made").exists()


def test_links_out_of_the_folder_are_not_followed(tmp_path: Path) -> None:
    export_recordings(make_dataset(tmp_path / "data", boards=1, finished=[0]), "images", tmp_path / "images")
    shutil.move(tmp_path / "images" / "episodes" / "000000", tmp_path / "elsewhere")
    (tmp_path / "images" / "episodes" / "000000").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BusybotError, match="000000: a link"):
        import_export(tmp_path / "images", tmp_path / "made")


def test_the_command(tmp_path: Path) -> None:
    export_recordings(make_dataset(tmp_path / "data"), "images", tmp_path / "boards-images")
    out = tmp_path / "made"
    done = busybot("dataset", "import", tmp_path / "boards-images", "--out", out, "--json")
    told = json.loads(done.stdout)
    assert done.returncode == 0 and (told["dataset"], told["kind"], told["episodes"]) == (str(out), "images", 3)
    assert told["recordings"][0]["actions"] == 6
    again = busybot("dataset", "import", tmp_path / "boards-images", "--out", out)
    assert again.returncode == 1 and "not an empty folder" in again.stderr
    none = busybot("dataset", "import", tmp_path / "data", "--out", tmp_path / "x")
    assert none.returncode == 1 and "episodes/000000" in none.stderr


def test_a_dry_run_of_an_export_reads_its_pictures(tmp_path: Path) -> None:
    export_recordings(make_dataset(tmp_path / "d", boards=1, finished=[0]), "images", tmp_path / "images")
    assert busybot("dataset", "import", tmp_path / "images", "--dry-run").returncode == 0
    picture = next((tmp_path / "images").rglob("*.png"))
    picture.write_bytes(picture.read_bytes()[:100])
    dry = busybot("dataset", "import", tmp_path / "images", "--dry-run")
    assert dry.returncode == 1 and "error: " in dry.stderr
