"""The commands of docs/guides/own-recordings.md, run one after the other as they stand there."""

import http.client
import re
import shlex
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from busybot.episodes.mcap.reader import read_episode
from tests.cli.commands import busybot
from tests.datasets.camera_folders import write_camera_folder
from tests.datasets.test_checkerboard import pictures

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = re.findall(r"^    (busybot .*)$", (ROOT / "docs/guides/own-recordings.md").read_text(), re.MULTILINE)


def annotate(folder: Path, words: list[str]) -> None:
    """Open the page, and end it as its button does."""
    with subprocess.Popen(
        [sys.executable, "-m", "busybot", *words], cwd=folder, stdout=subprocess.PIPE, text=True
    ) as run:
        assert run.stdout is not None
        address = urlsplit(run.stdout.readline().strip())
        connection = http.client.HTTPConnection(str(address.hostname), address.port, timeout=30)
        connection.request("POST", "/api/done", b"{}", {"Authorization": f"Bearer {address.fragment}"})
        assert connection.getresponse().status == 200
        assert run.wait(30) == 0


@pytest.mark.long
def test_every_command_of_the_page_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.chdir(tmp_path)
    assert busybot("generate", "twin", "--world", "real-board", "--boards", 1).returncode == 0
    assert busybot("collect", "twin", "--policy", "scripted", "--steps", 20).returncode == 0
    episode = read_episode(tmp_path / "twin" / "episodes" / "000000.mcap")
    write_camera_folder(tmp_path / "table", episode, png=False, relations=False)
    pictures(tmp_path / "checkerboard")
    assert len(COMMANDS) > 8
    for command in COMMANDS:
        words = shlex.split(command)[1:]
        if words[0] == "annotate":
            annotate(tmp_path, words)
            continue
        done = busybot(*words)
        assert done.returncode == 0, done.stderr
    for name in ("graphs", "graphs-event"):
        told = (tmp_path / name / "000000.txt").read_text()
        assert told.count(" -> ") == 3
    assert (tmp_path / "beliefs.png").stat().st_size > 10_000 and (tmp_path / "board" / "manifest.json").exists()
