"""What the README says works: its commands and its code are run as they stand, on 4 boards where it makes 20."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def few(line: str) -> list[str]:
    """The words of a command, of few boards."""
    return shlex.split(line.replace("--boards 20", "--boards 4"))


def run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, env=dict(os.environ))
    assert done.returncode == 0, f"{shlex.join(command)}\n{done.stdout}\n{done.stderr}"


@pytest.mark.long
def test_commands_and_code_run(tmp_path: Path) -> None:
    commands = [line for block in blocks("sh") for line in block.splitlines()]
    assert len(commands) == 17
    for command in commands:
        name, *arguments = few(command)
        assert name == "busybot"
        run([sys.executable, "-m", "busybot", *arguments], tmp_path)
    assert (tmp_path / "out/view.png").stat().st_size > 50_000
    code = blocks("python")
    assert len(code) == 1
    for block in code:
        run([sys.executable, "-c", block], tmp_path)


@pytest.mark.long
def test_commands_for_real_objects_run(tmp_path: Path, partnet: Path) -> None:
    commands = re.findall(r"^    (busybot .*)$", README, re.MULTILINE)
    assert len(commands) == 3
    for command in commands:
        arguments = few(command.replace("DIR", shlex.quote(str(partnet))))[1:]
        run([sys.executable, "-m", "busybot", *arguments], tmp_path)


def test_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"(?:`|^    )make ([a-z-]+)", README, re.MULTILINE)
    assert {"demo", "test", "test-all"} <= set(targets)
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


def test_it_is_short() -> None:
    assert len(README.splitlines()) < 150
