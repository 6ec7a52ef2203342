"""The paper's kinds follow one link."""

import numpy as np
import pytest

from busybot.boards.mechanisms.direct import ManyEffects, ManyObjects, OneToOne
from busybot.boards.relations import STEP_OF_STATE


@pytest.mark.parametrize("kind", [OneToOne, ManyEffects, ManyObjects])
@pytest.mark.parametrize("table", [(0, 1), (1, 0), STEP_OF_STATE])
def test_the_responder_shows_what_the_table_says_of_the_links_state(
    kind: type[OneToOne], table: tuple[int, ...]
) -> None:
    one = kind(sizes=(len(table),), table=table)
    for state, shown in enumerate(table):
        assert one.start((state,)) == one.step((state,), (), None) == (shown, ())
    assert one.lag == 0 and one.parameters() == {}


def test_links_drive_responders_with_as_many_states() -> None:
    rng = np.random.default_rng(0)
    drawn = [OneToOne.draw((size,), stages, False, rng) for size in (2, 3) for stages in (2, 3) for _ in range(20)]
    assert {one.table for one in drawn if one} == {(0, 1), (1, 0), STEP_OF_STATE}
    assert all(len(one.table) == one.sizes[0] for one in drawn if one) and drawn.count(None) == 40
    assert OneToOne.draw((2, 2), 2, False, rng) is None and OneToOne.draw((2,), 2, True, rng) is None


def test_words() -> None:
    assert OneToOne(sizes=(2,), table=(0, 1)).sentence(["a"]) == "follows a"
    assert OneToOne(sizes=(2,), table=(1, 0)).sentence(["a"]) == "is the opposite of a"
