"""The constraint-based competitor on boards whose relations are known by hand."""

import sys

import numpy as np
import pytest

from busybot.common.errors import BusybotError
from busybot.reason.models.counting import PcConfig, discover_changes

ABSENT = "causal-learn is not installed: `make extras`"
TRIGGERS, RESPONDERS = np.array([0, 1, 2]), np.array([3, 4, 5])


def twelve_steps() -> tuple[np.ndarray, np.ndarray]:
    """Trigger 0 drives 3, trigger 1 drives 4, trigger 2 and responder 5 nothing; every action works."""
    acted = np.array([0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 2, 2])
    changed = np.zeros((12, 6), bool)
    changed[acted == 0, 3] = changed[acted == 1, 4] = True
    return changed, acted


def test_tests_of_pairs_find_what_changes_together() -> None:
    pytest.importorskip("causallearn", reason=ABSENT, exc_type=ImportError)
    edges = discover_changes(*twelve_steps(), TRIGGERS, RESPONDERS, PcConfig(condition=0))
    assert edges.shape == (12, 6, 6)
    assert {(int(i), int(j)) for i, j in np.argwhere(edges[-1])} == {(0, 3), (1, 4)}
    assert not edges[0].any(), "one sample shows no dependence"


def test_full_conditioning_loses_edges_as_actions_determine_each_other() -> None:
    """With two triggers, which one was acted on follows from the other."""
    pytest.importorskip("causallearn", reason=ABSENT, exc_type=ImportError)
    changed, acted = twelve_steps()
    full = discover_changes(changed[:10], acted[:10], TRIGGERS[:2], RESPONDERS, PcConfig())
    assert not full[-1].any()


def test_without_changes_there_are_no_edges() -> None:
    config = PcConfig()
    assert not discover_changes(np.zeros((4, 6), bool), np.zeros(4, int), TRIGGERS, RESPONDERS, config).any()
    assert discover_changes(np.zeros((0, 6), bool), np.zeros(0, int), TRIGGERS, RESPONDERS, config).shape == (1, 6, 6)


def test_the_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "causallearn.graph.GraphNode", None)
    with pytest.raises(BusybotError, match=r"causal-learn is not installed\n.*\[causal\]"):
        discover_changes(*twelve_steps(), TRIGGERS, RESPONDERS, PcConfig())
