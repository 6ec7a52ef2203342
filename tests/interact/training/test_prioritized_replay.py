"""Prioritised replay: half successes, rare ones and hard failures more often."""

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.interact.training.config import ReplayConfig
from busybot.interact.training.fast_learner import Priorities

REWARD = np.arange(100) < 10


def draws(priorities: Priorities, weights: np.ndarray | None = None, count: int = 4000) -> np.ndarray:
    given = np.ones(100) if weights is None else weights
    return priorities.draw(REWARD, given, 0, count, generator(0, "train", 0, "test"))


def fresh() -> Priorities:
    return Priorities(ReplayConfig(), 100)


def test_half_of_a_batch_was_rewarded() -> None:
    assert REWARD[draws(fresh(), count=32)].sum() == 16


def test_what_the_network_gets_wrong_is_shown_more_often() -> None:
    priorities = fresh()
    priorities.update(np.arange(100), np.full(100, 0.05, np.float32))
    priorities.update(np.array([3, 50]), np.array([9.0, 9.0], np.float32))
    counts = np.bincount(draws(priorities), minlength=100)
    assert counts[3] > 3 * counts[[0, 1, 2, 4, 5]].max()
    assert counts[50] > 3 * np.delete(counts, 50)[10:].max()


def test_failures_of_later_rounds_weigh_more() -> None:
    weights = np.where(np.arange(100) < 55, 1.0, 5.0)
    drawn = draws(fresh(), weights)
    failures = drawn[~REWARD[drawn]]
    assert (failures >= 55).mean() == pytest.approx(5 / 6, abs=0.03)


def test_without_any_success_there_is_nothing_to_learn() -> None:
    priorities = fresh()
    with pytest.raises(BusybotError, match="no recorded action succeeded"):
        priorities.draw(np.zeros(100, bool), np.ones(100), 0, 8, generator(0, "train", 0, "test"))
