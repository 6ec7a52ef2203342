"""A few damaged and hostile copies of every kind of file; `python -m tests.hostile.run` reads hundreds."""

from pathlib import Path

import pytest

from tests.hostile.run import KINDS_OF_FILES, SECONDS, parent

CASES = 12


@pytest.mark.long
@pytest.mark.parametrize("name", KINDS_OF_FILES)
def test_every_copy_is_refused_by_name_or_harmless(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(__file__).resolve().parents[2])
    result = parent(name, CASES, SECONDS)
    assert not result["findings"]
    assert sum(result["results"].values()) == CASES
