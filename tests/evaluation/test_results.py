"""Result files: what all of them say, kinds that are read and not guessed, and the committed ones."""

import json
import subprocess
from pathlib import Path

import pytest

from busybot.common.errors import BusybotError
from busybot.evaluation.results import HASHED, KEYS, KINDS, code_digest, commit, read_result, stamp, write_result

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks" / "results"
FILES = sorted(RESULTS.rglob("*.json"))


def git(folder: Path, *arguments: str) -> None:
    who = ("-c", "user.name=x", "-c", "user.email=x@y")
    subprocess.run(["git", "-C", str(folder), *who, *arguments], check=True, capture_output=True)


def test_a_result_is_read_as_it_was_written(tmp_path: Path) -> None:
    hashes = {"models": {"m": {"weights": "ab"}}, "data": {"d": "cd"}}
    told = stamp("kills", command="python x", seed=3, versions={"busybot": "1"}, hashes=hashes) | {
        "results": {"b": 1, "a": 2}
    }
    write_result(tmp_path / "r.json", told)
    assert read_result(tmp_path / "r.json", "kills") == json.loads(json.dumps(told))
    assert tuple(told)[: len(KEYS)] == KEYS and tuple(told["hashes"]) == HASHED and told["hashes"]["tasks"] == {}
    assert list(read_result(tmp_path / "r.json")["results"]) == ["b", "a"], "figures keep their order"
    assert json.loads((tmp_path / "r.json").read_text())["kind"] == "kills" and told["machine"]["cores"] > 0


def test_a_file_without_a_kind_is_refused_with_what_to_do(tmp_path: Path) -> None:
    file = tmp_path / "r.json"
    file.write_text('{"edge_p": 1.0}')
    with pytest.raises(
        BusybotError, match=r"r\.json: it is no result(.|\n)*busybot eval reason(.|\n)*add the key `kind`"
    ):
        read_result(file, "reason")
    file.write_text('{"kind": "table1"}')
    with pytest.raises(BusybotError, match="a result of the kind table1, not table2"):
        read_result(file, "table2")
    file.write_text('{"kind": "other"}')
    with pytest.raises(BusybotError, match="unknown kind 'other'"):
        read_result(file)


def test_versions_of_the_code_are_told_apart(tmp_path: Path) -> None:
    told = set()
    for number, (name, text) in enumerate((("a.py", "1"), ("a.py", "2"), ("b.py", "1"), ("a.vert", "1"))):
        package = tmp_path / str(number)
        (package / "__pycache__").mkdir(parents=True)
        (package / name).write_text(text)
        digest = code_digest(package)
        (package / "__pycache__" / "a.pyc").write_text(name)
        code_digest.cache_clear()
        assert code_digest(package) == digest
        told.add(digest)
    assert len(told) == 4 and stamp("reason")["versions"]["code"] == code_digest() not in told


def test_the_commit_is_told_where_the_source_is_tracked(tmp_path: Path) -> None:
    package = tmp_path / "package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    assert commit(package) is None and commit(tmp_path / "none") is None
    git(tmp_path, "init")
    (tmp_path / "params.yaml").write_text("profile: smoke")
    (tmp_path / "benchmarks" / "results").mkdir(parents=True)
    (tmp_path / "benchmarks" / "results" / "row.json").write_text("[1]")
    assert commit(package) is None, "a repository in which the package is not tracked is somebody else's"
    git(tmp_path, "add", ".")
    assert commit(package) is None, "nothing is committed yet"
    git(tmp_path, "commit", "-m", "first")
    first = commit(package)
    assert first is not None and len(first) == 40 and int(first, 16)
    (tmp_path / "params.yaml").write_text("profile: laptop")
    assert commit(package) == first, "a profile was chosen"
    (tmp_path / "benchmarks" / "results" / "row.json").write_text("[2]")
    assert commit(package) == first, "a command has written a row"
    (package / "__init__.py").write_text("x = 1")
    assert commit(package) == f"{first}-dirty"


def test_without_git_there_is_no_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert stamp("s3")["commit"] is None


def test_every_committed_result_says_what_it_is() -> None:
    assert len(FILES) > 30
    for file in FILES:
        told = read_result(file)
        assert tuple(told)[: len(KEYS)] == KEYS, file
        assert tuple(told["hashes"]) == HASHED and told["kind"] in KINDS, file
        assert all(type(told[key]) in (dict, type(None)) for key in ("machine", "versions")), file


def test_every_command_of_a_kind_is_there() -> None:
    root = RESULTS.parents[1]
    for command in KINDS.values():
        words = command.split()
        if words[:2] == ["python", "-m"]:
            assert (root / f"{words[2].replace('.', '/')}.py").is_file(), command


@pytest.mark.parametrize("file", sorted({*RESULTS.rglob("*.json"), *RESULTS.rglob("*.md")}), ids=lambda path: path.stem)
def test_no_result_names_a_folder_of_the_machine_that_made_it(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert not any(
        f"{before}/{place}/" in text for place in ("tmp", "home", "root", "work") for before in ('"', " ", "=")
    )
