"""The viewer listens on this machine alone and leaves nothing behind, however it ends."""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

import cv2
import psutil
import pytest

from busybot.common.errors import BusybotError
from busybot.view import viewer_process as module
from busybot.view.rerun.recording import save_rrd
from busybot.view.viewer import inferences, picture_episode
from busybot.view.viewer_process import save_screenshot, serve_web, show_window, viewer_process
from tests.episodes.synthetic import make_episode

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def stubborn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A viewer that ignores SIGTERM and has a child of its own; it writes both process ids to a file."""
    program = tmp_path / "viewer"
    program.write_text("#!/bin/sh\ntrap '' TERM\nsleep 600 &\necho $$ $! > \"$2.pids\"\nwait\nsleep 600\n")
    program.chmod(0o755)
    monkeypatch.setattr(module, "viewer_binary", lambda: program)
    monkeypatch.setattr(module, "STOP_SECONDS", 0.3)
    return program


def pids(file: Path, seconds: float = 120.0) -> list[int]:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        with contextlib.suppress(FileNotFoundError, ValueError):
            found = [int(x) for x in file.read_text().split()]
            if len(found) == 2:
                return found
        time.sleep(0.05)
    raise AssertionError(f"{file} was not written")


def gone(process_ids: list[int], seconds: float = 60.0) -> bool:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        alive = [p for p in process_ids if psutil.pid_exists(p) and psutil.Process(p).status() != psutil.STATUS_ZOMBIE]
        if not alive:
            return True
        time.sleep(0.05)
    return False


def test_the_whole_process_group_ends_with_the_block(
    stubborn: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(KeyboardInterrupt), viewer_process([], tmp_path):
        started = pids(tmp_path / "127.0.0.1.pids")
        raise KeyboardInterrupt
    assert gone(started)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends a process with its parent")
def test_the_viewer_dies_with_a_parent_that_is_killed(stubborn: Path, tmp_path: Path) -> None:
    script = (
        "import sys, time\nfrom pathlib import Path\nfrom busybot.view import viewer_process as process\n"
        f"process.viewer_binary = lambda: Path({str(stubborn)!r})\n"
        f"with process.viewer_process([], Path({str(tmp_path)!r})):\n    time.sleep(600)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    parent = subprocess.Popen([sys.executable, "-c", script], cwd=tmp_path, env=environment)
    try:
        viewer, grandchild = pids(tmp_path / "127.0.0.1.pids")
        parent.kill()
        parent.wait()
        assert gone([viewer])
    finally:
        parent.kill()
        with contextlib.suppress(ProcessLookupError):
            os.kill(grandchild, 9)


def test_usage_statistics_are_off_and_settings_are_ours(tmp_path: Path) -> None:
    environment = module.private_environment(tmp_path)
    asked = [str(module.viewer_binary()), "analytics", "config"]
    said = subprocess.run(asked, env=environment, capture_output=True, text=True, timeout=60, check=True).stdout
    assert '"analytics_enabled": false' in said
    assert str(tmp_path) in said


def test_the_web_viewer_listens_on_the_loopback_interface_until_ctrl_c(tmp_path: Path) -> None:
    save_rrd(tmp_path / "e.rrd", make_episode(steps=1))
    addresses: list[str] = []

    def press_ctrl_c(url: str) -> None:
        with urllib.request.urlopen(url.split("?")[0], timeout=20) as answer:
            assert answer.status == 200
        for child in psutil.Process().children(recursive=True):
            addresses.extend(c.laddr.ip for c in child.net_connections("inet") if c.status == psutil.CONN_LISTEN)
        raise KeyboardInterrupt

    before = {child.pid for child in psutil.Process().children(recursive=True)}
    serve_web(tmp_path / "e.rrd", press_ctrl_c)
    assert len(addresses) >= 2 and set(addresses) == {"127.0.0.1"}
    assert {child.pid for child in psutil.Process().children(recursive=True)} <= before


def test_without_a_display_the_window_is_refused_with_other_ways(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(module, "has_display", lambda: False)
    with pytest.raises(BusybotError, match=r"--web .* --save .* --screenshot"):
        show_window(tmp_path / "e.rrd")


def test_a_viewer_that_breaks_is_reported_with_its_last_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "viewer"
    program.write_text("#!/bin/sh\necho 'no graphics adapter was found' >&2\nexit 3\n")
    program.chmod(0o755)
    monkeypatch.setattr(module, "viewer_binary", lambda: program)
    with pytest.raises(BusybotError, match=r"exit code 3\n.*no graphics adapter was found\n.*doctor"):
        save_screenshot(tmp_path / "e.rrd", tmp_path / "p.png", 0)
    assert not (tmp_path / "p.png").exists()


def test_a_viewer_that_never_answers_is_given_up(
    stubborn: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "START_SECONDS", 0.5)
    with pytest.raises(BusybotError, match="did not start within"):
        save_screenshot(tmp_path / "e.rrd", tmp_path / "p.png", 0)
    assert gone(pids(tmp_path / "127.0.0.1.pids"))


@pytest.mark.long
def test_a_screenshot_shows_the_step_that_was_asked_for(tmp_path: Path) -> None:
    episode = make_episode(steps=3)
    for step in (0, 1):
        picture_episode(episode, inferences(episode), tmp_path / f"{step}.png", step)
    start, later = (cv2.imread(str(tmp_path / f"{step}.png")) for step in (0, 1))
    assert start.shape == later.shape == (900, 1600, 3)
    camera = slice(40, 540), slice(0, 520)
    assert (start[camera] != later[camera]).any(-1).mean() > 0.02
    assert len({tuple(color) for color in later[camera].reshape(-1, 3)}) > 50


@pytest.mark.long
def test_a_screenshot_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    monkeypatch.setattr(tempfile, "tempdir", None)
    picture_episode(make_episode(steps=1), [], tmp_path / "picture.png")
    assert (tmp_path / "picture.png").exists() and not list((tmp_path / "temporary").iterdir())
