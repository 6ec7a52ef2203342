"""Recorded steps put back into the simulator, in the recording for Rerun."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from busybot.cli.main import app
from busybot.view.rerun.camera import difference_layer
from busybot.view.rerun.recording import RecordingLayers, save_rrd
from tests.episodes.synthetic import make_episode
from tests.view.rerun.test_recording import entities, rows


def blob(row: dict) -> np.ndarray:
    data = np.array(row["EncodedImage:blob"][0], np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    assert picture is not None
    return picture


def test_what_differs_is_marked_and_nothing_else(tmp_path: Path) -> None:
    episode, path = make_episode(steps=2), tmp_path / "e.rrd"
    changed = episode.image(1).rgb.copy()
    changed[3:5, 7:11] ^= 0x80
    save_rrd(path, episode, layers=RecordingLayers(replayed=[(0, episode.image(0).rgb), (1, changed)]))
    marked = {row["step"]: blob(row)[..., 3] > 0 for row in rows(path, "/simulator/differences")}
    assert not marked[0].any()
    assert marked[1].sum() == 8 and marked[1][3:5, 7:11].all()


def test_small_differences_are_none() -> None:
    picture = np.full((4, 5, 3), 100, np.uint8)
    assert not difference_layer(picture, picture + 2)[..., 3].any()
    assert difference_layer(picture, picture + 3)[..., 3].all()


@pytest.mark.long
def test_the_command_puts_all_steps_of_the_tiny_dataset_back(tiny: Path, tmp_path: Path) -> None:
    out = tmp_path / "e.rrd"
    result = CliRunner().invoke(app, ["view", str(tiny), "--replay", "--save", str(out)])
    assert result.exit_code == 0, result.stderr
    assert "/simulator/picture" in entities(out)
    layers = {row["step"]: blob(row) for row in rows(out, "/simulator/differences")}
    assert sorted(layers) == list(range(14))
    assert all((layer[..., 3] > 0).mean() <= 0.001 for layer in layers.values()), "equal, or as close as the rule asks"
