"""A camera's folder to a dataset: the same graph as of the recording itself; what is wrong in it is named."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from busybot.boards.directions import DIRECTIONS, direction_named
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.datasets.freeze import freeze
from busybot.datasets.importing import csv_tables, proposals, recording
from busybot.datasets.importing.camera_folder import ImportOptions
from busybot.datasets.importing.camera_pictures import decode_bytes
from busybot.datasets.importing.recording import imported_info
from busybot.datasets.importing.sources import import_source
from busybot.datasets.verify import verify
from busybot.episodes.codec import ImageFormat, encode_rgb
from busybot.episodes.episode import Episode
from busybot.episodes.mcap.reader import read_episode
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset, judge_episode
from busybot.reason.inputs.feature_store import features_of
from tests.cli.commands import busybot
from tests.datasets.camera_folders import read_rows, write_camera_folder, write_table, write_video
from tests.episodes.synthetic import make_episode

TINY = Path(__file__).resolve().parents[2] / "datasets" / "tiny"


def imported(folder: Path, options: ImportOptions | None = None) -> Dataset:
    made = import_source(folder, folder.with_name(f"{folder.name}-set"), options).dataset
    assert made is not None
    return made


def recorded(index: int = 0) -> Episode:
    return read_episode(TINY / "episodes" / f"{index:06d}.mcap")


@pytest.mark.parametrize("model", ["count", "event"])
@pytest.mark.parametrize("camera", [True, False])
def test_the_imported_recording_gives_the_same_graph(model: str, camera: bool, tmp_path: Path) -> None:
    episode = recorded(1)
    made = imported(write_camera_folder(tmp_path / "table", episode, camera=camera, times=not camera, png=camera))
    features = None, None
    if model == "event":
        tiny = features_of(Dataset.open(TINY), store=tmp_path / "features", episodes=[1], workers=1)
        features = tiny[1], features_of(made, workers=1)[0]
    direct = judge_episode(episode, ReasonEvaluation(model, 14), features[0])
    again = judge_episode(made[0], ReasonEvaluation(model, 14), features[1])
    far = np.abs(direct.graph.probabilities - again.graph.probabilities).max()
    assert far == 0 if camera or model == "count" else far < 0.02
    assert np.array_equal(direct.graph.claimed(13), again.graph.claimed(13))
    assert again.counts(13)["hits"] == again.counts(13)["claimed"] == again.counts(13)["true"] == 5


def test_what_is_missing_stays_missing_and_everything_else_works(tmp_path: Path) -> None:
    for index in (0, 1):
        write_camera_folder(tmp_path / "boards" / f"{index}", make_episode(index), relations=False)
    made = imported(tmp_path / "boards")
    assert made.info.boards == 2 and verify(made.path).ok
    rows = made.table("episodes").to_pylist()
    assert not any(row["truth"] or row["segmentation"] or row["depth"] for row in rows)
    assert [one.category for one in made[0].board.objects][0].startswith("switch")
    told: list[np.ndarray] = []
    result = evaluate_dataset(made, ReasonEvaluation("count", 7), workers=1, each=lambda _, one: told.append(one.graph))
    assert result["edge_p"] is None and result["edge_r"] is None and result["shd"] is None and result["boards"] == 2
    assert len(told) == 2 and told[0].claimed(6).sum() == 2  # type: ignore[attr-defined]
    assert freeze(made.path, None).new and verify(made.path).ok
    card = (made.path / "README.md").read_text()
    assert "imported by busybot" in card and "simulator's truth" not in card and "regenerate" not in card


def test_pictures_of_the_camera_are_those_of_the_dataset(tmp_path: Path) -> None:
    episode = make_episode(0)
    made = imported(write_camera_folder(tmp_path / "table", episode, camera=True, times=True))[0]
    assert made.frame_of == episode.frame_of
    for old, new in zip(episode.images, made.images, strict=True):
        assert np.array_equal(old.rgb, new.rgb) and np.abs(np.subtract(old.depth, new.depth)).max() < 1e-4
    assert [step.pixel for step in made.steps] == [step.pixel for step in episode.steps]
    np.testing.assert_allclose(made.actions, episode.actions, atol=1e-6)


def test_points_alone_and_corners_in_place_of_a_pose(tmp_path: Path) -> None:
    folder, episode = write_camera_folder(tmp_path / "table", make_episode(0), camera=True), make_episode(0)
    rows = [{key: value for key, value in row.items() if key not in "uv"} for row in read_rows(folder / "actions.csv")]
    write_table(folder / "actions.csv", rows)
    width, height, focal = episode.camera.width, episode.camera.height, episode.camera.matrix[0, 0]
    side, told = 2 * focal / episode.camera.pose[2, 3], json.loads((folder / "camera.json").read_text())
    del told["pose"]
    u, v = width / 2, height / 2
    told["corners"] = [[u - side, v - side], [u + side, v - side], [u + side, v + side], [u - side, v + side]]
    (folder / "camera.json").write_text(json.dumps(told))
    made = imported(folder)[0]
    np.testing.assert_allclose(made.camera.pose, episode.camera.pose, atol=1e-5)
    seen = np.abs(np.subtract([step.pixel for step in made.steps], [step.pixel for step in episode.steps]))
    assert (seen <= 1).all()


def test_a_video_with_the_times_of_its_frames(tmp_path: Path) -> None:
    episode = make_episode(0)
    folder = write_camera_folder(tmp_path / "table", episode, times=True)
    pictures = [episode.image(number).rgb for number in range(len(episode.frame_of))]
    for file in folder.glob("*.png"):
        file.unlink()
    write_video(folder / "board.mp4", pictures)
    write_table(folder / "frames.csv", [{"time": 100 + number} for number in range(len(pictures))])
    made = imported(folder)[0]
    assert len(made.frame_of) == 7
    assert np.abs(made.rgb[6].astype(int) - pictures[6]).mean() < 12  # as far as a video keeps colours
    (folder / "frames.csv").unlink()
    with pytest.raises(BusybotError, match="when was each of its frames taken") as error:
        import_source(folder, None)
    assert "--fps" in str(error.value.hint)
    shifted = import_source(folder, None, ImportOptions(fps=1.0, shift=-100.0))
    assert shifted.dataset is None and shifted.recordings[0]["last"] == "board.mp4, frame 6"


def test_smaller_pictures_move_boxes_and_pixels(tmp_path: Path) -> None:
    episode = make_episode(0)
    folder = write_camera_folder(tmp_path / "table", episode, camera=True)
    made = imported(folder, ImportOptions(width=80))[0]
    assert made.image(0).rgb.shape == (60, 80, 3) and np.allclose(
        made.camera.matrix[0, 0], episode.camera.matrix[0, 0] / 2
    )
    assert np.abs(made.image(0).boxes * 2 - episode.image(0).boxes).max() <= 2
    assert [step.pixel for step in made.steps] == [(u // 2, v // 2) for u, v in (step.pixel for step in episode.steps)]
    rows = read_rows(folder / "actions.csv")
    write_table(folder / "actions.csv", [rows[0] | {"u": "-1", "v": "-1"}, *rows[1:]])
    with pytest.raises(BusybotError, match=r"actions\.csv: line 2: pixel \(-1, -1\) is outside"):
        import_source(folder, None, ImportOptions(width=80))


def test_a_dataset_that_cannot_be_is_refused(tmp_path: Path) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0))
    with pytest.raises(BusybotError, match="not an empty folder"):
        import_source(folder, Path("/"))
    with pytest.raises(BusybotError, match=r"long: collect\.steps: .* less than or equal to 100000") as error:
        imported_info("made", 1, {"policy": "human", "steps": 100_001}, ("long", "divide it"))
    assert error.value.hint == "divide it"


@pytest.mark.parametrize("camera", [True, False])
def test_proposed_boxes_lead_to_the_same_relations(camera: bool, tmp_path: Path) -> None:
    episode = recorded(1)
    folder = write_camera_folder(tmp_path / "table", episode, camera=camera, relations=False)
    (folder / "objects.csv").unlink()
    made = imported(folder, ImportOptions(proposed=True))[0]
    true, boxes = (one.image(0).boxes.astype(float) for one in (episode, made))
    middles = np.stack([boxes[:, ::2].mean(1), boxes[:, 1::2].mean(1)], 1)[:, None]
    inside = ((true[:, :2] <= middles) & (middles < true[:, 2:])).all(-1)
    assert (inside.sum(1) >= 1).all()
    centres = np.stack([true[:, ::2].mean(1), true[:, 1::2].mean(1)], 1)
    owner = np.linalg.norm(middles - centres, axis=-1).argmin(1)
    roles = [one.role for one in episode.board.objects]
    assert [one.role for one in made.board.objects] == [roles[number] for number in owner]
    claimed = judge_episode(made, ReasonEvaluation("count", 14)).graph.claimed(13)
    found = {(int(owner[i]), int(owner[j])) for i, j in np.argwhere(claimed)}
    assert found == {(t.object, one.responder) for one in episode.board.relations for t in one.triggers}


def test_roles_are_proposed_from_points_as_from_pixels(tmp_path: Path) -> None:
    folder = write_camera_folder(tmp_path / "table", recorded(1), camera=True, relations=False)
    (folder / "objects.csv").unlink()
    told = [import_source(folder, None, ImportOptions(proposed=True)).recordings[0]]
    rows = [{key: value for key, value in row.items() if key not in "uv"} for row in read_rows(folder / "actions.csv")]
    write_table(folder / "actions.csv", rows)
    told.append(import_source(folder, None, ImportOptions(proposed=True)).recordings[0])
    assert told[0]["triggers"] == told[1]["triggers"] == 3 and told[0]["responders"] == told[1]["responders"] == 5


def test_a_pixel_outside_is_named_before_boxes_are_proposed(tmp_path: Path) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0), relations=False)
    (folder / "objects.csv").unlink()
    cells("actions.csv", 3, u="500")(folder)
    with pytest.raises(BusybotError, match=r"actions.csv: line 3: pixel \(500, .*outside of pictures of 160 x 120"):
        import_source(folder, None, ImportOptions(proposed=True))


def test_a_recording_that_is_too_large_is_refused_before_boxes_are_proposed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0), relations=False)
    (folder / "objects.csv").unlink()
    monkeypatch.setattr(recording, "MAX_PIXELS", 6 * 160 * 120)
    monkeypatch.setattr(proposals, "propose", lambda *_: pytest.fail("it looked at the pictures"))
    with pytest.raises(BusybotError, match="7 pictures of 160 x 120 pixels, at most 115200 in all"):
        import_source(folder, None, ImportOptions(proposed=True))


def test_a_table_of_millions_of_lines_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A line takes a hundred times as much memory as in its file."""
    folder = write_camera_folder(tmp_path / "table", make_episode(0), times=True)
    monkeypatch.setattr(csv_tables, "MOST_LINES", 6)
    with pytest.raises(BusybotError, match=r"frames.csv: it has more than 6 lines"):
        import_source(folder, None)
    monkeypatch.setattr(csv_tables, "MOST_LINES", 7)
    assert import_source(folder, None).recordings[0]["frames"] == 7


