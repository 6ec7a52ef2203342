"""Looking effects up in past contacts."""

import numpy as np
import pytest

from busybot.reason.inputs.sequence import CHANNELS, BoardSequence
from busybot.reason.models.lookup import Lookup, LookupConfig
from tests.reason.boards import make_boards
from tests.reason.judging import score

OFF, ON, RED = (np.full(CHANNELS, value, np.float32) for value in (1.0, 2.0, 3.0))


def sequence(looks: list[np.ndarray], contacts: list[float], acted: list[int] | None = None) -> BoardSequence:
    """Trigger 0 and lamp 1; contacts at these places along x, pulled along z."""
    features = np.stack([np.stack([np.zeros(CHANNELS, np.float32), look]) for look in looks])
    actions = np.array([[x, 0, 0, 0, 0, 1] for x in contacts], np.float32)
    return BoardSequence(
        features,
        np.zeros((2, 3), np.float32),
        actions,
        np.array(acted or [0] * len(contacts)),
        np.array([True, False]),
        np.array([False, True]),
    )


def expected(seen: BoardSequence, look: np.ndarray, contact: float, trigger: int = 0) -> np.ndarray:
    """What the lamp looks like after a step."""
    current = np.stack([np.zeros(CHANNELS, np.float32), look])[None]
    action = np.array([[contact, 0, 0, 0, 0, 1]], np.float32)
    after = Lookup().predict(seen, current, action, np.array([trigger]))
    assert after.shape == (1, 2, CHANNELS) and not after[0, 0].any()
    return np.asarray(after[0, 1])


def test_what_happened_before_happens_again_and_can_be_undone() -> None:
    seen = sequence([OFF, ON, ON], [0.0, 0.3])
    np.testing.assert_array_equal(expected(seen, OFF, 0.02), ON)
    np.testing.assert_array_equal(expected(seen, ON, 0.02), OFF)


def test_far_from_all_that_worked_nothing_happens() -> None:
    seen = sequence([OFF, ON, ON], [0.0, 0.3])
    np.testing.assert_array_equal(expected(seen, OFF, 0.5), OFF)
    np.testing.assert_array_equal(expected(seen, OFF, 0.02, trigger=-1), OFF)


def test_from_a_look_in_which_nothing_began_nothing_is_copied() -> None:
    np.testing.assert_array_equal(expected(sequence([OFF, ON, ON], [0.0, 0.3]), RED, 0.0), RED)


def test_before_anything_was_seen_nothing_happens() -> None:
    seen = sequence([OFF], [])
    np.testing.assert_array_equal(expected(seen, OFF, 0.0), OFF)
    assert Lookup().graph(seen).probabilities.shape == (1, 2, 2)
    np.testing.assert_allclose(Lookup().graph(seen).after(0), [[0, 0.5], [0, 0]])


def test_changes_smaller_than_the_threshold_are_noise() -> None:
    seen = sequence([OFF, ON, OFF, ON], [0.0, 0.0, 0.0])
    assert Lookup().graph(seen).claimed(3)[0, 1]
    blind = Lookup(config=LookupConfig(changed=100))
    assert not blind.graph(seen).claimed(3).any()


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_it_is_right_where_no_action_fails(noise: float) -> None:
    found = score(Lookup(), make_boards(60, 1, failing=0.0, noise=noise))
    assert found.precision == 1 and found.recall > 0.97
    assert found.right_changes > 0.95
