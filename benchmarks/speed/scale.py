"""Measures what datasets cost as they grow: boards, objects on a board, resolution, workers.

    python -m benchmarks.speed.scale --work FOLDER --out FILE [--quick]
    python -m benchmarks.speed.scale plot --result FILE --out PICTURE

Every point is a dataset of its own, made and used by the commands that people type: `generate`, `collect`, `dataset
info`, `dataset verify`, reading all of it, `dataset freeze`, `dataset verify` of the frozen one. Told of each are
processor seconds of the command and its workers, of its first process alone, wall time, the most memory that its
first process and that one of its workers had, and what lies on the disk afterwards. A point that is finished is kept
in the work folder, so a run that was ended continues; points of another commit, or of changes that were not committed,
are measured again.

Before every point one product of two matrices is timed, to which seconds are told as ratios. What the points say, in
slopes and of a million boards, is worked out by `scale_growth`.
"""

import argparse
import contextlib
import json
import os
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.runner import (
    BUSYBOT,
    finish,
    load_average,
    one_of,
    option,
    parser,
    product_seconds,
    settings,
    torch_with,
)
from benchmarks.speed.scale_growth import COMMANDS, scale_figure
from busybot.boards.layout import BOARD_HALF, place
from busybot.boards.relations import draw_relations
from busybot.boards.spec import BoardSpec, PlacedObject
from busybot.boards.textures import COLORS, TEXTURES
from busybot.common.atomic_io import make_folder, remove, write_json
from busybot.common.rng import generator
from busybot.datasets.dataset import Dataset
from busybot.datasets.info import AssetsInfo, DatasetInfo, GeneratorInfo
from busybot.episodes.mcap.reader import read_episode
from busybot.evaluation.results import code_digest, commit, read_result
from busybot.objects.library import Library
from busybot.objects.model import ObjectModel
from busybot.objects.resolve import find

SEED = 5
SMALL, FULL = (64, 48), (640, 480)
MARGIN = 0.2
"""Around objects, as `boards.config` has it."""
USUAL_OBJECTS = 10
"""That a board of the usual size has room for."""
LOOK_SECONDS = 0.2
"""Between two looks at a command's first process."""


@dataclass(frozen=True)
class Point:
    """A dataset, and with how many workers it is made and used.

    Attributes:
        steps: actions on a board.
        size: of pictures, width and height.
        objects: on every board, by a layout of this module's on boards as large as they need; None as usual.
    """

    boards: int
    steps: int = 2
    size: tuple[int, int] = FULL
    policy: str = "random"
    objects: int | None = None
    workers: int = 1

    @property
    def name(self) -> str:
        size = "x".join(map(str, self.size))
        laid = f"-{self.objects}-objects" if self.objects else ""
        return f"{self.boards}-{self.steps}-{size}-{self.policy}{laid}-{self.workers}"


@dataclass(frozen=True)
class Curve:
    """Points along which one variable grows, and what is done with each of their datasets."""

    variable: str
    points: list[Point]
    commands: tuple[str, ...] = COMMANDS


MADE = ("generate", "collect")
CURVES = {
    "30 actions": Curve("boards", [Point(n, 30, policy="scripted") for n in (2, 42)]),
    "workers": Curve("workers", [Point(80, workers=n) for n in (1, 2, 4)], (*MADE, "verify")),
    "objects": Curve("objects", [Point(20, objects=n) for n in (5, 8, 16, 32, 64)], (*MADE, "verify")),
    "pixels": Curve("pixels", [Point(20, 4, (64 * k, 48 * k)) for k in (1, 2, 5, 10, 20)], (*MADE, "verify")),
    "boards at 640 x 480": Curve("boards", [Point(n) for n in (1, 10, 100, 1000)]),
    "boards at 64 x 48": Curve("boards", [Point(n, size=SMALL) for n in (1, 10, 100, 1000, 10000)]),
}
"""The long one is the last."""
QUICK = {
    "30 actions": Curve("boards", [Point(n, 1, SMALL) for n in (1, 4)]),
    "workers": Curve("workers", [Point(2, 1, SMALL, workers=2)], MADE),
    "objects": Curve("objects", [Point(1, 1, SMALL, objects=12)], MADE),
    "pixels": Curve("pixels", [Point(1, 1, (128, 96))], MADE),
    "boards at 640 x 480": Curve("boards", [Point(n, 1, SMALL) for n in (1, 4)]),
    "boards at 64 x 48": Curve("boards", [Point(n, 1, SMALL) for n in (1, 4)]),
}