def test_boxes_are_proposed_in_the_smallest_pictures(tmp_path: Path) -> None:
    """Where nothing changed, around what was acted on."""
    folder = tmp_path / "table"
    folder.mkdir()
    for number in range(2):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((20, 24, 3), 90, np.uint8))
    write_table(folder / "actions.csv", [{"u": 12, "v": 10, "direction": "press"}])
    made = imported(folder, ImportOptions(proposed=True))[0]
    assert made.image(0).boxes.tolist() == [[11, 9, 13, 11]] and made.board.objects[0].role == "trigger"


def test_without_boxes_nothing_is_inferred(tmp_path: Path) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0), relations=False)
    (folder / "objects.csv").unlink()
    made = imported(folder)
    assert not made[0].board.objects and verify(made.path).ok
    assert evaluate_dataset(made, ReasonEvaluation("count", 7), workers=1)["counts"]["claimed"] == 0
    done = busybot("dataset", "import", folder, "--out", tmp_path / "again")
    assert f"busybot annotate {tmp_path / 'again'}" in done.stderr


def test_directions_in_words() -> None:
    for word, vector in {"left": (-1, 0, 0), "Up-Left": (-1, 1, 0), "press": (0, 0, -1), "pull": (0, 0, 1)}.items():
        assert DIRECTIONS[direction_named(word)] @ np.array(vector) > 0.99 * np.linalg.norm(vector)
    assert direction_named(" 17 ") == 17
    for wrong in ("", "18", "left-left", "left-right", "up-left-press", "sideways", "-1"):
        with pytest.raises(BusybotError, match="direction"):
            direction_named(wrong)


