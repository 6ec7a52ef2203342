"""The template package is installed beside busybot, and each of its parts is used by its name."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "extending" / "template.md").read_text(encoding="utf-8")
SEEN = ["--set", "render.width=160", "--set", "render.height=120", "--workers", "1"]
SMALL = {
    "collect boards": SEEN,
    "features boards": ["--workers", "1"],
    "eval reason": ["--workers", "1"],
    "eval plan": SEEN,
}


@pytest.mark.long
def test_what_the_page_says(tmp_path: Path) -> None:
    package, site = tmp_path / "template", tmp_path / "site"
    shutil.copytree(ROOT / "docs" / "extending" / "template", package)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])}

    def run(*arguments: str, module: str = "busybot") -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", module, *arguments]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)

    offline = ("--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check")
    done = run("install", "-q", *offline, "--target", str(site), str(package), module="pip")
    assert done.returncode == 0, done.stderr
    tested = run("-q", "-p", "no:cacheprovider", str(package / "tests"), module="pytest")
    assert tested.returncode == 0 and "3 passed" in tested.stdout, tested.stdout

    told = {}
    for command in re.findall(r"^    busybot (.*)$", PAGE, re.MULTILINE):
        words = command.split()
        done = run(*words, *SMALL.get(" ".join(words[:2]), ()), "--json")
        assert done.returncode == 0, f"{command}: {done.stderr}"
        told[" ".join(words[:2])] = json.loads(done.stdout)
    lines = (tmp_path / "boards" / "boards" / "boards-00000.jsonl").read_text().splitlines()
    boards = [json.loads(line) for line in lines]
    assert {relation["kind"] for board in boards for relation in board["relations"]} - {"rest"} == {"majority"}
    assert all("Switch/plank" in [placed["key"] for placed in board["objects"]] for board in boards)
    assert told["features boards"]["encoder"] == told["eval reason"]["encoder"] == "meancolour"
    assert set(told["eval plan"]["agents"]) == {"repeater", "noop"}

    environment["PYTHONPATH"] = str(ROOT)  # without the package
    for words in ("features boards --encoder meancolour", "eval plan boards --agents repeater", "assets check levers"):
        refused = run(*words.split())
        assert refused.returncode in (1, 2) and "Traceback" not in refused.stderr, refused.stderr
        assert re.search("meancolour|repeater|levers", refused.stderr)
