"""Delay, timer, toggle and latch do over time what their specifications say."""

from collections.abc import Sequence

import numpy as np
import pytest

from busybot.boards.mechanisms.base import Mechanism
from busybot.boards.mechanisms.delay import Delay
from busybot.boards.mechanisms.gate import truth_table
from busybot.boards.mechanisms.latch import Latch
from busybot.boards.mechanisms.timer import Timer, pressed
from busybot.boards.mechanisms.toggle import Toggle


def shown(one: Mechanism, *links: Sequence[int]) -> list[int]:
    """What the responder shows on the new board and after each action.

    Args:
        links: of each input its states, on the new board and after each action.
    """
    first, *after = zip(*links, strict=True)
    state, memory = one.start(first)
    states = [state]
    for inputs in after:
        state, memory = one.step(inputs, memory, None)
        states.append(state)
    return states


def test_a_delay_shows_the_table_of_some_actions_ago() -> None:
    two = Delay(sizes=(2,), table=(0, 1), actions=2)
    assert shown(two, [0, 1, 1, 1, 1]) == [0, 0, 0, 1, 1]  # the example of its specification
    rng = np.random.default_rng(0)
    for actions in (1, 2, 3):
        late = Delay(sizes=(3,), table=(1, 0, 2), actions=actions)
        link = rng.integers(3, size=40).tolist()
        assert shown(late, link) == [(1, 0, 2)[link[max(0, k - actions)]] for k in range(40)]
        assert late.lag == actions == len(late.start((0,))[1])


def test_a_delayed_gate() -> None:
    late = Delay(sizes=(2, 2), table=truth_table("and", (2, 2)), actions=1)
    assert shown(late, [0, 1, 1, 0, 0], [0, 0, 1, 1, 1]) == [0, 0, 0, 1, 0]


def test_training_has_delays_of_one_action() -> None:
    rng = np.random.default_rng(0)
    drawn = {n: [Delay.draw(sizes, 2, n, rng) for sizes in ((2,), (2, 2), (3, 2)) for _ in range(40)] for n in (0, 1)}
    assert {one.actions for one in drawn[0] if one} == {1} and {one.actions for one in drawn[1] if one} == {2, 3}
    assert all(one is not None for one in (*drawn[0], *drawn[1]))
    assert Delay.draw((2,), 3, False, rng) is None and Delay.draw((2, 2), 3, False, rng) is None


def test_a_timer_is_on_for_some_actions_after_each_press() -> None:
    two = Timer(sizes=(2,), table=(0, 1), actions=2)
    assert shown(two, [0, 1, 1, 1, 1]) == [0, 1, 1, 0, 0]  # the example of its specification
    assert shown(two, [0, 1, 0, 1, 1, 1]) == [0, 1, 1, 1, 1, 0]  # pressed again: it begins anew
    assert shown(two, [1, 1, 0, 0, 1, 1, 1]) == [0, 0, 0, 0, 1, 1, 0]  # that it is on is no press
    three = Timer(sizes=(3,), table=(0, 1), actions=2)
    assert shown(three, [0, 1, 2, 1, 0, 1]) == [0, 0, 1, 1, 0, 0]  # the middle is no press
    drawn = [Timer.draw((2,), 2, False, np.random.default_rng(k)) for k in range(40)]
    assert {one.actions for one in drawn if one} == {2, 3, 4}
    assert {one.table for one in drawn if one} == {(0, 1), (1, 0)}
    assert shown(Timer(sizes=(2,), table=(1, 0), actions=2), [0, 1, 1, 1, 1]) == [1, 0, 0, 1, 1]


@pytest.mark.parametrize("table", [(0, 1), (1, 0)])
def test_a_toggle_changes_with_every_press(table: tuple[int, int]) -> None:
    one, other = table
    toggle = Toggle(sizes=(2,), table=table)
    assert shown(toggle, [0, 1, 0, 1, 1, 0]) == [one, other, other, one, one, one]
    assert shown(toggle, [1, 0, 1]) == [one, one, other]
    assert shown(Toggle(sizes=(3,), table=table), [1, 2, 1, 0, 1, 2]) == [one, other, other, other, other, one]


def test_a_latch_is_set_by_one_link_and_reset_by_the_other() -> None:
    latch = Latch(sizes=(2, 2), table=(0, 1))
    # a lights the lamp, a again changes nothing, b puts it out, b again changes nothing
    assert shown(latch, [0, 1, 0, 1, 1, 1, 1], [0, 0, 0, 0, 1, 0, 1]) == [0, 1, 1, 1, 0, 0, 0]
    assert shown(latch.model_copy(update={"first": 1}), [0, 1, 1], [0, 0, 1]) == [1, 1, 0]
    assert shown(latch, [1, 1], [1, 1]) == [0, 0]  # both rest on a new board: nobody pressed
    wide = Latch(sizes=(3, 3), table=(1, 0))
    assert shown(wide, [0, 1, 2, 2, 2], [1, 1, 1, 0, 2]) == [1, 1, 0, 0, 1]


def test_pressed_is_what_comes_to_rest_at_the_upper_end() -> None:
    assert [pressed(before, after, 2) for before in (0, 1) for after in (0, 1)] == [False, True, False, False]
    assert pressed(1, 2, 3) and not pressed(0, 1, 3) and not pressed(2, 2, 3)


def test_the_split_of_new_mechanisms_has_the_toggle_and_training_the_timer_and_the_latch() -> None:
    rng = np.random.default_rng(0)
    for kind, sizes, novel in ((Toggle, (2,), True), (Timer, (2,), False), (Latch, (2, 3), False)):
        assert kind.draw(sizes, 2, novel, rng) is not None
        assert kind.draw(sizes, 2, not novel, rng) is None and kind.draw(sizes, 3, novel, rng) is None


def test_words() -> None:
    assert Delay(sizes=(2,), table=(0, 1), actions=1).sentence(["a"]) == "follows a, 1 action later"
    both = Delay(sizes=(2, 2), table=truth_table("nand", (2, 2)), actions=2)
    assert both.sentence(["a", "b"]) == "shows NAND(a, b), 2 actions later"
    assert Timer(sizes=(2,), table=(0, 1), actions=3).sentence(["a"]) == "is on for 3 actions after a is pressed"
    assert Timer(sizes=(2,), table=(1, 0), actions=3).sentence(["a"]) == "is off for 3 actions after a is pressed"
    assert Toggle(sizes=(2,), table=(0, 1)).sentence(["a"]) == "changes with every press of a"
    assert Latch(sizes=(2, 2), table=(0, 1)).sentence(["a", "b"]) == "is set by a, reset by b"
