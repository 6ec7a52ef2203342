"""What comes in from others' tools: recordings, checkerboards, cameras of boards, graphs, and answers of programs."""

import json
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from busybot.boards.spec import SCENES_VERSION, BoardCamera
from busybot.common.errors import BusybotError, naming
from busybot.datasets.bundled_assets import library_of
from busybot.datasets.dataset import Dataset
from busybot.datasets.importing.camera_folder import ImportOptions
from busybot.datasets.importing.checkerboard import calibrate
from busybot.datasets.importing.sources import import_source
from busybot.episodes.mcap.reader import read_episode
from busybot.reason.evaluation.evaluate import ReasonEvaluation, evaluate_dataset
from busybot.reason.evaluation.graph_files import read_graphs
from busybot.reason.evaluation.play import TextGames, make_work, summarised
from busybot.reason.evaluation.questions import asked_about, judge_answers, lines, read_answers
from busybot.sim.scene.render import RenderConfig, camera_model
from tests.datasets.camera_folders import write_camera_folder
from tests.datasets.test_checkerboard import ACROSS, BOARD, FOCAL, HEIGHT, WIDTH, pictures
from tests.datasets.test_imports_of_thor import write_thor
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode
from tests.hostile.damage import (
    ANY,
    JSON,
    TEXT,
    Damage,
    deep,
    huge_word,
    odd_csv,
    odd_key,
    odd_text,
    odd_value,
    other_number,
)
from tests.hostile.targets import Target, _plain, _printed

TINY = Path(__file__).resolve().parents[2] / "datasets" / "tiny"
IMPORTS, CAMERAS, CLAIMS = "imports and calibration", "cameras of boards", "graphs and answers of others"
SIDES = (1, 16, 90, 640, 4000)


def _thor(folder: Path) -> None:
    write_thor(folder / "t")


def _camera_folder(folder: Path) -> None:
    write_camera_folder(folder / "t", make_episode(0, steps=4), camera=True, times=True)


def imported_from(source: Path, **options: Any) -> Any:
    """What is told of the source, and all that is in the dataset that is made of it; after an error there is none."""
    asked = ImportOptions(**options)
    told = import_source(source, None, asked).recordings
    json.dumps(told, allow_nan=False)
    with tempfile.TemporaryDirectory(prefix="busybot-hostile-import-") as place:
        try:
            made = import_source(source, Path(place) / "d", asked).dataset
        except BusybotError as error:
            if list(Path(place).iterdir()):
                raise ValueError(f"something is left half-written after {error}") from None
            raise
        assert made is not None
        found = [_plain(read_episode(made.episode_path(index))) for index in sorted(made.finished())]
        return told, made.boards(), found


def _imported(folder: Path) -> Any:
    return imported_from(folder / "t")


