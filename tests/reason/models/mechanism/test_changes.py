"""Mechanisms that are exchanged are noticed, and nothing else is."""

import numpy as np
import pytest
import torch

from busybot.reason.models.mechanism.changes import NOTHING, _Counted, _likeliest, changes_of
from busybot.reason.models.mechanism.contexts import MEMORIES, Trace, explanations_of
from busybot.reason.models.mechanism.evidence import SCALE, evidence_of

ENOUGH = 3.0
"""Log odds that speak for a change where one in twenty responders changes."""


def walk(actions: int, seed: int) -> np.ndarray:
    """States of three links, one of which is flipped in every action."""
    flips = np.eye(3, dtype=int)[np.random.default_rng(seed).integers(3, size=actions)]
    return np.concatenate([np.zeros((1, 3), int), np.cumsum(flips, axis=0) % 2])


@pytest.mark.parametrize("seed", range(4))
def test_another_mechanism_is_noticed_and_placed(seed: int) -> None:
    links = walk(40, seed)
    late = np.arange(41) > 22  # from action 22 on, numbered from 0
    old, new = links[:, 0], links[:, 1] | links[:, 2]
    shown = np.stack([np.where(late, new, old), links[:, 0] & links[:, 1], np.zeros(41, int)], axis=1)
    trace = Trace(links, shown, (2, 2, 2))
    found = explanations_of(trace)
    changes = changes_of(trace, found, range(41))
    told, first = changes.odds, changes.places
    showed = int(np.flatnonzero(late & (old != new))[0])
    assert told.shape == (41, 3, 3)
    told = told[..., 0]
    assert told[:showed].max() < ENOUGH, "nobody can know before it shows"
    assert told[showed : showed + 11, 0].max() > ENOUGH and told[-1, 0] > ENOUGH and 21 <= first[0] <= showed
    assert told[:, 1:].max() < ENOUGH
    assert not changes.since[..., :8].any(), "too few actions to tell"
    shares = changes.since[0, :, 40]
    alone, either = (found.inputs == row for row in ([1, 0, 0, 0, 0, 0], [0, 1, 1, 0, 0, 0]))
    now = found.memory == MEMORIES.index("late 0")
    was, became = (int(np.flatnonzero(rows.all(1) & now)[0]) for rows in (alone, either))
    assert shares[became] > shares[was] + 2 and shares.max() == 0


def test_each_kind_of_explanation_is_compared_with_itself() -> None:
    """A toggle that never changes: links as they are now cannot explain it, before any moment or after."""
    links = walk(40, 3)
    pressed = (np.diff(links[:, 0], prepend=0) > 0).cumsum() % 2
    trace = Trace(links, pressed[:, None], (2, 2, 2))
    now = changes_of(trace, explanations_of(trace), range(41))
    assert now.odds[..., 0].max() < 0 and np.median(now.odds[10:, 0, 2]) < ENOUGH


def test_what_shows_by_luck_is_no_other_mechanism() -> None:
    links, rng = walk(40, 7), np.random.default_rng(7)
    shown = np.zeros((41, 1), int)
    for action in range(1, 41):  # it catches up with its link in three of four actions
        shown[action] = links[action, 0] if rng.random() < 0.75 else shown[action - 1]
    told = changes_of(Trace(links, shown, (2, 2, 2)), explanations_of(Trace(links, shown, (2, 2, 2))), range(41)).odds
    assert told[..., 0].max() < ENOUGH < told[..., 1:].max((0, 1)).min(), "who knows of no luck takes it for a change"


def test_without_actions_nothing_is_said() -> None:
    trace = Trace(np.zeros((1, 2), int), np.zeros((1, 1), int), (2, 2))
    changes = changes_of(trace, explanations_of(trace), [0])
    assert changes.odds.tolist() == [[[NOTHING] * 3]] and not changes.since.any()


@pytest.mark.parametrize("hidden", [0.0, 0.2])
def test_since_the_new_board_it_is_what_the_evidence_says(hidden: float) -> None:
    links, rng = walk(30, 5), np.random.default_rng(5)
    shown = np.stack([links[:, 0], np.maximum.accumulate(rng.integers(3, size=31))], axis=1)
    trace = Trace(links, shown, (2, 2, 2), rng.random(shown.shape) < hidden)
    found = explanations_of(trace)
    told = SCALE * evidence_of(trace, found, range(31)).explanations
    for number in range(2):
        seen = torch.from_numpy(trace.seen[:, number])
        logs = _Counted(found, 31).explained(torch.from_numpy(shown[:, number]), seen)[..., 0].cumsum(1)
        right = torch.where(torch.from_numpy(found.own)[:, None], told[number, ..., 2], told[number, ..., 0])
        assert torch.allclose(logs, right, atol=1e-4)


def test_what_a_hand_hides_is_no_change() -> None:
    """A lamp that seems to stay as it was behind a hand goes on following its switch, for all that is known."""
    links, shown = walk(40, 1), walk(40, 1)[:, :1]
    shown[29:] = shown[28]
    assert (shown[:, 0] != links[:, 0]).sum() >= 2
    hidden = np.isin(np.arange(41), range(29, 41))[:, None]
    traces = [Trace(links, shown, (2, 2, 2), one) for one in (None, hidden)]
    blind, seen = (changes_of(one, explanations_of(one), [40]).odds[0, 0, 1] for one in traces)
    assert seen < ENOUGH < blind


def test_a_change_lies_where_it_is_likely_at_several_moments_side_by_side() -> None:
    assert _likeliest(torch.tensor([0.0, 0.35, 0.0, 0.0, 0.2, 0.25, 0.2, 0.0])) == 5
    assert _likeliest(torch.tensor([0.6, 0.1, 0.1, 0.1, 0.1])) in (0, 1), "the first moment has a neighbour, too"
