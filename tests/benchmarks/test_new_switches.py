"""The table of switches that nobody has looked at: how actions are counted by switch, and a small one."""

from pathlib import Path

import pytest

from benchmarks.tables import new_switches
from busybot.common.errors import UsageError
from busybot.evaluation.results import read_result
from busybot.interact.metrics import JudgedAction, JudgedBoard, JudgedLink


def action(key: str, link: int, success: bool) -> JudgedAction:
    on = "link" if key else "board"
    return JudgedAction(
        pixel=(0, 0), direction=0, executed=(0,), on=on, key=key, link=link, success=success, reward=success,
        changed_pixels=0, off_axis=None, vetoed=False,
    )  # fmt: skip


def test_links_are_counted_by_how_they_move() -> None:
    links = tuple(
        JudgedLink(object=number, key=key, link="link_0", pixels=9)
        for number, key in enumerate(("Switch/drawn-01", "Switch/drawn-08", "Switch/crank-02"))
    )
    acted = (action("Switch/drawn-01", 0, True), action("Switch/drawn-08", 1, False), action("", -1, False))
    told = new_switches.motions([JudgedBoard(board=number, links=links, actions=acted) for number in range(3)])
    assert told == {"crank": [0, 3], "press": [3, 3], "tilt": [0, 3]}


def test_a_library_of_another_number_of_switches_is_refused(tmp_path: Path) -> None:
    for number in range(1, 5):
        (tmp_path / "drawn-3" / "Switch" / f"drawn-{number:02d}").mkdir(parents=True)
    words = ["--work", str(tmp_path), "--seed", "3", "--drawn", "6", "--out", str(tmp_path / "told.json")]
    with pytest.raises(UsageError, match="drawn-3: it has 4 drawn switches, not 6"):
        new_switches.main(words)


@pytest.mark.long
def test_a_small_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The oracle moves all new switches, relations are found; the second run finds everything judged."""
    monkeypatch.setattr(new_switches, "POLICIES", {name: new_switches.POLICIES[name] for name in ("random", "oracle")})
    monkeypatch.setattr(new_switches, "BOARD_SEED", 3)  # no boards of a frozen set, which a judging would be logged of
    monkeypatch.setattr(new_switches, "REASONERS", ("event", "count"))
    words = ["--work", str(tmp_path / "work"), "--seed", "3", "--drawn", "4", "--boards", "2"]
    new_switches.main([*words, "--out", str(tmp_path / "told.json")])
    told = read_result(tmp_path / "told.json", new_switches.KIND)
    assert told["rows"]["new"]["oracle"]["recall"] == 1 > told["rows"]["new"]["random"]["recall"]
    assert set(told["rows"]["looked at"]["oracle"]["switches"]["motions"]).isdisjoint(new_switches.MOTIONS)
    assert told["relations"]["event"]["edge_r"] == 1 and told["hashes"]["data"]["new"]["board_hash"]
    new_switches.main([*words, "--out", str(tmp_path / "told.json")])
    assert read_result(tmp_path / "told.json", new_switches.KIND)["rows"] == told["rows"]