def cells(file: str, line: int, /, **values: object) -> Callable[[Path], object]:
    """Other cells in a line of a table, counted as editors do; in all lines with 0."""

    def changed(folder: Path) -> None:
        rows = read_rows(folder / file)
        for number, row in enumerate(rows, start=2):
            if line in (0, number):
                row.update({key: value(row) if callable(value) else value for key, value in values.items()})
        write_table(folder / file, rows)

    return changed


def without(file: str, column: str) -> Callable[[Path], object]:
    def changed(folder: Path) -> None:
        write_table(folder / file, [{k: v for k, v in row.items() if k != column} for row in read_rows(folder / file)])

    return changed


def cut(name: str, keep: int) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_bytes((folder / name).read_bytes()[:keep])


def zoned(row: dict[str, str]) -> str:
    return str(float(row["time"]) + 7200)


def relation(cause: str, effect: str) -> Callable[[Path], object]:
    return lambda folder: write_table(folder / "relations.csv", [{"cause": cause, "effect": effect}])


def write(name: str, data: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(data)


def without_last(folder: Path) -> None:
    write_table(folder / "frames.csv", read_rows(folder / "frames.csv")[:-1])


FAULTS: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "a log in another zone": (cells("actions.csv", 0, time=zoned), "actions.csv: line 2: the action", "--shift -7200"),
    "a log of another day": (cells("actions.csv", 0, time=lambda row: float(row["time"]) + 1e6), "outside", "--shift"),
    "times that end too late": (cells("actions.csv", 7, time="900"), "actions.csv: line 7: the action", "cut"),
    "times backwards": (
        cells("actions.csv", 4, time="101"),
        "actions.csv: line 4: its time 101 s is not after",
        "order",
    ),
    "no time": (cells("actions.csv", 4, time=""), "actions.csv: line 4: no time", "every line"),
    "a time that is none": (cells("frames.csv", 3, time="noon"), "frames.csv: line 3: 'noon' is no time", "seconds"),
    "two actions between pictures": (cells("actions.csv", 3, time="100.7"), "line 2: no picture shows", "hand"),
    "times of actions alone": (lambda f: (f / "frames.csv").unlink(), "when was each picture taken", "frames.csv"),
    "times of pictures alone, one picture less": (
        lambda folder: (without("actions.csv", "time")(folder), without_last(folder)),
        "6 actions need 7 pictures",
        "column time to actions.csv",
    ),
    "a picture is missing": (lambda f: (f / "IMG_0003.png").unlink(), "frames.csv: line 5: there is no", "put it"),
    "a picture is cut": (cut("IMG_0003.png", 900), "frames.csv: line 5: .*IMG_0003.png: the picture is cut", "copy"),
    "a picture that is none": (write("IMG_0003.png", "x" * 99), "line 5: .*neither a PNG nor a JPEG", "JPEG or PNG"),
    "pictures of two sizes": (
        lambda folder: cv2.imwrite(str(folder / "IMG_0002.png"), np.zeros((9, 9, 3), np.uint8)),
        "line 4: IMG_0002.png has 9 x 9 pixels, the first picture 160 x 120",
        "one size",
    ),
    "a picture elsewhere": (cells("frames.csv", 3, file="../../x.png"), "line 3: .*leaves the folder", "copy"),
    "a box outside": (cells("objects.csv", 3, u1="161"), "objects.csv: line 3: the box .* outside of pictures", "u0"),
    "an empty box": (cells("objects.csv", 3, u0="60", u1="60"), "objects.csv: line 3: the box", "left and right"),
    "half a box": (cells("objects.csv", 3, u1=""), "objects.csv: line 3: a side of the box is missing", "none of them"),
    "two roles": (cells("objects.csv", 3, role="trigger, responder"), "objects.csv: line 3: role", "one of them"),
    "two roles in two lines": (cells("objects.csv", 3, name="switch 0"), "line 3: 'switch 0' stands in line 2", "one"),
    "no role": (without("objects.csv", "role"), "objects.csv: line 2: role", "columns are name, role"),
    "an unknown direction": (cells("actions.csv", 3, direction="sideways"), "line 3: 'sideways' is no", "press"),
    "no direction": (
        without("actions.csv", "direction"),
        "actions.csv: line 2: in which direction",
        "column direction",
    ),
    "no place": (without("actions.csv", "u"), "actions.csv: line 2: where was the action", "u and v"),
    "a pixel outside": (cells("actions.csv", 3, u="160"), "actions.csv: line 3: pixel", "columns from the left"),
    "an effect that is not there": (
        relation("switch 0", "bell"),
        "relations.csv: line 2: .*'bell'",
        "names or numbers",
    ),
    "an object that is its own cause": (
        relation("lamp 1", "lamp 1"),
        "relations.csv: line 2: 'lamp 1' is its own",
        "names",
    ),
    "an effect that is a trigger": (relation("1", "switch 0"), "'switch 0' is a trigger, not a responder", "names"),
    "a camera that is none": (
        write("camera.json", '{"matrix": [[1, 2]]}'),
        "camera.json: give pose, or corners",
        "pose",
    ),
    "a camera without numbers": (
        write("camera.yaml", "matrix: [[1, 2]]\npose: [[1]]"),
        "numbers are not as many",
        "3 x 3",
    ),
    "corners that are one": (
        write(
            "camera.json",
            '{"matrix": [[50, 0, 80], [0, 50, 60], [0, 0, 1]], "corners": [[9, 9], [9, 9], [9, 9], [9, 9]]}',
        ),
        "no camera sees a board with such corners",
        "upper left",
    ),
    "two cameras": (
        lambda folder: (write("camera.json", "{}")(folder), write("camera.yaml", "{}")(folder)),
        "which of them tells of the camera",
        "leave one",
    ),
    "a cause without an effect": (relation("switch 0", " "), "relations.csv: line 2: .*no object", "an effect"),
    "an effect without a cause": (relation(" ", "lamp 1"), "relations.csv: line 2: .*no object", "a cause"),
    "commas in numbers": (
        write("actions.csv", "time,u,v,direction\n100.5,9,9,up\n101.5,12,5,9,up"),
        "actions.csv: line 3: 5 cells, its first line has 4",
        "decimal",
    ),
    "a column twice": (
        write("actions.csv", "time,u,v,direction, u\n100.5,9,9,up,12"),
        "actions.csv: its column 'u' stands there twice",
        "leave one",
    ),
    "a thousand objects": (
        write("objects.csv", "name,role\n" + "".join(f"a{n},trigger\n" for n in range(1000))),
        "objects.csv: it has 1000 objects",
        "at most 64",
    ),
    "an open quote": (write("actions.csv", 'time,u\n"1'), "actions.csv: line", "own-recordings"),
    "no text": (lambda folder: (folder / "actions.csv").write_bytes(b"\xff\xfe\x00"), "cannot be read as text", "own"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_wrong_is_named_and_nothing_half_written(fault: str, tmp_path: Path) -> None:
    for name in ("good", "spoilt"):
        write_camera_folder(tmp_path / "boards" / name, make_episode(0), times=True)
    spoil, message, hint = FAULTS[fault]
    spoil(tmp_path / "boards" / "spoilt")
    with pytest.raises(BusybotError, match=message) as error:
        import_source(tmp_path / "boards", tmp_path / "made")
    assert "spoilt" in error.value.what and hint in str(error.value.hint)
    assert [path.name for path in tmp_path.iterdir()] == ["boards"]


OTHERS: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "a number is left out": (
        lambda f: (f / "IMG_0003.png").unlink(),
        "1 missing between IMG_0002.png and IMG_0004",
        "put",
    ),
    "the last picture is gone": (lambda f: (f / "IMG_0006.png").unlink(), "6 actions need 7 pictures", "column time"),
    "a video beside pictures": (write("x.mp4", ""), "which of them is the recording", "frames.csv"),
    "a video that is none": (
        lambda f: (
            [file.unlink() for file in f.glob("*.png")],
            write("x.mp4", "no")(f),
            write("frames.csv", "time\n1\n2\n3\n4\n5\n6\n7")(f),
        ),
        "x.mp4: it cannot be read as a video",
        "mp4",
    ),
    "no pictures": (lambda f: [file.unlink() for file in f.glob("*.png")], "it has no pictures and no video", ".jpg"),
    "a point without a camera": (
        lambda f: write_table(f / "actions.csv", [{"x": 1, "y": 1, "direction": "up"}] * 6),
        "actions.csv: line 2: a point, but nobody knows",
        "u and v",
    ),
}


@pytest.mark.parametrize("fault", OTHERS)
def test_pictures_without_times(fault: str, tmp_path: Path) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0))
    spoil, message, hint = OTHERS[fault]
    spoil(folder)
    with pytest.raises(BusybotError, match=message) as error:
        import_source(folder, tmp_path / "made")
    assert hint in str(error.value.hint) and not (tmp_path / "made").exists()