def boards_with(objects: int, count: int, library: Library) -> Iterable[BoardSpec]:
    """Boards with so many objects each, square and as densely covered as usual ones; a quarter are triggers."""
    weights = {name: library.weights("train", name) for name in ("Switch", "Lamp", "Door", "Toy")}
    half = BOARD_HALF * float(np.sqrt(max(1.0, objects / USUAL_OBJECTS)))
    for index in range(count):
        rng = generator(SEED, "train", index, f"scale/{objects} objects")
        while True:
            names = ["Switch"] * (objects // 4) + ["Toy"] * (objects // 10)
            names += list(rng.choice(["Lamp", "Door"], objects - len(names)))
            models = [library.get(str(rng.choice([key for key, _ in weights[name]]))) for name in names]
            placements, relations = place(models, rng, MARGIN, half), draw_relations(models, rng)
            if placements is not None and relations is not None:
                break
        yield BoardSpec(
            index=index,
            seed=SEED,
            split="train",
            appearance_group=index,
            size=(2 * half, 2 * half),
            texture=str(rng.choice(TEXTURES)),
            color=COLORS[int(rng.integers(len(COLORS)))],
            objects=tuple(_placed(*one, rng) for one in zip(models, placements, strict=True)),
            relations=relations,
        )


def _placed(
    model: ObjectModel, placement: tuple[tuple[float, float, float], float], rng: np.random.Generator
) -> PlacedObject:
    states = tuple(int(rng.integers(link.states)) for link in model.trigger_links)
    position, yaw = placement
    return PlacedObject(key=model.key, role=model.role, position=position, yaw=yaw, scale=model.scale, states=states)


def laid_out(folder: Path, point: Point) -> None:
    """A dataset of boards with as many objects as the point says."""
    assert point.objects is not None
    library = find("procedural")
    boards = list(boards_with(point.objects, point.boards, library))
    used = sorted({placed.key for board in boards for placed in board.objects})
    info = DatasetInfo(
        name=folder.name,
        split="train",
        seed=SEED,
        boards=len(boards),
        generator=GeneratorInfo(version="scale"),
        assets=AssetsInfo(
            source="procedural", name=library.name, sha256={key: library.get(key).sha256 for key in used}
        ),
    )
    Dataset.create(folder, info, boards)


def looking(point: Point) -> tuple[str, ...]:
    """Parameters of the camera: how many pixels, and from how far away it sees a board of this size whole."""
    far = float(np.sqrt(max(1.0, (point.objects or 0) / USUAL_OBJECTS)))
    width, height = point.size
    values = [f"render.width={width}", f"render.height={height}"]
    values += [f"render.position=[0,{-0.1 * far:.4f},{4 * far:.4f}]", f"render.far={6 * far:.4f}"] if far > 1 else []
    return settings(*values)


def words(folder: Path, point: Point, wanted: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """The commands of a point, in their order."""
    data, shared = str(folder), option("--workers", point.workers)
    drawn = ("--boards", str(point.boards), "--seed", str(SEED))
    acted = ("--policy", point.policy, "--steps", str(point.steps))
    verify = (*BUSYBOT, "dataset", "verify", data, *shared)
    commands = {
        "generate": (*BUSYBOT, "generate", data, *drawn),
        "collect": (*BUSYBOT, "collect", data, *acted, *shared, *looking(point)),
        "info": (*BUSYBOT, "dataset", "info", data),
        "verify": verify,
        "read": (sys.executable, "-m", "benchmarks.speed.scale", "read", data),
        "freeze": (*BUSYBOT, "dataset", "freeze", data, *shared),
        "verify frozen": verify,
    }
    return {name: commands[name] for name in wanted if not (point.objects and name == "generate")}


def read(folder: Path) -> int:
    """Read boards and episodes of a dataset one after the other, pictures as they are asked for; returns the steps."""
    dataset, steps = Dataset.open(folder), 0
    for board in dataset.each_board():
        steps += len(read_episode(dataset.episode_path(board.index), "lazy").steps)
    return steps


def cost(command: tuple[str, ...]) -> dict[str, float]:
    """Run a command and measure it.

    Returns:
        Seconds: `cpu` of it and its workers, `first` of its first process alone, `wall`. MB: `mb`, the most memory that
        the first process had, `worker_mb`, that one of its workers had, both as they were last seen.

    Raises:
        RuntimeError: it failed; with what it said.
    """
    began = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    said: list[str] = []
    seen = {"mb": 0.0, "worker_mb": 0.0}
    over = threading.Event()
    watching = [threading.Thread(target=_watch, args=(process.pid, seen, over), daemon=True)]
    watching.append(threading.Thread(target=_pass_on, args=(process.stderr, said), daemon=True))
    for thread in watching:
        thread.start()
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    first = psutil.Process(process.pid).cpu_times()  # the system remembers them until it is waited for
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    over.set()
    for thread in watching:
        thread.join()
    if process.returncode:
        raise RuntimeError(f"{' '.join(command[2:])}: {' '.join(said)[-500:]}")
    told = {"cpu": used.ru_utime + used.ru_stime, "first": first.user + first.system}
    told |= {"wall": time.monotonic() - began, **seen}
    return {name: round(value, 3) for name, value in told.items()}


def _watch(pid: int, seen: dict[str, float], over: threading.Event) -> None:
    process = psutil.Process(pid)
    while not over.wait(LOOK_SECONDS):
        with contextlib.suppress(psutil.Error, OSError):
            seen["mb"] = max(seen["mb"], _most_mb(pid))
            for worker in process.children():
                seen["worker_mb"] = max(seen["worker_mb"], _most_mb(worker.pid))


def _most_mb(pid: int) -> float:
    """The most memory that a process has had so far; what the system tells of an ended one has its parent's in it."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return sum(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) * 1024 / 1e6


def _pass_on(stream: Any, said: list[str]) -> None:
    """Show progress, and remember the last lines."""
    for line in stream:
        print(f"  {line}", end="", file=sys.stderr, flush=True)
        said[:] = [*said[-4:], line.strip()]


def on_disk(folder: Path) -> dict[str, int]:
    """Files under a folder, their bytes, those of the episodes, and the largest file that is read in one piece."""
    files = [(file, file.stat().st_size) for file in folder.rglob("*") if file.is_file()]
    kinds = {name: [size for file, size in files if file.suffix == name] for name in (".mcap", ".parquet")}
    manifest = folder / "manifest.json"
    return {
        "files": len(files),
        "bytes": sum(size for _, size in files),
        "episode_bytes": sum(kinds[".mcap"]),
        "table_bytes": sum(kinds[".parquet"]),
        "manifest_bytes": manifest.stat().st_size if manifest.exists() else 0,
    }


def measure(point: Point, wanted: tuple[str, ...], work: Path) -> dict[str, Any]:
    """Make the point's dataset and use it; the dataset is removed."""
    folder, costs = work / "dataset", {}
    _drop(folder)
    milliseconds = 1e3 * product_seconds(5)
    if point.objects:
        laid_out(folder, point)
    for name, command in words(folder, point, wanted).items():
        print(f"{point.name}: {name}", file=sys.stderr, flush=True)
        costs[name] = cost(command)
    figures = {"product_milliseconds": round(milliseconds, 2), "costs": costs, "disk": on_disk(folder)}
    figures["load"] = load_average()
    _drop(folder)
    return {**asdict(point), **figures}


def _drop(folder: Path) -> None:
    """Remove a dataset, which may be frozen."""
    if folder.exists():
        for place in [folder, *(place for place in folder.rglob("*") if place.is_dir())]:
            os.chmod(place, 0o755)
        remove(folder)


Measuring = Callable[[Point, tuple[str, ...], Path], dict[str, Any]]


def measured(curves: Mapping[str, Curve], work: Path, measuring: Measuring = measure) -> dict[str, Any]:
    """Curves with the figures of their points. What this code has measured already is read, also of another curve."""
    make_folder(work)
    now, code, done = commit(), code_digest(), 0
    found, same = {}, dict[tuple[Point, tuple[str, ...]], Path]()
    for name, curve in curves.items():
        points = []
        for point in curve.points:
            done += 1
            kept = same.setdefault((point, curve.commands), work / f"{name}-{point.name}.json")
            told = json.loads(kept.read_text()) if kept.exists() else {}
            if not told or told.get("commit") != now or told.get("code") != code:
                of = sum(len(one.points) for one in curves.values())
                print(f"point {done} of {of}, {name}: {point.name}", file=sys.stderr, flush=True)
                told = {**measuring(point, curve.commands, work), "commit": now, "code": code}
                write_json(kept, told)
            points.append({key: value for key, value in told.items() if key not in ("commit", "code")})
        found[name] = {"variable": curve.variable, "points": points}
    return found


def run(given: list[str]) -> None:
    """Measure all points and write the result."""
    options = parser(__doc__, assets=False)
    options.add_argument("--work", type=Path, required=True, help="folder for datasets and finished points")
    options.add_argument("--quick", action="store_true", help="tiny points, to see that it works")
    arguments = options.parse_args(given)
    machine = torch_with(1)
    find("procedural")  # else the first point would make them
    curves = measured(QUICK if arguments.quick else CURVES, arguments.work)
    products = [point["product_milliseconds"] for told in curves.values() for point in told["points"]]
    figures = {"product_milliseconds": statistics.median(products), "curves": curves}
    finish("scale", arguments, figures, machine=machine, seed=SEED)


def read_all(given: list[str]) -> None:
    """The command `read`."""
    (folder,) = given
    print(read(Path(folder)))


def plot(given: list[str]) -> None:
    """The command `plot`."""
    options = argparse.ArgumentParser()
    options.add_argument("--result", type=Path, required=True)
    options.add_argument("--out", type=Path, required=True)
    arguments = options.parse_args(given)
    scale_figure(arguments.out, read_result(arguments.result, "scale"))


if __name__ == "__main__":
    one_of(run, read=read_all, plot=plot)
