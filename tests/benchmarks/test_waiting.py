"""What people wait for: commands meet fresh copies of datasets, and what is subtracted is subtracted."""

from pathlib import Path

import pytest

from benchmarks.speed.waiting import ROWS, Checkout, Row, measure
from busybot.cli.main import load_command


class Told(Checkout):
    """Commands are noted, and take as long as they are told to."""

    def __init__(self, work: Path, *seconds: float) -> None:
        super().__init__(work, work)
        self.commands: list[str] = []
        self._seconds = iter(seconds)

    def seconds(self, words: str) -> float:
        super().seconds(words)
        return next(self._seconds)

    def run(self, words: str) -> None:
        self.commands.append(words)
        if "used/8" in words:
            assert (self.work / "used" / "8" / "boards").is_file()
            (self.work / "used" / "8" / "boards").unlink()  # as a command would change it


def test_datasets_are_fresh_and_starting_is_subtracted(tmp_path: Path) -> None:
    (tmp_path / "8").mkdir()
    (tmp_path / "8" / "boards").touch()
    checkout = Told(tmp_path, 5.0, 1.0, 9.0, 1.0, 7.0, 2.0)
    row = Row("busybot collect {8} --steps 24", "busybot collect {8} --steps 4", 2)
    assert measure(row, {"after": checkout}, 3) == {"after": 2.5}, "the median of 2, 4 and 2.5"
    assert checkout.commands == ["busybot collect used/8 --steps 24", "busybot collect used/8 --steps 4"] * 3


def test_a_command_that_fails_is_told(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="no-such-command"):
        Checkout(Path(__file__).parents[2], tmp_path).run("busybot no-such-command")


@pytest.mark.parametrize("row", [row for row in ROWS.values() if row.more.split()[:1] == ["busybot"]])
def test_rows_are_commands_that_there_are(row: Row) -> None:
    for words in filter(None, (row.more, row.less)):
        name = words.split()[1]
        assert name == "--help" or load_command(name)
