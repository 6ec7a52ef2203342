"""The 18 directions of the paper."""

import numpy as np

from busybot.boards.directions import DIRECTIONS, OPPOSITE


def test_unit_vectors_of_faces_and_edges() -> None:
    assert DIRECTIONS.shape == (18, 3)
    assert np.allclose(np.linalg.norm(DIRECTIONS, axis=1), 1)
    assert sorted(np.count_nonzero(DIRECTIONS, axis=1)) == [1] * 6 + [2] * 12
    assert len({tuple(row) for row in DIRECTIONS.round(6)}) == 18


def test_opposites() -> None:
    assert np.allclose(DIRECTIONS[OPPOSITE], -DIRECTIONS)
    assert np.array_equal(OPPOSITE[OPPOSITE], np.arange(18))
