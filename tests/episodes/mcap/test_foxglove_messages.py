"""What other viewers are shown stands where it stands in the recording."""

import numpy as np
import pytest

from busybot.boards.directions import DIRECTIONS
from busybot.episodes.mcap.foxglove_messages import quaternion, towards


def rotation(q: tuple[float, float, float, float]) -> np.ndarray:
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.mark.parametrize("seed", range(12))
def test_rotations_become_quaternions(seed: int) -> None:
    q = np.random.default_rng(seed).normal(size=4)
    matrix = rotation(tuple(q / np.linalg.norm(q)))
    np.testing.assert_allclose(rotation(quaternion(matrix)), matrix, atol=1e-12)


@pytest.mark.parametrize("diagonal", [(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
def test_half_turns_too(diagonal: tuple[int, int, int]) -> None:
    np.testing.assert_allclose(rotation(quaternion(np.diag(diagonal))), np.diag(diagonal), atol=1e-12)


@pytest.mark.parametrize("index", range(len(DIRECTIONS)))
def test_arrows_point_along_the_direction(index: int) -> None:
    np.testing.assert_allclose(rotation(towards(DIRECTIONS[index]))[:, 0], DIRECTIONS[index], atol=1e-12)
