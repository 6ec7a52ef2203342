"""What the README says works: its commands and its code are run as they stand."""

import json
import os
import re
import shlex
import subprocess
import sys
from itertools import product
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
SPLITS = ("train", "novel-config", "novel-object")
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, env=dict(os.environ))
    assert done.returncode == 0, f"{shlex.join(command)}\n{done.stdout}\n{done.stderr}"


@pytest.mark.long
def test_commands_and_code_run(tmp_path: Path) -> None:
    commands = [line for block in blocks("sh") for line in block.splitlines()]
    assert len(commands) == 17
    for command in commands:
        name, *arguments = shlex.split(command)
        assert name == "busybot"
        run([sys.executable, "-m", "busybot", *arguments], tmp_path)
    assert (tmp_path / "out/view.png").stat().st_size > 50_000
    code = blocks("python")
    assert len(code) == 2
    for block in code:
        run([sys.executable, "-c", block], tmp_path)


@pytest.mark.long
def test_commands_for_real_objects_run(tmp_path: Path, partnet: Path) -> None:
    commands = re.findall(r"^    (busybot .*)$", README, re.MULTILINE)
    assert len(commands) == 3
    for command in commands:
        arguments = shlex.split(command.replace("DIR", shlex.quote(str(partnet))))[1:]
        run([sys.executable, "-m", "busybot", *arguments], tmp_path)


def test_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / target).exists(), target


def test_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"(?:`|^    )make ([a-z-]+)", README, re.MULTILINE)
    assert {"demo", "test", "test-all"} <= set(targets)
    for target in targets:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


def test_the_overview_is_that_of_the_tables() -> None:
    from benchmarks.overview import page

    assert page(README, ROOT / "benchmarks" / "results") == README, "python -m benchmarks.overview"


def test_numbers_are_those_of_the_result_files() -> None:
    """What the README says in numbers stands in the committed results."""

    def load(name: str) -> dict[str, Any]:
        return json.loads((ROOT / "benchmarks/results" / name).read_text(encoding="utf-8"))

    rows = load("splits.json")["rows"]
    assert {(row["split"], row["policy"]) for row in rows} == set(product(SPLITS, ("scripted", "random")))
    scripted = [row for row in rows if row["policy"] == "scripted"]
    assert sum(row["boards"] for row in scripted) == 120
    assert all(row["verified"] and row["edge_p"] == row["edge_r"] == 1 for row in scripted)
    chance = [row for row in rows if row["policy"] == "random"]
    assert all(row["edge_p"] == 1 and row["edge_r"] == row["edge_r_bound"] for row in chance)
    found = sorted(100 * row["edge_r"] for row in chance)
    assert f"{found[0]:.1f} to {found[-1]:.1f} %" in README
    cost = load("collection.json")
    assert f"costs {cost['ratio_to_minimal_frame']:.2f} of one frame" in README
    assert f"and {cost['ratio_to_minimal_frame_without_shadows']:.2f} of one without shadows" in README
    soak = load("memory.json")
    assert soak["memory"][-1]["boards"] == 2000 and soak["more_open_files_over_second_half"] == 0
    assert f"grows by {soak['growth_mb_over_second_half']} MB over the last 1000 of 2000" in README
    hostile = load("hostile.json")
    assert hostile["cases"] == 500 and not any(kind["findings"] for kind in hostile["kinds"].values())
