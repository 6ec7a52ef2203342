"""Scale: finished points are kept, slopes are those of the figures, and a million boards follow from them."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.speed import scale, scale_growth
from benchmarks.speed.scale import Curve, Point
from benchmarks.speed.scale_growth import COMMANDS, growth, million
from busybot.objects.resolve import find
from tools import speed_tables

CURVES = {"some": Curve("boards", [Point(1), Point(3)], ("collect",))}
POWERS = {"info": 1.0, "verify": 1.5, "read": 0.5}


def told(point: Point, start: float = 2.0) -> dict[str, Any]:
    """Figures in which a board takes 0.01 s, `verify` grows faster and `freeze` takes 2 KB of memory for each."""
    costs = {}
    for command in COMMANDS:
        seconds = start + 0.01 * point.boards ** POWERS.get(command, 1.0) * point.steps
        megabytes = 100.0 + (0.002 * point.boards if command == "freeze" else 0.0)
        costs[command] = {"cpu": seconds, "first": start + 0.001 * point.boards, "wall": seconds}
        costs[command] |= {"mb": megabytes, "worker_mb": 400.0}
    sizes = {"bytes": 120_000, "episode_bytes": 100_000, "table_bytes": 20_000, "manifest_bytes": 150, "files": 1}
    disk = {name: 1000 + size * point.boards for name, size in sizes.items()}
    return {**vars(point), "size": list(point.size), "costs": costs, "disk": disk, "load": [0.5, 0.5, 0.5]}


def result() -> dict[str, Any]:
    curves = {
        name: {"variable": curve.variable, "points": [told(point) for point in curve.points]}
        for name, curve in scale.CURVES.items()
    }
    machine = {"processor": "a processor", "cores": 2}
    return {"product_milliseconds": 20.0, "machine": machine, "curves": curves}


def test_points_that_are_finished_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def measuring(point: Point, wanted: tuple[str, ...], work: Path) -> dict[str, Any]:
        asked.append(point.boards)
        if asked == [1, 3]:
            raise KeyboardInterrupt
        return {"boards": point.boards, "did": list(wanted)}

    with pytest.raises(KeyboardInterrupt):
        scale.measured(CURVES, tmp_path, measuring)
    found = scale.measured(CURVES, tmp_path, measuring)
    assert asked == [1, 3, 3]
    points = [{"boards": boards, "did": ["collect"]} for boards in (1, 3)]
    assert found == scale.measured(CURVES, tmp_path, measuring) == {"some": {"variable": "boards", "points": points}}
    monkeypatch.setattr(scale, "commit", lambda: "another one")
    scale.measured(CURVES, tmp_path, measuring)
    assert asked == [1, 3, 3, 1, 3]
    monkeypatch.setattr(scale, "code_digest", lambda: "changed since")
    scale.measured(CURVES, tmp_path, measuring)
    assert asked == [1, 3, 3, 1, 3, 1, 3], "changes that were not committed have their commit's name"
    monkeypatch.setattr(scale, "commit", lambda: None)
    assert scale.measured(CURVES, tmp_path / "new", measuring)["some"]["points"] == points, "outside a repository, too"


def test_slopes_are_those_of_what_is_beyond_starting() -> None:
    xs, noise = [1.0, 10.0, 100.0, 1000.0, 10000.0], [1.1, 0.9, 1.05, 1.0, 0.93]
    assert growth(xs, [(3 + 0.2 * x) * share for x, share in zip(xs, noise, strict=True)]).words == "linear"
    assert growth(xs, [3 + 0.2 * x**1.6 for x in xs]).words == "n^1.6, more than linear"
    assert growth(xs, [3 + 0.2 * x**0.5 for x in xs]).words == "n^0.5, less than linear"
    assert growth(xs, [3 * share for share in noise]).words == "hardly grows"
    steps = growth(xs, [100.0, 100.0, 200.0, 300.0, 390.0])
    assert steps.lately == pytest.approx(0.01) and steps.each == pytest.approx(290 / 9999)


def test_a_million_boards_follow_from_the_points() -> None:
    found = million(result()["curves"])
    assert found.seconds["collect"] == pytest.approx(0.3) and found.seconds["generate"] == pytest.approx(0.02)
    assert found.hours["collect"] == pytest.approx([1e6 * 0.3 / 16 / 3600 / count for count in (1, 10, 100)])
    assert found.hours["generate"][0] == pytest.approx(1e6 * 0.02 / 3600), "by one process"
    assert found.cores_fed == pytest.approx(300)
    assert found.files_per_second(10) == pytest.approx(160 / 0.3)
    assert found.memory_gb["freeze"] == pytest.approx([2.1, 0.3, 0.12])
    assert found.memory_gb["verify"] == pytest.approx([0.1, 0.1, 0.1])
    assert found.limits["the disk (2 TB) is full"] == pytest.approx(2e12 / 120_000)
    assert found.limits["`freeze` needs more memory than 64 GB"] == pytest.approx((64_000 - 100) / 0.002)
    assert list(found.limits.values()) == sorted(found.limits.values())


def test_tables_and_the_figure_tell_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed_tables, "result", lambda name: result())
    told = speed_tables.scale()
    assert "| `verify` |" in told and "n^1.5, more than linear" in told and "| linear |" in told
    assert "| 10,100 | 1,000.0 | linear |" in told, "2 s and 0.01 s for each action on 10,000 boards, of 20 ms each"
    assert "| `freeze` | 100 | 100 | 100 | 102 | 120 | 2.00 | hardly grows |" in speed_tables.scale_memory()
    assert "| 640 x 480, 30 actions | 100.00 | 20.00 | 0.15 | 1.000 |" in speed_tables.scale_disk()
    assert "0.5" in speed_tables.scale_workers() and "| 300 | cores" not in speed_tables.million_limits()
    assert "1,000,000 | 100,000 | 10,000" in speed_tables.million()
    assert "keeps 300 cores busy, 18.7 machines" in speed_tables.million_limits()
    scale_growth.scale_figure(tmp_path / "scale.png", result())
    assert (tmp_path / "scale.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("objects", [5, 64])
def test_boards_have_as_many_objects_as_they_are_to_have(objects: int) -> None:
    boards = list(scale.boards_with(objects, 2, find("procedural")))
    assert [len(board.objects) for board in boards] == [objects] * 2
    assert all(board.relations for board in boards) and boards[0] != boards[1]
    assert boards[0].size == ((4.0, 4.0) if objects == 5 else pytest.approx((4 * 6.4**0.5,) * 2))


def test_a_command_is_measured_and_its_fault_told() -> None:
    found = scale.cost((sys.executable, "-c", "import time; x = bytearray(80 * 10**6); time.sleep(0.6)"))
    assert 0 < found["first"] <= found["cpu"] + 0.02 and found["wall"] > 0.6 and 80 < found["mb"] < 160
    with pytest.raises(RuntimeError, match="it is so"):
        scale.cost((sys.executable, "-c", "raise SystemExit('it is so')"))


@pytest.mark.long
def test_the_benchmark_runs(tmp_path: Path) -> None:
    command = (sys.executable, "-m", "benchmarks.speed.scale", "--quick")
    places = ("--work", tmp_path / "w", "--out", tmp_path / "r")
    subprocess.run((*command, *places), check=True, cwd=Path(__file__).parents[2])
    assert million(scale.read_result(tmp_path / "r", "scale")["curves"]).disk["files"] == pytest.approx(1, abs=0.2)