def test_what_changes_nothing_in_a_table_is_passed_over(tmp_path: Path) -> None:
    """Commas that spreadsheets leave behind, columns of others, and lines without a relation."""
    folder = write_camera_folder(tmp_path / "table", make_episode(0))
    lines = (folder / "actions.csv").read_text().splitlines()
    (folder / "actions.csv").write_text(
        "\n".join([f"{lines[0]},,,note,note", *(f"{line},,,a,b, ," for line in lines[1:])])
    )
    write_table(folder / "relations.csv", [{"cause": "switch 0", "effect": "lamp 1"}, {"cause": " ", "effect": ""}])
    told = import_source(folder, None).recordings[0]
    assert told["actions"] == 6 and told["relations"] == 1


def test_a_video_that_was_cut(tmp_path: Path) -> None:
    episode = make_episode(0)
    folder = write_camera_folder(tmp_path / "table", episode, times=True)
    for file in folder.glob("*.png"):
        file.unlink()
    write_video(folder / "board.mp4", [episode.image(number).rgb for number in range(5)])
    write_table(folder / "frames.csv", [{"time": 100 + number} for number in range(7)])
    with pytest.raises(
        BusybotError, match=r"frames.csv: line 7: board.mp4 ends before this frame, 5; it has 5"
    ) as error:
        import_source(folder, tmp_path / "made")
    assert "cut" in str(error.value.hint) and not (tmp_path / "made").exists()


