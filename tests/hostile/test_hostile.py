"""A few damaged and hostile copies of every kind of file; `python -m tests.hostile.run` reads hundreds."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.hostile.reading import KINDS_OF_FILES
from tests.hostile.run import cases_of, parent, with_others

CASES = 8


@pytest.mark.long
@pytest.mark.parametrize("name", KINDS_OF_FILES)
def test_every_copy_is_refused_by_name_or_harmless(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if "hdf5" in name and find_spec("h5py") is None:
        pytest.skip("h5py is not installed: `make extras`")
    monkeypatch.chdir(Path(__file__).resolve().parents[2])
    result = parent(name, cases := max(2, cases_of(name, CASES)))
    assert not result["findings"]
    assert sum(result["results"].values()) == cases


def test_kinds_that_were_not_tried_again_keep_their_rows_and_commits() -> None:
    first, second, *_ = KINDS_OF_FILES
    before = {"commit": "a", "kinds": {second: {"cases": 1}, first: {"cases": 2, "commit": "b"}, "gone": {}}}
    merged = with_others(before, {second: {"cases": 3, "commit": "c"}})
    assert merged == {first: {"cases": 2, "commit": "b"}, second: {"cases": 3, "commit": "c"}}
    assert list(merged) == [first, second]
