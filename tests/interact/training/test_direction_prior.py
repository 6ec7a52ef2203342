"""What experience says about pairs of directions that work, or fail, together."""

import numpy as np

from busybot.boards.directions import OPPOSITE
from busybot.interact.policy.direction_pairs import PAIRS
from busybot.interact.training.fast import after_failure, pair_outcomes


def recorded(*cases: tuple[tuple[int, ...], int | None]) -> tuple[np.ndarray, np.ndarray]:
    """Pairs that were tried, in both directions, and the one that worked at last."""
    executed, worked = np.zeros((len(cases), 18), bool), np.full(len(cases), -1)
    for row, (tried, right) in enumerate(cases):
        for pair in tried:
            executed[row, [PAIRS[pair], OPPOSITE[PAIRS[pair]]]] = True
        if right is not None:
            executed[row, OPPOSITE[PAIRS[right]]] = True
            worked[row] = OPPOSITE[PAIRS[right]]
    return executed, worked


def test_only_rewarded_actions_tell_which_pairs_failed() -> None:
    failed, right = pair_outcomes(*recorded(((4, 2), 7), ((1,), None), ((), 3)))
    assert np.argwhere(failed).tolist() == [[0, 2], [0, 4]]
    assert np.argwhere(right).tolist() == [[0, 7], [1, 3]]


def test_pairs_that_fail_together_lose_and_the_one_that_takes_over_gains() -> None:
    press, aslant, slide = 8, 1, 2
    cases = [((), press)] * 40 + [((), aslant)] * 40 + [((), slide)] * 20
    cases += [((press,), slide)] * 30 + [((press,), aslant)] * 2 + [((slide,), press)] * 30 + [((slide,), aslant)] * 30
    table = np.array(after_failure(*recorded(*cases)))
    assert table[press, slide] > 1 and table[press, aslant] < -1
    assert table[slide, press] > 0 and table[slide, aslant] > 0 > table[slide, slide]
    assert (table[5] == 0).all()  # it never failed where something worked


def test_without_experience_nothing_is_gained() -> None:
    assert (np.array(after_failure(*recorded(((3,), None)))) == 0).all()
