"""What guides say works: their commands run one after the other, in one folder, as somebody would type them."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
GUIDES = ROOT / "docs" / "guides"
BEFORE = {
    "DATASET": ("generate DATASET --world gates", "collect DATASET --policy scripted"),
    "TRAIN": ("generate TRAIN", "collect TRAIN"),
}
"""Makes what a guide has already."""
BOARDS = 1
"""What takes several is tested where it is: here commands have to run as they are typed."""
LEFT_OUT = (
    r" DIR\b|/mnt/|frozen/",  # real objects, and a remote: tests/pipelines walks to that and back
    r"^train |bc=bc",  # minutes
    r"^view (?!.*--(figure|screenshot))",  # opens a window
    r"benchmarks/results",  # is told of one place alone
)


def commands(guide: str) -> list[list[str]]:
    """The words of a guide's commands, of a few boards."""
    lines = re.findall(r"^    busybot (.*)$", (GUIDES / f"{guide}.md").read_text(encoding="utf-8"), re.MULTILINE)
    lines = [line for line in lines if not any(re.search(pattern, line) for pattern in LEFT_OUT)]
    there = [line for name, makes in BEFORE.items() if any(name in each for each in lines) for line in makes]
    return [_of_few(shlex.split(line)) for line in (*there, *lines)]


def _of_few(words: list[str]) -> list[str]:
    known = {"--boards": str(BOARDS), "--episode": str(BOARDS - 1)}
    words = [known.get(before, word) for before, word in zip(("", *words), words, strict=False)]
    words = [re.sub(r"(?<=episodes/)\d{6}", f"{BOARDS - 1:06d}", word) for word in words]
    return words if words[0] != "generate" or "--boards" in words else [*words, "--boards", str(BOARDS)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("guide", "made"),
    [
        ("worlds", ["results/planned/result.json", "report/report.html"]),
        ("reason", ["curve.png", "beliefs.png", "mechanisms.png"]),
        ("plan", ["sequence.png"]),
        ("share-a-dataset", ["back/boards", "tables/graph.parquet"]),
        ("tasks", ["tasks/boards"]),
        ("scenes", ["stove/boards"]),
        ("../extending/compare", ["judged/mine.json", "judged/planned/result.json", "report/report.html"]),
    ],
)
def test_commands_of_a_guide_run(guide: str, made: list[str], tmp_path: Path) -> None:
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    for words in commands(guide):
        done = subprocess.run(
            [sys.executable, "-m", "busybot", *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=600,
            env=dict(os.environ),
        )
        assert done.returncode == 0, f"{shlex.join(words)}\n{done.stdout}\n{done.stderr}"
    assert [name for name in made if not (tmp_path / name).exists()] == []
