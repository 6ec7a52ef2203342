"""What pictures would tell of boards that were moved without a simulator."""

import numpy as np
import pytest

from busybot.reason.inputs.trigger_links import numbered
from busybot.reason.models.mechanism.config import Blur
from busybot.reason.models.mechanism.contexts import Trace
from busybot.reason.models.mechanism.training.pictured import pictured

LENGTH, LINKS, RESPONDERS = 41, 4, 3
NOTHING: dict[str, float] = dict.fromkeys(Blur.model_fields, 0.0)


def told(seed: int = 0, **shares: float) -> tuple[Trace, Trace, np.ndarray, np.ndarray]:
    """A true trace and the told one, true parents and those among what is told."""
    rng = np.random.default_rng(seed)
    links = np.cumsum(np.arange(LINKS) == rng.integers(LINKS, size=LENGTH)[:, None], axis=0) % 2
    links = np.array([numbered(column) for column in links.T]).T
    responders = np.array([numbered(column) for column in rng.integers(2, size=(RESPONDERS, LENGTH))]).T
    true = Trace(links, responders, (2,) * LINKS)
    parents = np.zeros((LENGTH - 1, LINKS + RESPONDERS, RESPONDERS), bool)
    parents[:, [0, 1, 3], [0, 1, 2]] = True
    seen, kept, _ = pictured(true, parents, Blur(**(NOTHING | shares)), 1.0, rng)
    return true, seen, parents, kept


def moves(column: np.ndarray) -> int:
    return int((np.diff(column) != 0).sum())


def test_nothing_is_told_wrongly_where_nothing_is_seen_badly() -> None:
    true, seen, parents, kept = told()
    np.testing.assert_array_equal(seen.links, true.links)
    np.testing.assert_array_equal(seen.responders, true.responders)
    np.testing.assert_array_equal(kept, parents)
    assert seen.sizes == true.sizes


@pytest.mark.parametrize(
    ("states", "told", "way"),
    [
        ([1, 1, 2, 2, 1, 0, 1], [1, 1, 0, 0, 1, 2, 1], -1),  # it began in the middle, and rose first
        ([1, 0, 1, 2, 1, 1, 1], [1, 0, 1, 2, 1, 1, 1], 1),
        ([1, 1, 2, 2, 1, 1, 1], [0, 0, 1, 1, 0, 0, 0], 1),  # its lowest state was never seen
        ([1, 1, 0, 0, 1, 1, 1], [0, 0, 1, 1, 0, 0, 0], -1),
        ([2, 1, 0, 1, 2, 1, 0], [0, 1, 2, 1, 0, 1, 2], -1),
    ],
)
def test_links_of_three_states_are_numbered_as_pictures_number_them(
    states: list[int], told: list[int], way: int
) -> None:
    true = Trace(np.array(states)[:, None], np.zeros((7, 1), int), (3,))
    seen, _, rises = pictured(true, np.ones((6, 2, 1), bool), Blur(), 0.0, np.random.default_rng(0))
    assert (seen.links[:, 0].tolist(), seen.sizes, rises.tolist()) == (told, (max(told) + 1,), [way])


def test_what_seems_never_to_move_is_no_link() -> None:
    for seed in range(30):
        _, seen, _, kept = told(seed, missed=0.95, phantoms=1)
        assert (seen.links != seen.links[0]).any(0).all()
        assert kept.shape[1] == seen.links.shape[1] + RESPONDERS


def test_links_that_never_moved_are_not_told_nor_states_that_nobody_saw() -> None:
    links = np.zeros((9, 3), int)
    links[3:, 1] = 1  # of three states, two of which were seen
    links[5:7, 2] = 1
    trace = Trace(links, np.zeros((9, 1), int), (2, 3, 2))
    parents = np.ones((8, 4, 1), bool)
    parents[:, 1] = False
    seen, kept, _ = pictured(trace, parents, Blur(), 0.0, np.random.default_rng(0))
    np.testing.assert_array_equal(seen.links, links[:, 1:])
    assert seen.sizes == (2, 2) and kept[0, :, 0].tolist() == [False, True, True]


@pytest.mark.parametrize(
    ("share", "links", "responders"),
    [("confused", True, False), ("missed", True, False), ("flashes", False, True), ("covered", False, True)],
)
def test_each_share_tells_its_own_wrongly(share: str, links: bool, responders: bool) -> None:
    true, seen, _, kept = told(**{share: 0.3})
    assert (seen.links.shape, kept.shape) == (true.links.shape, (LENGTH - 1, LINKS + RESPONDERS, RESPONDERS))
    assert np.array_equal(seen.links, true.links) is not links
    assert np.array_equal(seen.responders, true.responders) is not responders


def test_a_missed_move_is_seen_at_the_next_one() -> None:
    true, seen, _, _ = told(missed=0.3)
    assert seen.links.shape == true.links.shape
    for column, states in zip(seen.links.T, true.links.T, strict=True):
        assert set(np.flatnonzero(np.diff(column))) <= set(np.flatnonzero(np.diff(states)))
    assert moves(seen.links.T.ravel()) < moves(true.links.T.ravel())


def test_a_hidden_responder_shows_what_it_did_for_up_to_four_pictures() -> None:
    true, seen, _, _ = told(covered=0.1)
    for column, states in zip(seen.responders.T, true.responders.T, strict=True):
        wrong = np.flatnonzero(column != states)
        assert all(column[step] == column[step - 1] for step in wrong)
    assert moves(seen.responders.T.ravel()) < moves(true.responders.T.ravel())


def test_still_ones_never_change_and_hidden_links_leave_with_their_relations() -> None:
    assert not np.diff(told(still=1)[1].responders, axis=0).any()
    true, seen, parents, kept = told(1, hidden=0.5)
    there = [column for column in true.links.T.tolist() if column in seen.links.T.tolist()]
    assert 0 < len(there) == seen.links.shape[1] == len(seen.sizes) < LINKS
    assert kept.shape[1] == len(there) + RESPONDERS and kept.sum() < parents.sum()


def test_a_phantom_decides_nothing() -> None:
    true, seen, parents, kept = told(phantoms=1)
    np.testing.assert_array_equal(seen.links[:, :LINKS], true.links)
    assert seen.links.shape[1] == LINKS + 1 == len(seen.sizes) and not kept[:, LINKS].any()
    np.testing.assert_array_equal(np.delete(kept, LINKS, axis=1), parents)
