"""What a rollout tells about its decisions, and what a reader makes of notes that are none."""

import json
from typing import Any

import numpy as np
import pytest

from busybot.interact.policy.direction_pairs import pair_scores
from busybot.plan.agent_policy import Decision, is_rollout, notes, offered, reason
from busybot.plan.interfaces import Act, Contact, Stop
from tests.episodes.synthetic import make_task_episode
from tests.plan.toy import DOWN, UP

TOLD = {"pixel": [3, 4], "position": [0.1, 0.2, 0.3], "direction": 2, "score": 0.5, "step": -1}


def contact(pixel: tuple[int, int], step: int = -1) -> Contact:
    directions = np.zeros(18)
    directions[[UP, DOWN]] = 0.8, 0.9
    position = np.array([0.1, 1 / 3, 0.0], np.float32)
    return Contact(pixel, position, 0, 1, 0.5, directions, pair_scores(directions), step)


def test_notes_name_what_could_be_chosen_and_survive_json() -> None:
    again, new = contact((10, 20), 7), contact((30, 40))
    decisions = [
        Decision(Act(new, UP, "try it"), (again,), (new,), 1.0, 0.5),
        Decision(Stop("done"), (again,), None, 1.0, 0.0),
    ]
    episode = make_task_episode(steps=1)
    assert not is_rollout(episode) and not offered(episode, 0) and not reason(episode, 0)
    episode.settings |= json.loads(json.dumps(notes(decisions)))
    assert is_rollout(episode)
    assert [reason(episode, step) for step in range(3)] == ["try it", "stop: done", ""]
    first, second = offered(episode, 0)
    assert (first.pixel, first.step, second.pixel, second.step) == ((10, 20), 7, (30, 40), -1)
    assert first.direction == DOWN and first.score == pytest.approx(0.5 * (1 - 0.1 * 0.2), abs=1e-4)
    assert first.position == (0.1, 0.3333, 0.0)
    assert len(offered(episode, 1)) == 1 and offered(episode, 2) == []


@pytest.mark.parametrize(
    "told",
    [None, "offered", [None], [[1]], [[{**TOLD, "direction": 18}]], [[{**TOLD, "score": float("nan")}]], [[{}]]],
)
def test_notes_that_cannot_be_understood_are_none(told: Any) -> None:
    episode = make_task_episode(steps=1)
    episode.settings["offered"] = told
    assert offered(episode, 0) == []
    episode.settings["offered"] = [[TOLD]]
    assert offered(episode, 0)[0].direction == 2
