"""`busybot assets`: what people and scripts see."""

import json
import os
import re
import shutil
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from busybot.cli.common import check_file
from busybot.cli.main import app
from busybot.common.errors import BusybotError
from busybot.datasets.dataset import Dataset
from busybot.objects.importing.auto_annotation import FACING, STANDING
from busybot.objects.library import Library
from busybot.objects.partnet.annotation import CauseEntry, EffectEntry, ObjectAnnotation
from tests.conftest import ROOT
from tests.objects.raw_objects import DRAWER, GROUND, LEAF, ROCKER, STICK, make_raw


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
    assert code == 1 and "hint:" in err


def test_a_sheet_that_cannot_be_written_is_refused_before_it_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("busybot.view.figures.contact_sheet.sheet", lambda *_: pytest.fail("it was drawn"))
    (tmp_path / "file").write_text("")
    code, _, err = run("sheet", "--out", str(tmp_path / "file" / "deeper" / "sheet.png"))
    assert code == 1 and "file is no folder" in err and "another place for --out" in err
    code, _, err = run("sheet", "--out", os.devnull)
    assert code == 1 and "is a device or a pipe" in err and Path(os.devnull).is_char_device()


@pytest.mark.skipif(not os.access("/dev/shm", os.W_OK), reason="no folder /dev/shm to write into")
def test_a_file_may_lie_in_memory_and_not_beside_devices() -> None:
    check_file("--out", Path("/dev/shm/busybot/sheet.png"), "sheet.png")
    for place in ("/dev/stdout", "/dev/fd/1", "/dev/sheet.png"):
        with pytest.raises(BusybotError, match="is a device or a pipe"):
            check_file("--out", Path(place), "sheet.png")


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
    assert {line.split(":")[0] for line in lines} == {"Door/hatch-01", "Lamp/star-01"}
    for field in ("Category", "Scale", "Orientation"):
        assert any(line.startswith("Door/hatch-01") and f": {field}:" in line for line in lines), "every fault is told"
    assert all("hint" in line for line in lines)
    code, out, _ = run("check", str(folder), "--json")
    report = json.loads(out)
    assert code == 1 and not report["ok"]
    missing = [row for row in report["problems"] if "no such folder" in row["problem"]]
    assert len(missing) > 50, "ids that the split file lists without a folder are named"