@pytest.mark.parametrize("timed", [True, False])
def test_a_video_with_more_frames_than_lines(timed: bool, tmp_path: Path) -> None:
    """Nobody knows which of its frames have no line: all later pictures may be others than the table says."""
    episode = make_episode(0)
    folder = write_camera_folder(tmp_path / "table", episode, times=True)
    for file in folder.glob("*.png"):
        file.unlink()
    write_video(folder / "board.mp4", [episode.image(min(number, 6)).rgb for number in range(9)])
    write_table(folder / "frames.csv", [{"time": 100 + number} for number in range(7)])
    if not timed:
        without("actions.csv", "time")(folder)
    for out in (None, tmp_path / "made"):
        with pytest.raises(BusybotError, match=r"frames.csv: line 8: the last line, but board.mp4 goes on") as error:
            import_source(folder, out)
        assert "each of its frames" in str(error.value.hint) and not (tmp_path / "made").exists()
    write_table(folder / "frames.csv", [{"time": 100 + number} for number in range(9)])
    if timed:
        assert import_source(folder, None).recordings[0]["frames"] == 7


@pytest.mark.parametrize("form", ["jpeg", "png"])
def test_what_phones_append_to_a_picture_is_passed_over(form: ImageFormat) -> None:
    colours = make_episode(0).image(0).rgb
    data = encode_rgb(colours, form)
    preview = b"\xff\xe1" + (2 + len(data)).to_bytes(2) + data if form == "jpeg" else b""
    whole = data[:2] + preview + data[2:]
    film = bytes(range(256)) * 99
    for behind in (b"", b"\0" * 9000, film, data):
        assert np.array_equal(decode_bytes(whole + behind, "x"), decode_bytes(data, "x"))
    for keep in (len(preview) + 900, len(whole) - 2):
        for behind in (b"", b"\0" * 9000, data):
            with pytest.raises(BusybotError, match="x: the picture is cut, or damaged"):
                decode_bytes(whole[:keep] + behind, "x")


