"""What a machine manages: workers really draw and act, and the extrapolation is arithmetic on what was measured."""

from pathlib import Path

import pytest

from benchmarks.speed.hardware import Load, extrapolated, make_work
from busybot.objects.resolve import find
from busybot.sim.scene.render import RenderConfig
from pipelines.profile import read_profile

SMALL = RenderConfig(width=64, height=48)


@pytest.mark.parametrize("does", ["frames", "scripted"])
def test_a_worker_does_its_work_again_and_again(does: str, tmp_path: Path) -> None:
    (tmp_path / "ready-1").touch()  # the other one has set up, too
    rates = make_work(Load(does, find("procedural"), SMALL, workers=2, seconds=0.2, folder=tmp_path))(0)
    assert min(rates) > 0
    assert (tmp_path / "ready-0").exists()
    assert (tmp_path / "0.mcap").exists() == (does == "scripted")


def test_minutes_of_the_papers_profile() -> None:
    seconds = {"relations (paper)": 2.0, "interaction, position (paper)": 0.5, "interaction, direction (paper)": 0.25}
    needed = {"look_seconds": 0.1, "feature_frame_seconds": 0.01, "judged_board_seconds": 0.5}
    minutes = extrapolated(read_profile("paper"), {"scripted": 10.0, "learned": 5.0, "relations": 4.0}, seconds, needed)
    assert minutes.pop("all") == pytest.approx(sum(minutes.values()), abs=0.5)
    assert minutes == {
        "interact": 266.0,  # 370 epochs of 8 x 0.5, 280 of 24 x 0.25, 64,000 actions of 0.1 + 0.1 s
        "judge": 133.3,  # 2 x 2,000 boards x 10 actions / 5
        "chance": 66.7,
        "data": 1600.0,  # 16,000 boards x 30 / 5
        "features": 82.7,  # 16,000 x 31 frames
        "reason": 1046.7,  # 200 epochs of 157 iterations
        "relations": 25.0,  # 3 x 2,000 boards / 4
        "tasks": 30.0,  # 6 x 50 x 30 / 5
        "plan": 56.0,  # 6 x 50 x 7 agents x 8 / 5
        "rollouts": 3.2,  # 6 x 20 x 8 / 5
    }
