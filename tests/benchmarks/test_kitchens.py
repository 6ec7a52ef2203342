"""The table of a kitchen and a room: how boards are put together, and a small one."""

from pathlib import Path

import pytest

from benchmarks.tables import kitchens
from busybot.evaluation.results import read_result


def board(orderly: bool, hits: int, claimed: int) -> dict[str, object]:
    counts = {str(actions): [hits, claimed, 4] for actions in kitchens.JUDGED}
    return {"orderly": orderly, "objects": 14, "success": 30, "controls": [3, 4], "rows": {"count": counts}}


def test_boards_are_pooled_and_seeds_and_wirings_told_apart() -> None:
    told = kitchens.summed({900: [board(True, 4, 4), board(False, 2, 4)], 901: [board(True, 4, 4), board(False, 0, 0)]})
    row = told["rows"]["count"]["60"]
    assert row["p"] == pytest.approx(10 / 12) and row["r"] == 10 / 16 and row["f1"] == pytest.approx(20 / 28)
    assert (
        row["seeds"] == [0.75, pytest.approx(8 / 12)]
        and row["orderly"] == 1
        and row["permuted"] == pytest.approx(4 / 12)
    )
    assert told["controls"] == 0.75 and told["success"] == 0.5 and told["boards"] == 4


@pytest.mark.long
def test_a_small_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever takes links in turn moves all of them; the second run finds everything done."""
    monkeypatch.setattr(kitchens, "WAYS", ("coverage",))
    monkeypatch.setattr(kitchens, "STEPS", 14)
    words = ["--work", str(tmp_path / "work"), "--only", "kitchen", "--seeds", "1", "--boards", "2"]
    kitchens.main([*words, "--out", str(tmp_path / "told.json")])
    told = read_result(tmp_path / "told.json", kitchens.KIND)
    row = told["rows"]["kitchen, coverage"]
    assert row["controls"] == 1 and row["success"] == 1 and row["rows"]["event"]["10"]["f1"] > 0.8
    assert row["rows"]["all pairs"]["60"]["r"] == 1 and row["rows"]["nearest"]["60"]["f1"] < 0.5
    assert "data" in told["hashes"] and "event" in told["hashes"]["models"]
    kitchens.main([*words, "--out", str(tmp_path / "told.json")])
    assert read_result(tmp_path / "told.json", kitchens.KIND)["rows"] == told["rows"]