def test_depth_needs_a_unit(tmp_path: Path) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0), camera=True)
    (folder / "camera.json").unlink()
    write_table(folder / "actions.csv", [{"u": 9, "v": 9, "direction": "up"}] * 6)
    with pytest.raises(BusybotError, match=r"frames.csv: it names depth, whose unit nobody told"):
        import_source(folder, None)


def test_links_out_of_the_folder_are_not_followed(tmp_path: Path) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0))
    shutil.move(folder / "IMG_0001.png", tmp_path / "secret.png")
    (folder / "IMG_0001.png").symlink_to(tmp_path / "secret.png")
    with pytest.raises(BusybotError, match="leaves the folder"):
        import_source(folder, tmp_path / "made")


def test_the_command(tmp_path: Path) -> None:
    folder, out = write_camera_folder(tmp_path / "table", make_episode(0), relations=False), tmp_path / "made"
    dry = busybot("dataset", "import", folder, "--dry-run", "--json")
    told = json.loads(dry.stdout)
    assert told["dataset"] is None and told["kind"] == "camera" and not out.exists()
    assert told["recordings"][0]["actions"] == 6 and told["recordings"][0]["relations"] is None
    assert busybot("dataset", "import", folder).returncode == 2
    done = busybot("dataset", "import", folder, "--out", out)
    assert done.returncode == 0 and "1 episode" in done.stderr
    judged = busybot("eval", "reason", out, "--reasoner", "count", "--graphs", tmp_path / "graphs")
    assert judged.returncode == 0 and "-> lamp" in judged.stdout and "nothing is judged" in judged.stderr
    assert "-> lamp" in (tmp_path / "graphs" / "000000.txt").read_text()


