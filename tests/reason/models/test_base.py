"""What a reasoner says about a recording, whenever it is asked for."""

import numpy as np

from busybot.reason.models.base import InferredGraph, InferredLinks


def test_what_is_believed_last_stays_also_where_nothing_was_done() -> None:
    links = InferredLinks(np.array([0, 1]), np.arange(6.0).reshape(2, 1, 3))
    assert [links.after(steps).tolist() for steps in (0, 1, 9)] == [[[0, 0, 0]], [[0, 1, 2]], [[3, 4, 5]]]
    still = InferredGraph(
        "m", np.full((1, 2, 2), 0.1), links=InferredLinks(np.zeros(0, int), np.zeros((0, 1, 2))), prior=np.zeros((2, 2))
    )
    assert still.links is not None
    assert still.after(9).tolist() == [[0.1] * 2] * 2 and still.links.after(9).tolist() == [[0, 0]]
