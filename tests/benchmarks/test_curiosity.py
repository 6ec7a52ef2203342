"""The study of which action next: what it counts, and that a small one works."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.studies import curiosity
from busybot.objects.resolve import find


def test_when_relations_are_known_is_the_first_action_after_which_f1_is_high_enough() -> None:
    """Two boards, three actions: F1 of both together is .5, then .95, then 1."""
    counts = np.array([[[5, 10, 10], [9, 10, 10], [10, 10, 10]], [[5, 10, 10], [10, 10, 10], [10, 10, 10]]])
    told = curiosity.figures(counts, "gates")
    assert told["f1"] == pytest.approx([0.5, 0.95, 1.0]) and told["until"] == 2
    never = curiosity.figures(counts[:, :1], "gates")
    assert never["until"] == 2, "one more than there were"


@pytest.mark.long
def test_a_small_study(tmp_path: Path) -> None:
    library = find("procedural")
    found = curiosity.drawn("gates", 1, (*curiosity.CHOICES, "greedy"), library, seed=3)
    assert {len(told["f1"]) for told in found.values()} == {curiosity.ACTIONS}
    assert found["greedy"]["regret"] == 0 and found["curious"]["f1"][-1] > 0.8
    again = curiosity.drawn("gates", 1, ("curious",), library, seed=3)
    assert again["curious"]["f1"] == found["curious"]["f1"]
    curiosity.curves(tmp_path / "curves.png", {"rows": {"gates": {"drawn": found}}})
    assert (tmp_path / "curves.png").read_bytes()[:4] == b"\x89PNG"
