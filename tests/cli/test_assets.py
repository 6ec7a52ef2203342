"""`busybot assets`: what people and scripts see."""

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from busybot.cli.main import app


def run(*arguments: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["assets", *arguments])
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("assets") / "library"
    code, out, _ = run("make", str(folder), "--seed", "3", "--json")
    assert code == 0
    made = json.loads(out)
    assert made["seed"] == 3 and len(made["objects"]) >= 60
    return folder


def test_list_says_what_there_is(made: Path) -> None:
    code, out, _ = run("list", str(made), "--json")
    rows = {row["key"]: row for row in json.loads(out)["objects"]}
    assert code == 0
    assert rows["Switch/fader-01"]["kinds"] == ["multi-direction"] and rows["Switch/fader-01"]["weight"] == 2
    assert rows["Lamp/tulip-01"] | {"sha256": ""} == {
        "key": "Lamp/tulip-01",
        "category": "Lamp",
        "role": "responder",
        "links": [],
        "kinds": ["single-stage", "multi-stage"],
        "split": ["novel"],
        "weight": 1.0,
        "sha256": "",
    }


def test_the_table_has_a_line_for_each_object(made: Path) -> None:
    code, out, _ = run("list", str(made))
    assert code == 0
    assert "Switch/rockers-03" in out and "4 x two-state" in out and "Toy/loco-01" in out


def test_the_sheet_shows_every_object(made: Path, tmp_path: Path) -> None:
    for key in ("Switch/bolt-01", "Lamp/star-01"):
        shutil.copytree(made / key, tmp_path / "library" / key)
    splits = {"Reason": {"Switch": {"train": ["bolt-01"], "test": []}, "Lamp": {"train": [], "test": ["star-01"]}}}
    (tmp_path / "library" / "data.json").write_text(json.dumps(splits))
    picture = tmp_path / "sheet.png"
    code, out, _ = run("sheet", str(tmp_path / "library"), "--out", str(picture), "--cell", "48", "--json")
    assert code == 0 and json.loads(out) == {"sheet": str(picture), "objects": 2}
    assert picture.read_bytes().startswith(b"\x89PNG")
    code, _, err = run("sheet", str(tmp_path / "library"), "--out", str(tmp_path / "sheet.bmp"))
    assert code == 1 and "mend:" in err


def test_real_objects_are_fine(partnet: Path) -> None:
    code, out, _ = run("check", str(partnet))
    assert code == 0 and "58 checked, nothing is wrong" in out


def test_check_names_every_bad_object(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "library"
    for key in ("Switch/bolt-01", "Lamp/star-01", "Door/hatch-01"):
        shutil.copytree(made / key, folder / key)
    shutil.copy(made / "data.json", folder / "data.json")
    (folder / "Lamp/star-01/mobility.urdf").write_text("<robot")
    (folder / "Door/hatch-01/object_meta_info.json").write_text("{}")
    code, out, _ = run("check", str(folder))
    lines = [
        line for line in out.splitlines() if line.startswith(("Lamp/star-01:", "Door/hatch-01:", "Switch/bolt-01:"))
    ]
    assert code == 1
    assert sorted(line.split(":")[0] for line in lines) == ["Door/hatch-01", "Lamp/star-01"]
    assert all("mend" in line for line in lines)
    code, out, _ = run("check", str(folder), "--json")
    report = json.loads(out)
    assert code == 1 and not report["ok"]
    missing = [row for row in report["problems"] if "no such folder" in row["problem"]]
    assert len(missing) > 50, "ids that the split file lists without a folder are named"


def test_check_reads_a_single_object(made: Path) -> None:
    assert run("check", str(made / "Switch" / "bolt-01"))[0] == 0


def test_faults_exit_with_1_and_a_mend(made: Path, tmp_path: Path) -> None:
    for arguments in (("list", str(tmp_path / "none")), ("check", str(tmp_path)), ("make", str(made))):
        code, _, err = run(*arguments)
        assert code == 1 and "mend:" in err
    assert run("list", "--nonsense")[0] == 2
