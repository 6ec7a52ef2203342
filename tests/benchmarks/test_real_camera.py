"""The contact sheet of the real camera is that of its command; rewards are compared with what moved."""

from pathlib import Path

import pandas as pd

from benchmarks.studies.real_camera import sheet, wrong_rewards

ROOT = Path(__file__).resolve().parents[2]


def test_the_sheet_is_that_of_its_command(tmp_path: Path) -> None:
    sheet(["--data", str(ROOT / "datasets" / "tiny"), "--out", str(tmp_path / "sheet.jpg")])
    assert (tmp_path / "sheet.jpg").read_bytes() == (ROOT / "docs" / "images" / "real-camera.jpg").read_bytes()


def test_wrong_rewards_are_counted_both_ways() -> None:
    steps = pd.DataFrame({"success": [True, True, False, False, False], "reward": [1, 0, 0, 1, 1]})
    assert wrong_rewards(steps) == {"moved": 2, "without_reward": 1, "still": 3, "for_nothing": 2}
