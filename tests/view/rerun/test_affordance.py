"""What a model believes, in the recording for Rerun."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from rerun.chunk import RrdReader
from typer.testing import CliRunner

from busybot.cli.main import app
from busybot.interact.policy.policy_trace import retrace
from busybot.view.rerun.recording import RecordingLayers, save_rrd
from busybot.view.rerun.skills import affordance_layer, link_outlines
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode
from tests.interact.scenes import ButtonModel
from tests.view.rerun.test_recording import entities, rows


def test_beliefs_stand_at_the_step_that_shows_their_action(tmp_path: Path) -> None:
    episode, path = make_episode(steps=4), tmp_path / "e.rrd"
    save_rrd(path, episode, layers=RecordingLayers(retrace(episode, ButtonModel())))
    assert [row["step"] for row in rows(path, "/affordance/map")] == [1, 2, 3, 4]
    places = {row["step"]: row["Points2D:positions"][0] for row in rows(path, "/affordance/action/pixel")}
    for index, step in enumerate(episode.steps):
        assert places[index + 1] == pytest.approx(np.array(step.pixel) + 0.5)
    drawn = {row["step"]: row["Points2D:positions"] for row in rows(path, "/affordance/candidates/positions")}
    for thought in retrace(episode, ButtonModel()):
        promising = thought.candidates.pixels[thought.candidates.scores > 0.05]
        assert np.array(drawn[thought.step + 1]).reshape(-1, 2) == pytest.approx(promising + 0.5)


def test_without_a_model_there_is_no_affordance(tmp_path: Path) -> None:
    save_rrd(tmp_path / "e.rrd", make_episode(steps=1))
    assert not [name for name in entities(tmp_path / "e.rrd") if name.startswith("/affordance")]


def test_certain_affordance_is_opaque_and_none_is_invisible() -> None:
    layer = affordance_layer(np.array([[0.0, 1.0], [0.5, 0.25]]))
    assert layer.shape == (2, 2, 4) and layer[0, 0, 3] == 0
    assert layer[0, 1, 3] > layer[1, 0, 3] > layer[1, 1, 3] > 0


def test_every_known_link_has_a_closed_outline_around_it() -> None:
    links = np.zeros((40, 60), np.int32)
    links[5:15, 10:20], links[5:15, 20:30] = 1, 2  # neighbours stay two
    first, second = link_outlines(links)
    for outline, left in ((first, 10), (second, 20)):
        assert (outline[0] == outline[-1]).all()
        assert outline.min(axis=0) == pytest.approx([left + 0.5, 5.5])
        assert cv2.contourArea(outline) == pytest.approx(81)


def test_the_command_shows_what_a_shipped_model_believes(tmp_path: Path) -> None:
    dataset, out = make_dataset(tmp_path / "d", finished=(0,)).path, tmp_path / "e.rrd"
    result = CliRunner().invoke(app, ["view", str(dataset), "--model", "procedural", "--save", str(out)])
    assert result.exit_code == 0, result.stderr
    assert "/affordance/map" in set(RrdReader(out).store().schema().entity_paths())
    result = CliRunner().invoke(app, ["view", str(dataset), "--model", "nobody", "--save", str(tmp_path / "f.rrd")])
    assert result.exit_code == 1 and "nobody" in result.stderr
    assert not (tmp_path / "f.rrd").exists()
