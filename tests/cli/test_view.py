"""`busybot view`, as a user runs it."""

import json
import os
import signal
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from busybot.cli.main import app
from busybot.episodes.mcap.writer import write_episode
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_real_episode


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    return make_dataset(tmp_path / "toys", finished=(1, 3)).path


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["view", *map(str, arguments)])


def test_a_dataset_shows_its_first_episode(dataset: Path, tmp_path: Path) -> None:
    result = run(dataset, "--save", tmp_path / "new" / "e.rrd", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout) == {
        "episode": str(dataset / "episodes/000001.mcap"),
        "steps": 6,
        "inferred": ["count"],
        "save": str(tmp_path / "new" / "e.rrd"),
        "screenshot": None,
        "figure": None,
        "url": None,
    }
    assert (tmp_path / "new" / "e.rrd").read_bytes()[:3] == b"RRF"


def test_being_asked_to_end_is_like_ctrl_c_while_it_runs(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def show(*given: object) -> None:
        assert not (tmp_path / "ended").exists()
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(5)
        except KeyboardInterrupt:
            (tmp_path / "ended").touch()

    monkeypatch.setattr("busybot.view.viewer.show", show)
    before = signal.getsignal(signal.SIGTERM)
    run(dataset, "--web")
    assert (tmp_path / "ended").exists() and signal.getsignal(signal.SIGTERM) is before


def test_episodes_are_chosen_by_number_or_by_file(dataset: Path, tmp_path: Path) -> None:
    by_number = run(dataset, "--episode", 3, "--save", tmp_path / "a.rrd", "--json")
    by_file = run(dataset / "episodes/000003.mcap", "--save", tmp_path / "a.rrd", "--json")
    assert by_number.exit_code == 0
    assert by_number.stdout == by_file.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "no such file or folder"),
        (["toys", "--episode", "0"], "episode 0 is not there"),
        (["toys", "--episode", "77"], "hint: its episodes are 1 to "),
        (["toys/episodes/000001.mcap", "--episode", "0"], "a file holds one episode"),
        (["toys", "--save", "e.rrd", "--screenshot", "e.png", "--step", "7"], "no step 7"),
        (["toys/dataset.json", "--save", "e.rrd"], "dataset.json"),
    ],
)
def test_faults_of_input_are_named_with_their_hint(
    arguments: list[str], said: str, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DISPLAY", ":0")
    result = run(*arguments)
    assert result.exit_code == 1
    assert said in result.stderr and "hint:" in result.stderr
    assert not list(tmp_path.glob("*.rrd"))


def test_an_empty_dataset_says_how_to_fill_it(tmp_path: Path) -> None:
    result = run(make_dataset(tmp_path / "d", finished=()).path, "--save", tmp_path / "e.rrd")
    assert result.exit_code == 1
    assert f"busybot collect {tmp_path / 'd'}" in result.stderr


def test_without_a_display_it_says_what_else_works(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    result = run(dataset)
    assert result.exit_code == 1
    for way in ("--web", "--save", "--screenshot"):
        assert way in result.stderr


def test_a_step_without_a_place_to_show_it_is_wrong_usage(dataset: Path, tmp_path: Path) -> None:
    assert run(dataset, "--save", tmp_path / "e.rrd", "--step", 2).exit_code == 2
    assert run(dataset, "--web", "--step", 2).exit_code == 2


@pytest.mark.parametrize(
    "words", [("--model", "procedural"), ("--model", "nobody"), ("--replay",), ("--replay", "--assets", "procedural")]
)
def test_what_a_figure_does_not_show_is_wrong_usage_without_another_output(
    words: tuple[str, ...], dataset: Path, tmp_path: Path
) -> None:
    refused = run(dataset, "--figure", tmp_path / "f.png", *words)
    assert refused.exit_code == 2 and words[0] in refused.stderr and not (tmp_path / "f.png").exists()


def test_a_folder_is_no_file_to_write(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "f.png").mkdir()
    refused = run(dataset, "--figure", tmp_path / "f.png")
    assert refused.exit_code == 1 and "is a folder" in refused.stderr


def test_a_reasoner_comes_before_counting(dataset: Path, tmp_path: Path) -> None:
    result = run(dataset, "--save", tmp_path / "e.rrd", "--reasoner", "lookup", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["inferred"] == ["lookup", "count"]


def test_an_unknown_reasoner_is_named(dataset: Path, tmp_path: Path) -> None:
    result = run(dataset, "--save", tmp_path / "e.rrd", "--reasoner", "oracle")
    assert result.exit_code == 1
    assert "oracle: no model of that name" in result.stderr and "lookup" in result.stderr


def test_a_figure_shows_how_the_graph_grew(dataset: Path, tmp_path: Path) -> None:
    picture = tmp_path / "new" / "beliefs.png"
    result = run(dataset, "--reasoner", "lookup", "--figure", picture, "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["figure"] == str(picture) and picture.read_bytes()[:4] == b"\x89PNG"


def test_a_figure_of_nothing_is_refused(tmp_path: Path) -> None:
    write_episode(tmp_path / "real.mcap", make_real_episode())
    result = run(tmp_path / "real.mcap", "--figure", tmp_path / "f.png")
    assert result.exit_code == 1 and "nothing can be inferred" in result.stderr


@pytest.mark.parametrize(("option", "name", "kind"), [("--save", "v.png", ".rrd"), ("--screenshot", "v.jpg", ".png")])
def test_files_of_another_kind_are_refused(option: str, name: str, kind: str, dataset: Path, tmp_path: Path) -> None:
    result = run(dataset, option, tmp_path / name)
    assert result.exit_code == 1 and f"it writes {kind} files" in result.stderr
    assert not (tmp_path / name).exists()


@pytest.mark.parametrize(("option", "name"), [("--save", "e.rrd"), ("--screenshot", "e.png"), ("--figure", "e.png")])
def test_where_nothing_can_be_written_is_told_before_the_work(option: str, name: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = run("nowhere.mcap", option, tmp_path / "file" / name)
    assert result.exit_code == 1 and "file is no folder" in result.stderr and "nowhere" not in result.stderr
