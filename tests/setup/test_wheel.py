"""The wheel works in a folder that knows nothing of the repository."""

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.long
def test_the_wheel_works_anywhere(tmp_path: Path) -> None:
    source, site, elsewhere = (tmp_path / name for name in ("source", "site", "elsewhere"))
    shutil.copytree(ROOT / "busybot", source / "busybot", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "datasets/tiny", source / "datasets/tiny")
    for name in ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir"]
    subprocess.run([*build, tmp_path, source], check=True)
    with zipfile.ZipFile(next(tmp_path.glob("*.whl"))) as wheel:
        wheel.extractall(site)
    assert {path.name.partition("-")[0] for path in site.iterdir()} == {"busybot"}
    elsewhere.mkdir()

    def run(*words: str) -> str:
        environment = os.environ | {"PYTHONPATH": str(site)}
        done = subprocess.run(
            [sys.executable, *words], cwd=elsewhere, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, (words, done.stderr)
        return done.stdout

    assert Path(run("-c", "import busybot; print(busybot.__file__)").strip()).is_relative_to(site)
    shipped = json.loads(run("-m", "busybot", "models", "list", "--json"))["models"]
    assert {model["name"] for model in shipped} >= {"procedural", "event", "mechanism"}
    run("-m", "busybot", "models", "verify")
    run("-m", "busybot", "dataset", "tiny")
    told = json.loads(run("-m", "busybot", "dataset", "verify", "datasets/tiny", "--workers", "1", "--json"))
    assert told["ok"] and told["frozen"] and told["episodes"] == 12
    run("-m", "busybot", "generate", "boards", "--boards", "1", "--split", "train")
    run("-m", "busybot", "collect", "boards", "--steps", "2", "--policy", "learned", "--workers", "1")
    assert json.loads(run("-m", "busybot", "dataset", "verify", "boards", "--workers", "1", "--json"))["ok"]
    run("-m", "busybot", "eval", "reason", "boards", "--images", "3", "--workers", "1")
    run("-m", "busybot", "view", "boards", "--figure", "figure.png")
