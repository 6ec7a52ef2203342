"""`busybot dataset info` and `verify`, as a user runs them."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from busybot.cli.main import app
from tests.episodes.folders import make_dataset


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    return make_dataset(tmp_path / "toys").path


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["dataset", *map(str, arguments)])


def test_info_prints_one_object_with_counts_and_hashes(dataset: Path) -> None:
    result = run("info", dataset, "--json")
    assert result.exit_code == 0
    summary = json.loads(result.stdout)
    assert (summary["boards"], summary["episodes"], summary["steps"]) == (4, 3, 18)
    assert summary["bytes"] == sum(file.stat().st_size for file in (dataset / "episodes").iterdir())
    for key in ("board_hash", "trace_hash", "content_hash"):
        assert len(summary[key]) == 64
    assert (summary["split"], summary["policy"], summary["delta"]) == ("train", "random", 20)
    assert summary["success_share"] == pytest.approx(12 / 18)


def test_info_for_people_names_the_same_things(dataset: Path) -> None:
    result = run("info", dataset)
    assert result.exit_code == 0
    for text in ("boards", "66.7%", "procedural: p (5 objects)", "random"):
        assert text in result.stdout


def test_info_leaves_the_dataset_as_it_is(dataset: Path) -> None:
    (dataset / "tables/steps/part-00000.parquet").unlink()
    before = sorted(dataset.rglob("*"))
    assert run("info", dataset).exit_code == 0
    assert sorted(dataset.rglob("*")) == before


def test_info_of_an_empty_dataset(tmp_path: Path) -> None:
    result = run("info", make_dataset(tmp_path / "d", finished=()).path, "--json")
    summary = json.loads(result.stdout)
    assert (summary["episodes"], summary["success_share"]) == (0, None)


def test_verify_exits_with_1_and_names_the_fault(dataset: Path) -> None:
    assert run("verify", dataset).exit_code == 0
    sound = run("verify", dataset, "--json")
    assert json.loads(sound.stdout) == {"ok": True, "episodes": 3, "problems": []}
    (dataset / "episodes/000001.mcap").write_bytes(b"")
    broken = run("verify", dataset, "--json")
    assert broken.exit_code == 1
    report = json.loads(broken.stdout)
    assert report["ok"] is False
    assert report["problems"][0]["file"].endswith("000001.mcap") and report["problems"][0]["mend"]
    assert "000001.mcap" in run("verify", dataset).stderr


@pytest.mark.parametrize("command", ["info", "verify"])
def test_faults_of_input_exit_with_1_and_wrong_usage_with_2(tmp_path: Path, command: str) -> None:
    missing = run(command, tmp_path / "absent", "--json")
    assert missing.exit_code == 1
    assert "no such folder" in json.loads(missing.stdout)["error"]
    assert run(command).exit_code == 2
