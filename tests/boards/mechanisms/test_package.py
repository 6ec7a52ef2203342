"""The page about mechanisms does what it says: its package is installed, and every command knows its world."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "extending" / "mechanism.md").read_text(encoding="utf-8")
FILES = {"busybot_in_order.py": "python", "test_in_order.py": "py", "pyproject.toml": "toml"}


def block(language: str) -> str:
    """The page's first block in a language."""
    found = re.search(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None, language
    return found[1]


@pytest.mark.long
def test_a_package_brings_a_mechanism_and_its_world(tmp_path: Path) -> None:
    package, site = tmp_path / "package", tmp_path / "site"
    package.mkdir()
    for name, language in FILES.items():
        assert f"`{name}`" in PAGE
        (package / name).write_text(block(language), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])}

    def run(*arguments: str, module: str = "busybot") -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", module, *arguments]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)

    unknown = run("generate", "out", "--world", "in-order")
    assert unknown.returncode == 2 and "no world 'in-order'" in unknown.stderr
    offline = ("--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check")
    done = run("install", "-q", *offline, "--target", str(site), str(package), module="pip")
    assert done.returncode == 0, done.stderr
    tested = run("-q", "-p", "no:cacheprovider", str(package / "test_in_order.py"), module="pytest")
    assert tested.returncode == 0 and "1 passed" in tested.stdout, tested.stdout

    small = ("--set", "render.width=160", "--set", "render.height=120", "--workers", "1")
    commands = re.findall(r"^    busybot (.*)$", PAGE, re.MULTILINE)
    assert [command.split()[0] for command in commands] == ["generate", "collect", "replay"]
    for command in commands:
        words = command.split()
        done = run(*words, *(small if words[0] == "collect" else ()), "--json")
        assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["ok"] and len(json.loads(done.stdout)["steps"]) == 9
    lines = (tmp_path / "out" / "boards" / "boards-00000.jsonl").read_text().splitlines()
    kinds = {relation["kind"] for line in lines for relation in json.loads(line)["relations"]}
    assert len(lines) == 2 and kinds - {"rest"} == {"in-order"}

    environment["PYTHONPATH"] = str(ROOT)  # without the package: boards stay as they are, and are refused by name
    assert json.loads(run("dataset", "info", "out", "--json").stdout)["boards"] == 2
    refused = run("replay", "out/episodes/000000.mcap")
    assert refused.returncode == 1 and "unknown kind 'in-order'" in refused.stderr and "install" in refused.stderr
