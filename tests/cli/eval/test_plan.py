"""`busybot eval plan`, as a user runs it."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from busybot.cli.eval import printing
from busybot.cli.main import app


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [*map(str, arguments)])


@pytest.mark.long
def test_from_nothing_to_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = tmp_path / "data"
    assert run("generate", data, "--tasks", "one-to-one", "--boards", 1, "--split", "novel-config").exit_code == 0
    assert run("collect", data, "--policy", "scripted", "--steps", 12, "--workers", 1).exit_code == 0
    given = ("--agents", "noop,oracle,search", "--workers", 1, "--out", tmp_path / "out", "--json")
    result = run("eval", "plan", data, *given)
    assert result.exit_code == 0, result.output
    values = json.loads(result.stdout)
    assert values["success"]["oracle"] == 1.0 and values["success"]["noop"] < 1
    assert values["command"].startswith("busybot eval plan") and values["tasks"] == 1
    assert json.loads((tmp_path / "out" / "result.json").read_text())["success"] == values["success"]
    assert (values["steps"], values["config"]["steps"]) == (8, 8)
    fewer = json.loads(run("eval", "plan", data, "--agents", "oracle", "--set", "steps=1", "--json").stdout)
    assert fewer["steps"] == 1 == fewer["agents"]["oracle"]["steps"]
    printing.planning(values)
    shown = capsys.readouterr().out
    assert "oracle*" in shown and "noop missed because of not tried" in shown
    assert "1 one-to-one task, at most 8 steps" in shown


def test_what_is_at_fault_is_told(tmp_path: Path) -> None:
    data = tmp_path / "data"
    assert run("generate", data, "--boards", 1).exit_code == 0
    result = run("eval", "plan", data, "--agents", "search", "--json")
    assert result.exit_code == 1 and "has no task" in json.loads(result.stdout)["error"]
    assert "--tasks" in json.loads(result.stdout)["hint"]
