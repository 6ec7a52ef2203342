"""What an agent could choose from, in the recording for Rerun."""

from pathlib import Path

import numpy as np
import pytest

from busybot.view.rerun.recording import save_rrd
from tests.episodes.synthetic import make_task_episode
from tests.view.rerun.test_recording import entities, rows


def told(pixel: tuple[int, int], step: int) -> dict:
    return {"pixel": pixel, "position": (0.0, 0.5, 0.1), "direction": 2, "score": 0.5, "step": step}


def test_choices_stand_at_the_step_that_shows_their_action(tmp_path: Path) -> None:
    episode, path = make_task_episode(steps=2), tmp_path / "e.rrd"
    choices = [[told((5, 6), 3), told((7, 8), -1)], [told((9, 10), 4)], []]
    episode.settings |= {"decisions": ["object 1 differs", "again", "stop: done"], "offered": choices}
    save_rrd(path, episode)

    def places(name: str) -> dict[int, list]:
        return {row["step"]: row["Points2D:positions"] for row in rows(path, f"/choice/{name}/positions")}

    assert np.array(places("repeats")[1]) == pytest.approx(np.array([[5.5, 6.5]]))
    assert np.array(places("proposed")[1]) == pytest.approx(np.array([[7.5, 8.5]]))
    assert np.array(places("repeats")[2]) == pytest.approx(np.array([[9.5, 10.5]])) and not places("proposed")[2]
    labels = next(row["Points2D:labels"] for row in rows(path, "/choice/repeats/positions") if row["step"] == 1)
    assert labels == ["success 0.50, worked in step 4 of the history"]
    reasons = {row["step"]: row["Points2D:labels"] for row in rows(path, "/choice/reason")}
    assert reasons == {1: ["lamp 1 differs"], 2: ["again"]}
    chosen = {row["step"]: row["Points2D:positions"][0] for row in rows(path, "/choice/action/pixel")}
    assert chosen[1] == pytest.approx(np.array(episode.steps[0].pixel) + 0.5)
    assert "/choice/remaining" in entities(path)


def test_without_notes_nothing_is_shown(tmp_path: Path) -> None:
    save_rrd(tmp_path / "e.rrd", make_task_episode(steps=1))
    assert not [name for name in entities(tmp_path / "e.rrd") if name.startswith("/choice")]