@pytest.mark.parametrize(
    ("table", "values", "fault"),
    [
        ("actions.csv", {"u": "9999"}, "outside of pictures"),
        ("objects.csv", {"u0": "10", "v0": "10", "u1": "5", "v1": "5"}, "is empty, or outside of pictures"),
        ("objects.csv", {"u0": "10", "v0": "10", "u1": "9999", "v1": "20"}, "is empty, or outside of pictures"),
        ("IMG_0001.png", {}, "IMG_0001.png"),
    ],
)
def test_a_dry_run_refuses_what_the_import_refuses(
    table: str, values: dict[str, str], fault: str, tmp_path: Path
) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0, steps=3))
    assert busybot("dataset", "import", folder, "--dry-run").returncode == 0
    if values:
        first, *others = read_rows(folder / table)
        write_table(folder / table, [first | values, *others])
    else:
        (folder / table).write_bytes((folder / table).read_bytes()[:100])
    dry = busybot("dataset", "import", folder, "--dry-run")
    done = busybot("dataset", "import", folder, "--out", tmp_path / "made")
    assert dry.returncode == done.returncode == 1 and fault in dry.stderr and "hint:" in dry.stderr
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize("name", ["frames.csv", "objects.csv", "relations.csv", "camera.json"])
def test_a_link_that_leads_nowhere_is_not_passed_over(name: str, tmp_path: Path) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0, steps=3), camera=True, times=True)
    (folder / name).unlink()
    (folder / name).symlink_to(name)
    with pytest.raises(BusybotError, match=name):
        import_source(folder, None)


def test_faults_name_the_file_that_tells_them(tmp_path: Path) -> None:
    folder = write_camera_folder(tmp_path / "table", make_episode(0, steps=3), camera=True, times=True)
    told = json.loads((folder / "camera.json").read_text())
    for key, value, fault in (
        ("pose", np.eye(4) * 2, "pose does not end in 0, 0, 0, 1"),
        ("matrix", np.eye(2), "as many"),
    ):
        (folder / "camera.json").write_text(json.dumps(told | {key: value.tolist()}))
        with pytest.raises(BusybotError, match=rf"table/camera.json: the camera's .*{fault}"):
            import_source(folder, None)
    (folder / "camera.json").write_text(json.dumps(told))
    frames = (folder / "frames.csv").read_text()
    (folder / "frames.csv").write_text(frames.replace("depth/0001.png", f"depth/{'n' * 5000}.png"))
    with pytest.raises(BusybotError, match=r"frames.csv: line 3"):
        import_source(folder, None)
    (folder / "frames.csv").write_text("\n".join(frames.split("\n")[:-2]) + "\n")
    with pytest.raises(BusybotError, match=r"outside of the pictures.*frames.csv: line 4"):
        import_source(folder, None)
