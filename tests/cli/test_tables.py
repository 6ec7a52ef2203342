"""Tables in terminals: nothing is cut, however narrow the terminal is."""

import re

import pytest
from rich.table import Table

from busybot.cli.common import console

COLUMNS = [f"column{number}" for number in range(9)]
NAMES = ["first", "a second model with a long name", "Switch/" + "x" * 70]


def printed(capsys: pytest.CaptureFixture[str], table: Table) -> str:
    console().print(table)
    return re.sub(r"\x1b\[[0-9;]*m", "", capsys.readouterr().out)


def table_of(names: list[str], no_wrap: bool = True) -> Table:
    table = Table(title="a title", caption="a caption")
    table.add_column("name", no_wrap=no_wrap)
    for column in COLUMNS:
        table.add_column(column, justify="right", no_wrap=True)
    for row, name in enumerate(names):
        table.add_row(name, *(f"{row}{number}.{number}" for number in range(9)), end_section=row == 0)
    return table


@pytest.mark.parametrize("width", [30, 50, 80, 200])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_wide_table_comes_in_parts(
    width: int, count: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    text = printed(capsys, table_of(NAMES[:count]))
    assert "…" not in text and max(map(len, text.splitlines())) <= width
    for column in COLUMNS:
        assert len(re.findall(rf"\b{column}\b", text)) == 1
    for row in range(count):
        assert all(len(re.findall(rf"\b{row}{number}\.{number}\b", text)) == 1 for number in range(9))
    assert text.count("a title") == text.count("a caption") == 1
    parts = len(re.findall(r"┃ name\b", text))
    assert (parts == 1) == (width == 200) and text.count("first") == parts, "each part has the names"


def test_in_a_pipe_it_is_as_wide_as_it_needs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("TTY_COMPATIBLE", "0")
    text = printed(capsys, table_of(NAMES))
    assert "…" not in text and all(name in text for name in (*NAMES, *COLUMNS))
    assert text.count("first") == 1, "one row is one line"


def test_cells_that_may_wrap_do(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    table = Table("check", "found")
    table.add_row("Vulkan", "a driver with a description that takes several lines")
    text = printed(capsys, table)
    assert text.count("check") == 1 and "…" not in text and max(map(len, text.splitlines())) <= 40