def test_check_tells_all_that_is_wrong_with_an_object(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / "bolt-01"
    shutil.copytree(made / "Switch" / "bolt-01", folder)
    meshes = sorted((folder / "textured_objs").glob("*.obj"))
    meshes[0].write_text("v nan 0 0\n")
    meshes[1].write_text("no mesh\n")
    annotation = json.loads((folder / "object_meta_info.json").read_text())
    (folder / "object_meta_info.json").write_text(json.dumps(annotation | {"Scale": -1, "InstanceId": "../x"}))
    code, out, _ = run("check", str(folder), "--json")
    report = json.loads(out)
    problems = [row["problem"] for row in report["problems"]]
    assert code == 1 and report["checked"] == 1 and len(set(problems)) == len(problems) == 4
    for part in ("Scale", "InstanceId", meshes[0].name, meshes[1].name):
        assert any(part in problem for problem in problems), part


def test_check_says_what_is_raw_and_how_to_import_it(tmp_path: Path) -> None:
    raw = make_raw(tmp_path / "raw" / "77", "Switch", ROCKER)
    make_raw(tmp_path / "raw" / "78", "Switch", ROCKER)
    (tmp_path / "raw" / "78" / "mobility.urdf").write_text("<robot")
    for folder in (raw, tmp_path / "raw"):
        code, out, _ = run("check", str(folder), "--json")
        problems = {row["problem"]: row["hint"] for row in json.loads(out)["problems"]}
        assert code == 1
        command = f"busybot assets import {raw} --out LIBRARY"
        assert any("is raw" in what and hint == command for what, hint in problems.items())
    assert any("78/mobility.urdf" in what for what in problems)
    shutil.copytree(raw, tmp_path / "library" / "Switch" / "77")
    code, out, _ = run("check", str(tmp_path / "library"))
    assert code == 1 and "Switch/77:" in out and "busybot assets import" in out


def test_import_review_edit_import(tmp_path: Path) -> None:
    raw, out, review = tmp_path / "raw", tmp_path / "library", tmp_path / "review.yaml"
    make_raw(raw / "77", "Box", ROCKER)
    make_raw(raw / "78", "Bottle")
    code, text, _ = run("import", str(raw), "--review", str(review), "--json")
    objects = {row["name"]: row for row in json.loads(text)["objects"]}
    assert code == 1, "one is refused"
    assert objects["77"]["done"] == "proposed" and objects["77"]["choices"]["scale"] == 0.265
    assert "no joint moves anything" in objects["78"]["problem"] and "78 is refused" in review.read_text()
    assert not out.exists()
    edited = review.read_text().replace("scale: 0.265", "scale: 0.25")
    review.write_text(edited + "  '79': {use: false}\n")
    code, text, err = run("import", str(raw / "77"), "--overrides", str(review), "--out", str(out), "--json")
    assert code == 0 and json.loads(text)["unused"] == ["79"]
    assert json.loads((out / "Switch" / "77" / "object_meta_info.json").read_text())["Scale"] == 0.25
    assert run("check", str(out))[0] == 0
    code, _, err = run("import", str(raw), "--review", str(review))
    assert code == 1 and "hint:" in err and review.read_text().startswith(edited), "a reviewed file is not overwritten"
    assert run("import", str(raw))[0] == run("import", str(raw), "--out", "x", "--split", "test")[0] == 2


def test_an_import_says_the_next_command(tmp_path: Path) -> None:
    raw, out, review = tmp_path / "raw", tmp_path / "library", tmp_path / "review.yaml"
    make_raw(raw / "77", "Box", ROCKER)
    told = run("import", str(raw), "--review", str(review))[2]
    assert f"next: edit {review}; busybot assets import {raw} --overrides {review} --out LIBRARY\n" in told
    for _ in range(2):  # what is there already, unchanged, is there
        assert f"next: busybot assets check {out}; " in run("import", str(raw), "--out", str(out))[2]
    review.write_text(review.read_text().replace("scale: 0.265", "scale: 0.25"))
    code, _, told = run("import", str(raw), "--overrides", str(review), "--out", str(out))
    assert code == 1 and "refused" in told and "next:" not in told, "nothing was imported that could be looked at"


def test_a_doubtful_orientation_is_asked_about_until_it_is_answered(tmp_path: Path) -> None:
    raw, out, review = tmp_path / "raw", tmp_path / "library", tmp_path / "review.yaml"
    make_raw(raw / "77", "Switch", STICK, body=GROUND)
    make_raw(raw / "78", "Switch", ROCKER)
    code, _, err = run("import", str(raw), "--review", str(review), "--out", str(out))
    assert code == 0 and err.count("question: which side faces the camera?") == 1
    assert review.read_text().count("# QUESTION: which side faces the camera?") == 1
    code, text, _ = run("check", str(out))
    assert code == 0 and "Switch/77: question: which side" in text and "nothing is wrong, 1 question" in text
    told = json.loads(run("check", str(out), "--json")[1])
    assert told["ok"] and told["checked"] == 2 and [one["name"] for one in told["questions"]] == ["Switch/77"]
    first, second = review.read_text().split("'78':")
    review.write_text(first.replace(str(list(FACING)), str(list(STANDING))) + "'78':" + second)
    assert run("import", str(raw), "--overrides", str(review), "--out", str(out), "--replace")[0] == 0
    assert json.loads((out / "Switch/77/object_meta_info.json").read_text())["Orientation"] == list(STANDING)
    assert "question" not in run("check", str(out))[1]


@pytest.mark.parametrize("told", [{"overrides": 7}, {"overrides": [], "more": float("nan")}])
def test_what_an_annotation_tells_of_its_import_stops_no_check(tmp_path: Path, told: object) -> None:
    out = tmp_path / "library"
    make_raw(tmp_path / "raw" / "78", "Switch", ROCKER)
    assert run("import", str(tmp_path / "raw"), "--out", str(out))[0] == 0
    file = out / "Switch/78/object_meta_info.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"Import": told}))
    code, text, _ = run("check", str(out))
    assert code == 0 and "1 checked, nothing is wrong" in text


@pytest.mark.long
def test_libraries_are_merged(made: Path, tmp_path: Path) -> None:
    own, out = tmp_path / "own", tmp_path / "both"
    make_raw(tmp_path / "raw" / "77", "Switch", ROCKER)
    assert run("import", str(tmp_path / "raw"), "--out", str(own), "--split", "novel")[0] == 0
    shutil.copytree(made / "Lamp/globe-01", own / "Lamp/globe-01")
    lists = json.loads((own / "data.json").read_text())
    procedural = json.loads((made / "data.json").read_text())["Reason"]["Lamp"]
    weight = {split: procedural[split].count("globe-01") for split in procedural}
    lists["Reason"]["Lamp"] = {split: ["globe-01"] * count for split, count in weight.items()}
    (own / "data.json").write_text(json.dumps(lists))
    code, text, _ = run("merge", str(made), str(own), "--out", str(out), "--json")
    keys = json.loads(text)["objects"]
    assert code == 0 and "Switch/77" in keys and keys.count("Lamp/globe-01") == 1
    assert run("check", str(out))[0] == 0
    both, parts = Library.load(out), [Library.load(made), Library.load(own)]
    assert both.hashes() == dict(sorted((parts[0].hashes() | parts[1].hashes()).items()))
    assert both.splits["novel"] == parts[0].splits["novel"] | parts[1].splits["novel"]
    assert both.splits["train"] == parts[0].splits["train"]
    assert run("merge", str(made), "--out", str(out))[0] == 1, "it is there"
    lists["Reason"]["Lamp"] = {"train": ["globe-01"] * 7, "test": []}
    (own / "data.json").write_text(json.dumps(lists))
    code, _, err = run("merge", str(made), str(own), "--out", str(tmp_path / "other"))
    assert code == 1 and "Lamp/globe-01 has another split or weight" in err
    info = own / "Lamp/globe-01/object_meta_info.json"
    info.write_text(info.read_text().replace('"Scale": 0', '"Scale": 1', 1))
    code, _, err = run("merge", str(made), str(own), "--out", str(tmp_path / "other"))
    assert code == 1 and "Lamp/globe-01 differs in" in err and "hint:" in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["both", "own", "raw"]


def test_every_key_of_an_annotation_is_explained(made: Path) -> None:
    text = (ROOT / "docs/extending/add-an-object.md").read_text()
    keys = [*ObjectAnnotation.model_fields, "Import"]
    keys += [f"Cause.{name}" for name in CauseEntry.model_fields]
    keys += [f"Effect.{name}" for name in EffectEntry.model_fields]
    explained = set(re.findall(r"`([A-Z][A-Za-z_.]+)`", "".join(re.findall(r"^\| (`[^|]+)\|", text, re.MULTILINE))))
    assert explained == set(keys)
    written = json.loads((made / "Switch/rocker-01/object_meta_info.json").read_text())
    assert set(written) <= set(keys)


def test_an_imported_library_gives_boards(made: Path, tmp_path: Path) -> None:
    """Beside procedural objects of the other categories, without further ado."""
    out = tmp_path / "library"
    for key in ("Lamp/globe-01", "Toy/loco-01"):
        shutil.copytree(made / key, out / key)
    lists = {"Lamp": {"train": ["globe-01"]}, "Toy": {"train": ["loco-01"]}}
    (out / "data.json").write_text(json.dumps({"Reason": lists}))
    make_raw(tmp_path / "raw" / "77", "Switch", ROCKER)
    make_raw(tmp_path / "raw" / "78", "StorageFurniture", LEAF, DRAWER)
    assert run("import", str(tmp_path / "raw"), "--out", str(out))[0] == 0
    boards = tmp_path / "boards"
    arguments = ["generate", str(boards), "--assets", str(out), "--boards", "20", "--group-size", "1", "--json"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.stderr
    keys = {placed.key for board in Dataset.open(boards).boards() for placed in board.objects}
    assert {"Switch/77", "Door/78"} <= keys


def test_fetch_without_a_token_says_where_it_belongs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SAPIEN_ACCESS_TOKEN", raising=False)
    code, out, err = run("fetch", "100366", "--out", str(tmp_path / "raw"), "--json")
    assert code == 1 and "SAPIEN_ACCESS_TOKEN" in err and "error" in json.loads(out)
    assert not (tmp_path / "raw").exists()
    help_text = run("fetch", "--help")[1]
    assert "--token" not in help_text


def test_fetch_asks_for_the_token_without_showing_it(tmp_path: Path) -> None:
    token = "typed-secret-token"
    (tmp_path / "sapien").mkdir()
    (tmp_path / "sapien" / "__init__.py").write_text("")
    (tmp_path / "sapien" / "asset.py").write_text(
        "def download_partnet_mobility(model_id, token=None, directory=None):\n"
        f"    if token == {token!r}:\n        raise Exception('Download PartNet-Mobility failed. ' + token)\n"
        "    raise KeyError(token)\n"
    )
    terminal, inside = os.openpty()
    path = os.pathsep.join(filter(None, [str(tmp_path), str(ROOT), os.environ.get("PYTHONPATH")]))
    environment = {name: value for name, value in os.environ.items() if name != "SAPIEN_ACCESS_TOKEN"}
    process = subprocess.Popen(
        [sys.executable, "-m", "busybot", "assets", "fetch", "77", "--out", str(tmp_path / "raw")],
        stdin=inside,
        stdout=inside,
        stderr=inside,
        env=environment | {"PYTHONPATH": path},
        start_new_session=True,
    )
    try:
        deadline = time.monotonic() + 120
        while termios.tcgetattr(terminal)[3] & termios.ECHO and time.monotonic() < deadline:
            time.sleep(0.02)  # what is typed before the echo is off would be shown, and thrown away
        os.write(terminal, f"{token}\n".encode())
        code = process.wait(120)
    finally:
        process.kill()
        os.close(inside)
    shown = os.read(terminal, 10_000)
    os.close(terminal)
    assert code == 1
    assert b"the server refused" in shown and b"hint" in shown, shown
    assert token.encode() not in shown


def test_check_reads_a_single_object(made: Path) -> None:
    assert run("check", str(made / "Switch" / "bolt-01"))[0] == 0


def test_faults_exit_with_1_and_a_hint(made: Path, tmp_path: Path) -> None:
    for arguments in (("list", str(tmp_path / "none")), ("check", str(tmp_path)), ("make", str(made))):
        code, _, err = run(*arguments)
        assert code == 1 and "hint:" in err
    assert run("list", "--nonsense")[0] == 2
