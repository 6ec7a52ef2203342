"""`busybot demo`: the first thing that a new user runs."""

import json
import re
import subprocess
import sys
from pathlib import Path

import cv2
import pytest

from tests.cli.commands import busybot


@pytest.mark.long
def test_the_demo_leaves_a_report_whose_links_and_commands_work(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    command = [sys.executable, "-m", "busybot", "demo", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().splitlines()[-1] == str(out), "the path is printed last"
    report = (out / "report.md").read_text()
    pictures = re.findall(r"\]\((.*?\.png)\)", report)
    assert len(pictures) == 11
    for picture in pictures:
        image = cv2.imread(str(out / picture))
        assert image is not None and image.std() > 10, picture
    assert "{" not in report and "None" not in report
    assert (out / re.findall(r"`([^`]*\.rrd)`", report)[0]).stat().st_size > 100_000
    for line in re.findall(r"`busybot ([^`]*)`", report):
        if line.startswith("view"):
            continue  # opens a window
        ran = subprocess.run(
            [sys.executable, "-m", "busybot", *line.split()], cwd=out, capture_output=True, timeout=900
        )
        assert ran.returncode == 0, (line, ran.stderr)
    assert "At the end 100.0 % of the responders" in report, "the task is solved"
    told = report.split("What it said:")[1].split("##")[0]
    assert "3. " in told and "everything looks as in the goal" in told
    two = report.split("## It takes two")[1].split("## ")[0]
    assert re.search(r"shows look \d only while .* is moved and .* is", two), "the gate of two switches, in words"
    rows = [line.split(" | ") for line in two.splitlines() if line.startswith("| ") and "|---" not in line]
    assert all(row[-1].rstrip(" |") in ("verdict", "right") for row in rows) and len(rows) > 3, rows
    said, true = (set(re.findall(r"switch \d+ link\\_\d", " ".join(row[k] for row in rows[1:]))) for k in (1, 2))
    assert said and said <= true, "links have the same names in both columns"
    assert "collect more --policy learned" in report
    harder = report.split("## Where counting is not enough")[1].split("## ")[0]
    assert harder.count("\n- **") >= 5 and "mixed.png" in harder, "the mechanisms of a board of `mixed`, in words"
    assert (out / "tables" / "graph.parquet").is_file(), "as tables, too"
    result = json.loads((out / "relations.json").read_text())
    assert result["boards"] == 4 and result["steps"] == 4 * 22
    assert result["edge_p"] > 0.9 and result["edge_r"] > 0.8, "the learned policy moves nearly every link in 22 actions"


def test_a_seed_that_no_dataset_can_have_is_refused_at_once(tmp_path: Path) -> None:
    done = busybot("demo", "--out", tmp_path / "demo", "--seed", str(2**63 - 1))
    assert done.returncode == 1 and "--seed" in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "demo").exists()


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("precious")
    done = busybot("demo", "--out", tmp_path)
    assert done.returncode == 1 and "not an empty folder" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
