"""`make reproduce PROFILE=smoke`: everything runs, nothing unchanged runs again, an interrupted stage goes on."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DVC = ROOT / ".tools" / "dvc" / "bin" / "dvc"
PARTS = ("busybot", "pipelines", "dvc.yaml", "params.yaml", ".dvcignore", ".dvc/config")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    if not DVC.exists():
        pytest.skip("DVC is not installed: `make dvc` does it")
    for part in PARTS:
        source, target = ROOT / part, tmp_path / part
        target.parent.mkdir(parents=True, exist_ok=True)
        copy = shutil.copytree if source.is_dir() else shutil.copy
        copy(source, target, **({"ignore": shutil.ignore_patterns("__pycache__")} if source.is_dir() else {}))
    return tmp_path


def begin(project: Path, *words: str) -> subprocess.Popen[str]:
    environment = dict(os.environ, PYTHONPATH=str(project), PATH=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    return subprocess.Popen(
        [DVC, "repro", *words],
        cwd=project,
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )


def repro(project: Path, *words: str) -> str:
    process = begin(project, *words)
    said, _ = process.communicate(timeout=3600)
    assert process.returncode == 0, said
    return said


def recorded(project: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in (project / "runs").rglob("rounds/00/episodes/*.mcap")}


def kill_after_episodes(project: Path, count: int) -> dict[Path, int]:
    """Begin, and kill everything at once when so many episodes of the first round are there."""
    process = begin(project)
    deadline = time.monotonic() + 600
    while len(found := recorded(project)) < count:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.2)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return found


def walk(project: Path, elsewhere: Path, remote: Path) -> None:
    """The way from a run to a training from pulled files, by the commands of the docs; all but the run itself."""
    page = (ROOT / "docs" / "guides" / "reproduce.md").read_text(encoding="utf-8")
    here, there = re.findall(r"(?:^    .+\n)+", page.split("## From a run to data")[1].split("\n## ")[0], re.MULTILINE)
    path = f"{DVC.parent}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    known = {f"GIT_{who}_{what}": "a@b.org" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
    environment = dict(os.environ, PYTHONPATH=str(project), PATH=path, **known)

    def run(commands: list[str], folder: Path) -> None:
        for command in commands:
            words = shlex.split(command.replace("/mnt/shared", shlex.quote(str(remote))))
            done = subprocess.run(words, cwd=folder, env=environment, text=True, capture_output=True, timeout=600)
            assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"

    (project / "datasets").mkdir()
    run(["git init", f"git add {' '.join(PARTS)}", "git commit -m begin"], project)
    first, *rest = here.split("\n    ")
    assert first.strip() == "make reproduce PROFILE=smoke"  # which is what `repro` ran
    run([line.strip() for line in rest], project)
    run([f"git clone {project} {elsewhere}"], project)
    *pulled, train = (line.strip() for line in there.splitlines())
    run([*pulled, f"{train} --set iterations=40"], elsewhere)
    assert (elsewhere / "trained" / "model" / "weights.safetensors").is_file()
    assert json.loads((elsewhere / "trained" / "model" / "model.json").read_text())


@pytest.mark.long
def test_it_goes_on_after_a_kill_and_runs_nothing_twice(
    project: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    before = kill_after_episodes(project, 2)
    said = repro(project)
    assert "Running stage 'interact'" in said and "Running stage 'summary'" in said
    after = recorded(project)
    assert len(after) == 12 and {path: after[path] for path in before} == before, "recorded episodes were kept"
    metrics = json.loads((project / "runs/smoke/metrics.json").read_text())
    assert set(metrics["interact"]) == {"novel-config", "novel-object"}
    assert set(metrics["relations"]) == {"validation", "novel-config", "novel-object"}
    assert metrics["relations"]["validation"]["boards"] == 1
    assert metrics["plan"]["novel-object-one-to-many"]["tasks"] == 1 == len(metrics["plan"])
    curves = (project / "runs/smoke/curves.tsv").read_text().splitlines()
    assert curves[0] == "network\titeration\tloss" and len(curves) > 4

    report = (project / "runs/smoke/report/report.md").read_text()
    rows = {line.split(" | ")[0].strip("| "): line for line in report.splitlines() if line.startswith("| ")}
    measured = ("**ours**, free, seed 0", "**`event`**", "counting", "**search over learned effects**", "`interact`")
    assert all(row in rows for row in measured) and "Not finished" not in report
    assert "missing" not in rows["counting"] and "missing" in rows["behaviour cloning"]
    assert (project / "runs/smoke/report/report.html").stat().st_size > 100_000
    assert {path.name for path in (project / "runs/smoke/report/figures").iterdir()} >= {
        "table1.png", "table2.png", "table3.png", "affordance.png", "refinement.png",
    }  # fmt: skip

    again = repro(project)
    assert "Running stage" not in again and "up to date" in again

    values = project / "params.yaml"
    former = values.read_text()
    values.write_text(former.replace("images: 23", "images: 20"))
    changed = repro(project, "--dry")
    assert changed.count("Running stage 'relations@") == changed.count("Running stage 'baselines@") == 3
    for untouched in ("interact", "judge@novel-config", "data@train", "features@train", "reason"):
        assert f"Running stage '{untouched}'" not in changed
    one = "baselines@novel-config-count"
    assert repro(project, one).count("Running stage") == 1
    changed = repro(project, "--dry")
    assert f"Running stage '{one}'" not in changed
    assert "Running stage 'summary'" in changed and "Running stage 'report'" in changed
    values.write_text(former)

    others = tmp_path_factory.mktemp("others")
    walk(project, others / "clone", others / "remote")
