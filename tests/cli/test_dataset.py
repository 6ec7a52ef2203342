"""`busybot dataset` as a user runs it."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from busybot.cli.main import app
from busybot.common.atomic_io import scan
from busybot.datasets import freeze as freezing
from busybot.episodes.mcap.writer import write_episode
from tests.datasets.camera_folders import write_camera_folder
from tests.datasets.test_imports_of_containers import log_of, state_rows, with_keys
from tests.episodes.folders import make_dataset
from tests.episodes.synthetic import make_episode

pytestmark = pytest.mark.usefixtures("in_process")


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
    assert summary["world"] == "paper" and summary["links"] is None


def test_the_tiny_dataset_comes_with_the_package(tmp_path: Path) -> None:
    place = tmp_path / "datasets/tiny"
    assert run("tiny", "--out", str(place)).exit_code == 0
    told = run("verify", str(place), "--workers", "1", "--json")
    assert told.exit_code == 0 and json.loads(told.stdout)["frozen"]
    again = run("tiny", "--out", str(place))
    assert again.exit_code == 1 and "it exists and is not an empty folder" in " ".join(again.stderr.split())
    other = json.loads(run("tiny", "--out", str(tmp_path / "other"), "--json").stdout)
    assert Path(other["out"]) == tmp_path / "other" and other["files"] == len(scan(place).files)


def test_info_for_people_names_the_same_things(dataset: Path) -> None:
    result = run("info", dataset)
    assert result.exit_code == 0
    for text in ("boards", "66.7%", "procedural: p (5 objects)", "random"):
        assert text in result.stdout


def test_info_names_the_world_and_its_links(tmp_path: Path) -> None:
    drawn = ("generate", str(tmp_path / "d"), "--world", "gates", "--boards", "1", "--links", "3-5")
    assert CliRunner().invoke(app, drawn).exit_code == 0
    summary = json.loads(run("info", tmp_path / "d", "--json").stdout)
    assert summary["world"] == "gates" and summary["links"] == [3, 5]
    assert "gates" in run("info", tmp_path / "d").stdout and "3-5" in run("info", tmp_path / "d").stdout


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
    expected = {"ok": True, "boards": 4, "episodes": 3, "problems": [], "frozen": False, "objects": None}
    assert json.loads(sound.stdout) == expected
    (dataset / "episodes/000001.mcap").write_bytes(b"")
    broken = run("verify", dataset, "--json")
    assert broken.exit_code == 1
    report = json.loads(broken.stdout)
    assert report["ok"] is False
    assert report["problems"][0]["file"].endswith("000001.mcap") and report["problems"][0]["hint"]
    assert "000001.mcap" in run("verify", dataset).stderr


@pytest.mark.parametrize("command", ["info", "verify", "freeze", "repair"])
def test_faults_of_input_exit_with_1_and_wrong_usage_with_2(tmp_path: Path, command: str) -> None:
    missing = run(command, tmp_path / "absent", "--json")
    assert missing.exit_code == 1
    assert "no such folder" in json.loads(missing.stdout)["error"]
    assert run(command).exit_code == 2


def test_freeze_prints_what_it_did_and_verify_looks_at_all_files(dataset: Path) -> None:
    unfinished = run("freeze", dataset, "--no-objects", "--json")
    assert unfinished.exit_code == 1 and "3 of 4 boards" in json.loads(unfinished.stdout)["error"]
    whole = make_dataset(dataset.with_name("whole"), finished=range(4)).path
    lost = run("freeze", whole)
    assert lost.exit_code == 1 and "--no-objects" in lost.stderr and "--assets" in lost.stderr
    lost = run("freeze", whole, "--no-objects", "--assets", dataset.with_name("none"))
    assert lost.exit_code == 1 and "leave --assets out" in lost.stderr and "--no-objects" not in lost.stderr
    done = run("freeze", whole, "--no-objects", "--json")
    assert done.exit_code == 0, done.stderr
    facts = json.loads(done.stdout)
    assert (facts["new"], facts["files"], facts["objects_carried"], facts["left_out"]) == (True, 10, 0, [])
    assert len(facts["hashes"]["trace"]) == 64
    again = run("freeze", whole)
    assert again.exit_code == 0 and "frozen already" in again.stdout
    assert "all files against the manifest" in run("verify", whole).stdout
    (whole / "README.md").chmod(0o644)
    (whole / "README.md").write_text("changed")
    changed = run("verify", whole, "--json")
    assert changed.exit_code == 1
    problems = json.loads(changed.stdout)["problems"]
    assert [Path(problem["file"]).name for problem in problems] == ["README.md"]


@pytest.mark.parametrize("licence", ["", "x" * 600])
def test_a_licence_that_no_manifest_can_tell_is_refused_first(dataset: Path, licence: str) -> None:
    before = scan(dataset)
    done = run("freeze", dataset, "--licence", licence)
    told = " ".join(done.stderr.split())
    assert done.exit_code == 2 and "--licence" in told and "character" in told and "SPDX" in told
    assert "pydantic" not in told and scan(dataset) == before


def test_a_repeated_repair_tells_where_it_keeps_what_it_replaces(dataset: Path) -> None:
    out = dataset.parent / "mended"
    first = run("repair", dataset, "--out", out)
    assert first.exit_code == 0 and "damaged" not in first.stderr
    recording = out / "episodes" / "000000.mcap"
    recording.write_bytes(recording.read_bytes()[:-100])
    again = run("repair", dataset, "--out", out)
    assert again.exit_code == 0 and f"is in {out / 'damaged'}" in again.stderr
    assert run("verify", out).exit_code == 0


def test_what_files_and_settings_are_called_begins_no_line(dataset: Path) -> None:
    (dataset / "episodes" / "x\nerror: it is sound").write_text("")
    assert "\nerror: it is sound" not in run("verify", dataset).stderr
    other = dataset.parent / "other"
    shutil.copytree(dataset, other)
    told = json.loads((other / "dataset.json").read_text())
    told["generator"]["config"]["x\nA and B are equal\nx"] = 1
    (other / "dataset.json").write_text(json.dumps(told))
    found = run("diff", dataset, other)
    assert found.exit_code == 1 and "A and B are equal" in found.stdout and "\nA and B" not in found.stdout


def test_what_recordings_are_called_begins_no_line_either(tmp_path: Path) -> None:
    write_camera_folder(tmp_path / "boards" / "x\nall is sound", make_episode(0))
    told = run("import", tmp_path / "boards", "--dry-run").stdout
    assert "all is sound: 7 frames" in told and "\nall is sound" not in told


def test_diff_exits_with_1_where_something_differs(dataset: Path) -> None:
    same = run("diff", dataset, dataset, "--json")
    assert same.exit_code == 0 and json.loads(same.stdout)["equal"] is True
    other = make_dataset(dataset.with_name("png"), images="png").path
    found = run("diff", dataset, other)
    assert found.exit_code == 1
    assert "setting collect.images: 'jpeg', then 'png'" in found.stdout and "images: 3 (0, 1, 3)" in found.stdout
    told = json.loads(run("diff", dataset, other, "--json").stdout)
    assert told["equal"] is False and told["images"] == [0, 1, 3] and told["episodes"]["0"]["image"]["equal"] is False
    absent = run("diff", dataset, dataset / "absent", "--json")
    assert absent.exit_code == 1 and "no such folder" in json.loads(absent.stdout)["error"]


def test_repair_names_what_it_saved_and_what_not(dataset: Path) -> None:
    file = dataset / "episodes/000001.mcap"
    file.write_bytes(file.read_bytes()[:-50])
    (dataset / "episodes/000003.mcap").write_bytes(b"lost")
    elsewhere = run("repair", dataset, "--out", dataset.with_name("out"), "--json")
    assert elsewhere.exit_code == 0, elsewhere.stderr
    told = json.loads(elsewhere.stdout)
    assert [(v["episode"], v["fate"]) for v in told["damaged"]] == [(1, "whole"), (3, "dropped")]
    write_episode(dataset.with_name("out") / "episodes/000003.mcap", make_episode(3))
    again = run("repair", dataset, "--out", dataset.with_name("out"))
    assert "episode 3: the other recording that is there stays (" in again.stdout and "next:" not in again.stderr
    here = run("repair", dataset)
    assert "episode 1: saved entirely" in here.stdout and "episode 3: could not be kept" in here.stdout
    assert run("verify", dataset).exit_code == 0


def test_freeze_says_how_the_licence_of_own_objects_is_told(dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, whatever = make_dataset(dataset.with_name("whole"), finished=range(4)).path, freezing.freeze
    monkeypatch.setattr(freezing, "freeze", lambda *given: replace(whatever(*given), left_out=("unknown",)))
    assert "licence: unknown; for objects that you made" in run("freeze", whole, "--no-objects").stderr


def test_an_import_tells_whether_states_were_read(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_camera_folder(tmp_path / "boards" / name, make_episode(0), times=True)
    assert "2 episodes, without states" in run("import", tmp_path / "boards", "--out", tmp_path / "none").stderr
    for name, told in (("a", "2 episodes, 1 of them with states"), ("b", "2 episodes, with states")):
        with_keys(tmp_path / "boards" / name)
        (tmp_path / "boards" / name / "states.jsonl").write_text(log_of(state_rows(make_episode(0))[0]))
        assert told in run("import", tmp_path / "boards", "--out", tmp_path / f"with-{name}").stderr


def test_an_import_says_the_next_command_and_is_verified(tmp_path: Path) -> None:
    table, out = write_camera_folder(tmp_path / "table", make_episode(0)), tmp_path / "board"
    assert "nothing was written; --out DATASET" in run("import", table, "--dry-run").stderr
    assert f"next: busybot eval reason {out}; busybot view {out}" in run("import", table, "--out", out).stderr
    verified = run("verify", out).stdout
    assert "imported, so without models of objects: nothing is wrong" in verified and "not found" not in verified
    for name in ("objects.csv", "relations.csv"):
        (table / name).unlink()
    told = run("import", table, "--out", tmp_path / "other").stderr
    assert f"busybot annotate {tmp_path / 'other'}" in told and "eval reason" not in told


def test_options_about_times_are_refused_where_there_are_none(tmp_path: Path) -> None:
    bare = write_camera_folder(tmp_path / "bare", make_episode(0))
    for option, value in (("--fps", 30), ("--shift", 99)):
        refused = run("import", bare, "--dry-run", option, value)
        assert refused.exit_code == 2 and f"{option} is for" in " ".join(refused.stderr.split()), refused.stderr
    timed = write_camera_folder(tmp_path / "timed", make_episode(0), times=True)
    assert run("import", timed, "--dry-run", "--shift", 0.1).exit_code == 0
    assert "--fps is for" in " ".join(run("import", timed, "--dry-run", "--fps", 30).stderr.split())
    (bare / "board.mp4").touch()
    read = run("import", bare, "--dry-run", "--fps", 30).stderr
    assert "--fps is for" not in " ".join(read.split()), "what is wrong with the video is told where it is read"
