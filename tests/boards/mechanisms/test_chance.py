"""Luck: how often it comes, that what failed catches up, and that without it nothing moves by itself."""

import numpy as np
import pytest

from busybot.boards.mechanisms.chance import Clock, Flicker, Unreliable
from busybot.boards.mechanisms.gate import truth_table


def test_what_fails_catches_up_later() -> None:
    one = Unreliable(sizes=(2,), table=(0, 1), probability=0.5)
    assert one.start((1,)) == (1, (1,)) and one.step((1,), (0,), None) == (1, (1,))
    seen = set()
    for seed in range(40):
        rng, memory, late = np.random.default_rng(seed), (0,), 0
        while one.step((1,), memory, rng)[0] == 0:
            late += 1
        seen.add(late)
    assert {0, 1, 2} <= seen


def test_it_fires_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    one = Unreliable(sizes=(2, 2), table=truth_table("and", (2, 2)), probability=0.8)
    fired = [one.step((1, 1), (0,), rng)[0] for _ in range(4000)]
    assert np.mean(fired) == pytest.approx(0.8, abs=0.02)
    assert all(one.step((1, 1), (1,), rng) == (1, (1,)) for _ in range(100))  # it is where it is to be


@pytest.mark.parametrize("kind", [Flicker, Clock])
@pytest.mark.parametrize("table", [(0, 1), (1, 0)])
def test_a_flicker_changes_by_itself(kind: type[Flicker], table: tuple[int, int]) -> None:
    rng, one = np.random.default_rng(0), kind(sizes=(), table=table, probability=0.1)
    state, memory = one.start(())
    assert (state, memory) == (table[0], (0,)) and one.step((), memory, None) == (state, memory)
    changes, steps = 0, 4000
    for _ in range(steps):
        before = state
        state, memory = one.step((), memory, rng)
        assert state == table[memory[0]]
        changes += state != before
    assert changes / steps == pytest.approx(0.1, abs=0.02)


def test_probabilities_are_drawn_from_their_ranges() -> None:
    rng = np.random.default_rng(0)
    fires = [Unreliable.draw((2,), 2, False, rng) for _ in range(200)]
    flickers = [Flicker.draw((), 2, novel, rng) for novel in (False, True) for _ in range(100)]
    assert all(one and 0.7 <= one.probability <= 0.9 for one in fires)
    assert all(one and 0.05 <= one.probability <= 0.2 for one in flickers)
    assert len({one.probability for one in fires if one}) > 10
    assert Flicker.draw((2,), 2, False, rng) is None and Flicker.draw((), 3, False, rng) is None


def test_of_unreliable_ones_the_gates_are_held_out() -> None:
    rng = np.random.default_rng(0)
    assert Unreliable.draw((2,), 2, True, rng) is None and Unreliable.draw((3,), 3, False, rng) is not None
    trained, novel = ({Unreliable.draw((2, 2), 2, n, rng).table for _ in range(100)} for n in (False, True))  # type: ignore[union-attr]
    assert len(trained) == len(novel) == 4 and not trained & novel
    assert Unreliable.draw((2, 2), 3, False, rng) is None


def test_words() -> None:
    assert (
        Unreliable(sizes=(2,), table=(0, 1), probability=0.8).sentence(["a"]) == "follows a with luck (80% an action)"
    )
    assert Flicker(sizes=(), table=(0, 1), probability=0.1).sentence([]) == "flickers (10% an action)"
    assert Clock(sizes=(), table=(0, 1), probability=0.1).sentence([]) == "moves with a hidden clock (10% an action)"
