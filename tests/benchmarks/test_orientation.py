"""The observer who is not told which state of a link is on: its space, and what it knows of recorded boards."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.studies import orientation
from benchmarks.tables import worlds
from busybot.boards.mechanisms.direct import OneToOne
from busybot.evaluation.results import read_result
from busybot.reason.evaluation.hypotheses import Tabled, space_of


def test_a_table_is_turned_along_the_links_that_are() -> None:
    table = Tabled(sizes=(2, 3), table=(0, 1, 2, 3, 4, 5))
    assert orientation.turned(table, (True, False)).table == (3, 4, 5, 0, 1, 2)
    assert orientation.turned(table, (False, True)).table == (2, 1, 0, 5, 4, 3)
    assert orientation.turned(OneToOne(sizes=(2,), table=(0, 1)), (True,)).table == (1, 0)


def test_who_is_not_told_knows_twice_as_many_functions_of_two_links() -> None:
    space = space_of("gates", False, (2, 2, 2), ((True, False),) * 2)
    other = orientation.untold(space)
    pairs = [[len(one.inputs) == 2 for one in each.hypotheses] for each in (space, other)]
    assert [sum(each) for each in pairs] == [3 * 4, 3 * 8]
    np.testing.assert_allclose(other.prior.sum(0), space.prior.sum(0))
    for column in range(2):
        shares = [each.prior[np.array(two), column] for each, two in zip((space, other), pairs, strict=True)]
        np.testing.assert_allclose(shares[1].sum(), shares[0].sum())
        np.testing.assert_allclose(shares[1].max(), shares[0].max() / 2)
    single = [sum(len(one.inputs) == 1 for one in each.hypotheses) for each in (space, other)]
    assert single[0] == single[1], "the opposite of one link was there before"


@pytest.mark.long
def test_it_knows_less_of_recorded_boards(tmp_path: Path) -> None:
    words = ["--data", str(tmp_path / "data"), "--assets", "procedural"]
    worlds.record([*words, "--only", "gates", "--sets", "others", "--most", "6"])
    out = tmp_path / "out.json"
    orientation.main([*words, "--boards", "5", "--out", str(out)])
    told = read_result(out, "orientation")
    assert told["boards"] == 5 and set(told["hashes"]["data"]) == {"gates/others"}
    rows = told["rows"]
    assert rows["told"]["responders"] == rows["untold"]["responders"] > 10
    for row in rows.values():
        f1 = [one["share"] for one in row["link_parent_f1"].values()]
        assert 0 < f1[0] < f1[-1] <= 1 and 0 < row["mechanism"]["share"] < 1
    assert rows["untold"]["mechanism"]["share"] <= rows["told"]["mechanism"]["share"]
