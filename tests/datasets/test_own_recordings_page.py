"""The commands of docs/guides/own-recordings.md, run one after the other as they stand there."""

import http.client
import json
import re
import runpy
import shlex
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar
from urllib.parse import urlsplit

import pytest

from busybot.boards.real_board import WIRINGS
from busybot.datasets.importing.states import read_states
from busybot.episodes.mcap.reader import read_episode
from tests.cli.commands import busybot
from tests.datasets.camera_folders import write_camera_folder
from tests.datasets.test_checkerboard import pictures

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = re.findall(r"^    (busybot .*)$", (ROOT / "docs/guides/own-recordings.md").read_text(), re.MULTILINE)


class Pins:
    """Stand-in for MicroPython's pins: what they are told to read, and what was written to them."""

    IN, OUT, PULL_UP = 0, 1, 2
    read: ClassVar[dict[int, list[int]]] = {}
    written: ClassVar[dict[int, int]] = {}

    def __init__(self, number: int, *how: int):
        self.number, self.how = number, how

    def value(self, new: int | None = None) -> int | None:
        if new is None:
            assert self.how == (self.IN, self.PULL_UP)
            return self.read[self.number].pop(0)
        assert self.how == (self.OUT,)
        self.written[self.number] = new
        return None


@pytest.mark.parametrize("wiring", range(6))
def test_the_microcontroller_shows_and_logs_what_its_wiring_says(
    wiring: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "machine", SimpleNamespace(Pin=Pins))
    told = runpy.run_path(str(ROOT / "docs/guides/board/main.py"))
    assert told["WIRINGS"] == WIRINGS
    closed = [(0, 0, 0), (0, 0, 0), (1, 0, 0), (1, 0, 1)]
    for place, number in enumerate(told["SWITCHES"]):
        monkeypatch.setitem(Pins.read, number, [1 - state[place] for state in closed])
    told["run"].__globals__["WIRING"] = wiring
    told["run"](len(closed))
    assert [Pins.written[number] for number in told["LEDS"]] == [closed[-1][switch] for switch in WIRINGS[wiring]]
    (tmp_path / "states.jsonl").write_text(capsys.readouterr().out)
    at = [json.loads(line)["ts"] for line in (tmp_path / "states.jsonl").read_text().splitlines()]
    assert len(at) == 2 * len(dict.fromkeys(closed)) and abs(at[0] - time.time()) < 60
    keys = [f"{device}.{number}" for device in ("switches", "leds") for number in range(3)]
    states = read_states(tmp_path, None, keys, [at[0], at[-1]])
    assert states is not None
    assert states[:, :3].tolist() == [[0, 0, 0], [1, 0, 1]]
    assert states[:, 3:].tolist() == [
        [state[switch] for switch in WIRINGS[wiring]] for state in (closed[0], closed[-1])
    ]


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
