"""`busybot features`, as a user runs it."""

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
    return CliRunner().invoke(app, ["features", *map(str, arguments)])


def test_json_is_one_object(dataset: Path) -> None:
    first, second = (json.loads(run(dataset, "--json", "--workers", 1).stdout) for _ in range(2))
    assert (first["episodes"], first["new"], second["new"]) == (3, 3, 0)
    assert (first["encoder"], first["oracle"], first["frames"]) == ("embedded", False, 21)
    assert Path(first["folder"]).is_dir()


def test_people_are_told_where_they_are(dataset: Path, tmp_path: Path) -> None:
    result = run(dataset, "--encoder", "embedded-box", "--store", tmp_path / "store", "--workers", 1)
    assert result.exit_code == 0 and result.stdout == ""
    assert "3 of them new" in result.stderr and str(tmp_path / "store") in result.stderr


def test_a_table_can_be_written_besides(dataset: Path, tmp_path: Path) -> None:
    result = run(dataset, "--parquet", tmp_path / "features.parquet", "--json", "--workers", 1)
    assert (tmp_path / "features.parquet").stat().st_size > 0
    assert json.loads(result.stdout)["parquet"] == str(tmp_path / "features.parquet")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--encoder", "vgg"), "no encoder 'vgg'"),
        (("--weights", "w.pth"), "takes no weights"),
        (("--encoder", "resnet50", "--weights", "absent.pth"), "absent.pth"),
    ],
)
def test_what_cannot_be_is_refused(dataset: Path, arguments: tuple[str, ...], message: str) -> None:
    result = run(dataset, *arguments)
    assert result.exit_code == (1 if message == "absent.pth" else 2) and message in result.stderr


def test_a_folder_that_is_no_dataset_is_refused(tmp_path: Path) -> None:
    assert "not a dataset" in json.loads(run(tmp_path, "--json").stdout)["error"]