def odd_picture(data: bytes, rng: np.random.Generator) -> bytes:
    """A picture that is whole, of another size, kind or content."""
    height, width = (int(rng.choice([*SIDES, usual])) for usual in (HEIGHT, WIDTH))
    channels, kind = int(rng.choice([1, 3, 4])), int(rng.integers(5))
    shape, most = (height, width, channels), 65535 if rng.random() < 0.2 else 255
    values: np.ndarray = np.zeros(shape)
    if kind == 0:
        values = rng.random(shape) * most
    elif kind == 1:
        values += float(rng.random()) * most
    elif kind == 2:  # squares of any size, all over the picture
        side = int(rng.choice([1, 2, 5, 20, 60]))
        values += ((np.arange(height)[:, None, None] // side + np.arange(width)[:, None] // side) % 2) * most
    else:  # the same picture mirrored, turned, resized or bent
        was = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        turned = (was[::-1], was[:, ::-1], was.T, np.roll(was, 200, 1))[int(rng.integers(4))]
        values = np.repeat((cv2.resize(was, (width, height)) if kind == 3 else turned)[..., None], channels, 2)
    form = ".png" if most > 255 or rng.random() < 0.7 else ".jpg"
    return cv2.imencode(form, values.astype(np.uint16 if most > 255 else np.uint8))[1].tobytes()


def _checkerboards(folder: Path) -> None:
    pictures(folder / "c")


def odd_row(data: bytes, rng: np.random.Generator) -> bytes:
    return (odd_value if data.startswith(b"{") else odd_csv)(data, rng)


def _calibrated(folder: Path) -> Any:
    """Whatever a picture shows, the camera is the one that took the others, or nobody tells one."""
    told = calibrate(folder / "c", BOARD, "flat.png", ACROSS)
    json.dumps(told, allow_nan=False)
    if abs(told["camera"]["matrix"][0][0] / FOCAL - 1) > 0.05:
        raise ValueError(f"another focal length: {told['camera']['matrix'][0][0]}")
    return told


def _looked_at(folder: Path) -> None:
    """Boards with cameras of their own."""
    made = make_dataset(folder / "made", boards=2, finished=())
    camera = BoardCamera(position=(0.5, -5.0, 4.0), target=(0.0, 0.0, 0.5), fov_deg=50.0)
    scene = {"camera": camera, "schema_version": SCENES_VERSION}
    Dataset.create(folder / "d", made.info, [one.model_copy(update=scene) for one in made.boards()])


def in_camera(way: Damage) -> Damage:
    """The damage, done to the camera of a board."""

    def damaged(data: bytes, rng: np.random.Generator) -> bytes:
        lines = data.splitlines()
        place = int(rng.integers(len(lines)))
        board = json.loads(lines[place])
        changed = way(json.dumps(board.pop("camera")).encode(), rng)
        lines[place] = json.dumps(board).encode()[:-1] + b', "camera": ' + changed + b"}"
        return b"".join(b"%s\n" % line for line in lines)

    damaged.__name__ = f"{way.__name__} in camera"
    return damaged


def odd_view(data: bytes, rng: np.random.Generator) -> bytes:
    """A camera at its target, inside the board, below it, or as far and as wide or narrow as numbers can be."""

    def point() -> list[float]:
        return [float(rng.choice([-100, -4, -1e-9, 0, 1e-9, 1e-4, 0.1, 4, 100])) for _ in range(3)]

    position = point()
    target = position if rng.random() < 0.3 else point()
    fov = float(rng.choice([0, 1, 1.0000001, 50, 169.999999, 170, 360]))
    return json.dumps({"position": position, "target": target, "fov_deg": fov}).encode()


def _views(folder: Path) -> Any:
    """The cameras as they are used, under names that `collect` gives."""
    dataset, found = Dataset.open(folder / "d"), []
    for index in range(dataset.info.boards):
        board = dataset.board(index)
        with naming(dataset.board_place(index)):
            camera = camera_model(RenderConfig().of_board(board))
        turn = camera.pose[:3, :3]
        if not np.allclose(turn @ turn.T, np.eye(3)) or not np.isfinite(camera.matrix).all():
            raise ValueError(f"no camera: {camera}")
        found.append((board, camera.matrix.tolist(), camera.pose.tolist()))
    return found


def _graphs(folder: Path) -> None:
    make_dataset(folder / "d", boards=2, finished=(0, 1))
    nodes = [{"id": f"n{k}", "box": None} for k in range(2)]
    edges = [{"from": 0, "to": 1, "probability": 0.9, "mechanism": "gate", "lag": 2}, {"from": 3, "to": 2}]
    edges.append({"from": 0, "link": "knob", "to": 1, "probability": 0.8})
    links = [{"id": "knob", "of": 0, "steps": [0, 1]}]
    graphs = [
        {"board": n, "model": "mine", "threshold": 0.5, "nodes": [], "links": links, "edges": edges} for n in range(2)
    ]
    boxes = read_episode(folder / "d" / "episodes" / "000001.mcap").images[0].boxes.tolist()
    graphs[1]["nodes"] = [node | {"box": box} for node, box in zip(nodes, boxes, strict=False)]
    graphs[1]["links"] = [{"id": 0, "of": "n0", "steps": [2]}]
    graphs[1]["edges"] = [{"from": "n0", "link": 0, "to": "n1", "probability": 1.0}]
    (folder / "graphs.json").write_text(json.dumps(graphs))


def _judged(folder: Path) -> Any:
    given = read_graphs(folder / "graphs.json")
    asked = ReasonEvaluation("count", 4, given=given)
    told = evaluate_dataset(Dataset.open(folder / "d"), asked, workers=1)
    json.dumps(told, allow_nan=False)
    shares = [
        told[name] for name in ("edge_p", "edge_r", "parent_f1", "link_parent_f1", "brier") if told[name] is not None
    ]
    if not all(0 <= share <= 1 for share in shares):
        raise ValueError(f"shares beyond 0 and 1: {shares}")
    return {name: told[name] for name in ("model", "edge_p", "edge_r", "edge_acc", "parent_f1", "brier", "shd")}


def _questions(folder: Path) -> None:
    make_dataset(folder / "d", boards=2, finished=(0, 1))
    (folder / "q.jsonl").write_text(lines(asked_about(Dataset.open(folder / "d"))))


def _answered(folder: Path) -> Any:
    dataset, given = Dataset.open(folder / "d"), read_answers(folder / "q.jsonl")
    told = judge_answers(dataset, asked_about(dataset), given)
    json.dumps(told, allow_nan=False)
    return {name: told[name] for name in ("pairs", "right", "what_if")}


def _answers(folder: Path) -> None:
    lines = [{"link": 0, "direction": "forward"}, {"link": 0, "direction": "back"}, {"link": None}]
    lines += [{"know": [{"link": 0, "controls": 1, "why": "it glowed"}, {"object": 1, "controls": 1}]}]
    (folder / "answers").write_text("".join(json.dumps(line) + "\n" for line in lines))


def in_a_line(way: Damage) -> Damage:
    """The damage, done to one line of JSON."""

    def damaged(data: bytes, rng: np.random.Generator) -> bytes:
        lines = data.splitlines()
        place = int(rng.integers(len(lines)))
        lines[place] = way(lines[place], rng)
        return b"".join(b"%s\n" % line for line in lines)

    damaged.__name__ = f"{way.__name__} in a line"
    return damaged


def _played(folder: Path) -> Any:
    """A program that says what stands in the file is judged by it, or has said nothing."""
    dataset = Dataset.open(TINY)
    games = TextGames(dataset, library_of(dataset, None), ("cat", str(folder / "answers")), 5, 2.0, 2)
    work = make_work(games)
    played = [work(index) for index in range(2)]
    told = summarised(dataset.boards()[:2], played, 0)
    json.dumps(told, allow_nan=False)
    for one in played:
        if one.end != "knows" and one.claimed:
            raise ValueError(f"it claims without knowing: {one}")
        if any(ord(letter) < 32 or letter == "\x7f" for letter in one.note):
            raise ValueError(f"a note for the terminal: {one.note!r}")
    return [one.model_dump(mode="json", exclude={"note"}) for one in played]


LINES = tuple(in_a_line(way) for way in (*JSON, *JSON, other_number, other_number, huge_word, deep))
CAMERA = tuple(in_camera(way) for way in (odd_value, odd_value, odd_text, odd_key, other_number, odd_view, odd_view))
EVENT: tuple[Damage, ...] = (*TEXT, *JSON, *JSON, *JSON)
DOORS: dict[str, Target] = {
    "ai2-thor events": Target(_thor, "t/events/*.json", EVENT, _imported, False, IMPORTS, 2),
    "ai2-thor pictures": Target(_thor, "t/events/*.png", (*ANY, odd_picture), _imported, False, IMPORTS, 4),
    "camera folder": Target(_camera_folder, "t/*.[cj]s*", (*TEXT, *[odd_row] * 18), _imported, False, IMPORTS, 2),
    "checkerboards": Target(_checkerboards, "c/*.png", (*ANY, *[odd_picture] * 10), _calibrated, False, IMPORTS, 8),
    "cameras of boards": Target(_looked_at, "d/boards/*.jsonl", CAMERA, _views, False, CAMERAS, 1),
    "graphs": Target(_graphs, "graphs.json", (*TEXT, *JSON, *JSON, *JSON), _judged, False, CLAIMS, 2),
    "printed graphs": Target(
        _graphs,
        "graphs.json",
        JSON,
        _printed("eval", "reason", "d", "--graph", "graphs.json", "--images", "4", "--workers", "1"),
        False,
        CLAIMS,
        8,
    ),
    "answers to questions": Target(_questions, "q.jsonl", (*LINES, *TEXT), _answered, False, CLAIMS, 2),
    "answers of programs": Target(_answers, "answers", (*LINES, *TEXT), _played, False, CLAIMS, 2),
}
