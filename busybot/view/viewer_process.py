"""The viewer's process: in a window, served to a browser on this machine, or without a screen for a picture.

The process listens on this machine alone and never outlives the one that started it.
"""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar
from urllib.parse import quote

import cv2
import numpy as np
from rerun.experimental import ViewerClient

from busybot.common.atomic_io import new_file, write_atomically, write_json
from busybot.common.errors import BusybotError

T = TypeVar("T")
LOOPBACK = "127.0.0.1"
WEB_PORT = 9090
WEB_SECONDS = 30.0
"""The web viewer answers within."""
STOP_SECONDS = 3.0
START_SECONDS = 60.0
"""Compiling the shaders of a software renderer on a busy machine takes that long at worst."""
LOAD_SECONDS = 60.0
SETTLE_SECONDS = 20.0
POLL_SECONDS = 0.25
SIZE = (1600, 900)
"""Of a picture, pixels."""
TITLE_BAR = 36
"""Height of the window's empty title bar, which a headless viewer draws too; pixels."""
HINT = "busybot doctor (it checks the Vulkan driver), or use --save and look at the file elsewhere"
FAULTS = (RuntimeError, ConnectionError, TimeoutError, ValueError)
"""What `ViewerClient` and the waiting here raise."""

# Asks the kernel to end this process with its parent (PR_SET_PDEATHSIG is 1), then becomes the viewer.
_DIE_WITH_PARENT = """
import ctypes, os, signal, sys
parent = int(sys.argv[1])
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)
if os.getppid() == parent:
    os.execv(sys.argv[2], sys.argv[2:])
"""


def viewer_binary() -> Path:
    """Rerun's program itself: the console script would put a process between it and us."""
    package = find_spec("rerun_cli")
    folder = Path(package.origin).parent if package and package.origin else Path()
    for candidate in (folder / "Rerun.app" / "Contents" / "MacOS" / "Rerun", folder / "rerun"):
        if package and candidate.is_file():
            return candidate
    raise BusybotError(
        f"{folder / 'rerun'}: Rerun's viewer is not there",
        "install the package rerun-sdk again; in busybot's own folder: make setup",
    )


def free_port() -> int:
    """A TCP port that is free on the loopback interface now."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


@contextmanager
def viewer_process(arguments: list[str], folder: Path, private: bool = True) -> Iterator[subprocess.Popen[bytes]]:
    """Run the viewer with `arguments`, bound to the loopback interface; its whole process group ends with the block.

    Args:
        folder: a temporary folder for the log and, if `private`, for the viewer's settings.
        private: keep the user's viewer settings out and send no usage statistics.
    """
    command = [str(viewer_binary()), "--bind", LOOPBACK, *arguments]
    # the viewer leaves a folder wherever temporary files go
    environment = (private_environment(folder) if private else dict(os.environ)) | {"TMPDIR": str(folder)}
    with new_file(folder / "viewer.log") as log:
        process = subprocess.Popen(
            [sys.executable, "-I", "-c", _DIE_WITH_PARENT, str(os.getpid()), *command],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            env=environment,
            start_new_session=True,
        )
    try:
        yield process
    finally:
        end_group(process)


def private_environment(folder: Path) -> dict[str, str]:
    """The environment with empty viewer settings and Rerun's usage statistics turned off."""
    config, data = folder / "config", folder / "data"
    settings = {
        "analytics_enabled": False,
        "analytics_id": "none",
        "metadata": {},
        "config_file_path": str(config / "rerun" / "analytics.json"),
        "data_dir_path": str(data / "rerun" / "analytics"),
    }
    write_json(config / "rerun" / "analytics.json", settings, folder)
    kept = {name: value for name, value in os.environ.items() if not name.startswith("RERUN")}
    return kept | {"XDG_CONFIG_HOME": str(config), "XDG_DATA_HOME": str(data)}


def end_group(process: subprocess.Popen[bytes]) -> None:
    """Ask the process group to end, insist after a while, and wait for it."""
    for wanted in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, wanted)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(STOP_SECONDS)
            if wanted is signal.SIGKILL:
                return


def last_words(folder: Path) -> str:
    """The end of the viewer's log, without colours."""
    with contextlib.suppress(OSError):
        text = (folder / "viewer.log").read_text(encoding="utf-8", errors="replace")
        return "\n".join(re.sub(r"\x1b\[[0-9;]*m", "", text).strip().splitlines()[-6:])
    return ""


def has_display() -> bool:
    """Whether a window can open here."""
    return sys.platform in ("darwin", "win32") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def require_display() -> None:
    """Refuse early where no window can open."""
    if not has_display():
        hint = "use --web (in a browser), --save F.rrd (to open elsewhere) or --screenshot F.png"
        raise BusybotError("there is no display for the viewer's window", hint)


def show_window(rrd: Path, step: int | None = None) -> None:
    """Open the native viewer and return when it is closed.

    Raises:
        BusybotError: there is no display, or the viewer fails.
    """
    require_display()
    with tempfile.TemporaryDirectory(prefix="busybot-view-") as name:
        folder, port = Path(name), free_port()
        with viewer_process(["--port", str(port), str(rrd.resolve())], folder, private=False) as process:
            if step is not None:
                with contextlib.suppress(*FAULTS):  # the window is open all the same
                    go_to_step(process, port, step)
            if process.wait() != 0:
                what = f"the viewer ended with exit code {process.returncode}\n{last_words(folder)}"
                raise BusybotError(what.rstrip(), "busybot doctor, or use --web")


def serve_web(rrd: Path, announce: Callable[[str], None]) -> None:
    """Serve the viewer to browsers on this machine until Ctrl-C; `announce` is given the address once it answers.

    Raises:
        BusybotError: the server does not start or ends by itself.
    """
    with tempfile.TemporaryDirectory(prefix="busybot-view-") as name:
        folder, data_port, web_port = Path(name), free_port(), _preferred_port()
        origin = f"http://{LOOPBACK}:{web_port}"
        proxy = quote(f"rerun+http://{LOOPBACK}:{data_port}/proxy", safe="")
        arguments = ["--serve-web", "--port", str(data_port), "--web-viewer-port", str(web_port)]
        arguments += ["--cors-allow-origin", origin, str(rrd.resolve())]
        with viewer_process(arguments, folder) as process:
            try:
                fault = _serve(process, web_port, lambda: announce(f"{origin}?url={proxy}"))
            except KeyboardInterrupt:
                return
            hint = "use --save F.rrd and open the file with rerun"
            raise BusybotError(f"the web viewer: {fault}\n{last_words(folder)}".rstrip(), hint)


def _serve(process: "subprocess.Popen[bytes]", port: int, announce: Callable[[], None]) -> str:
    """Announce the server once it answers, and wait for it; returns how it failed."""
    try:
        _once_open(process, port, WEB_SECONDS, lambda: None)
    except (RuntimeError, TimeoutError) as error:
        return str(error)
    announce()
    return f"it ended with exit code {process.wait()}"


def _preferred_port() -> int:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, WEB_PORT))
            return WEB_PORT
        except OSError:
            return free_port()


def save_screenshot(rrd: Path, picture: Path, step: int | None) -> None:
    """Write a PNG of the viewer showing `rrd` at `step` of the timeline `step`, or as it opens a recording of others.

    Raises:
        BusybotError: the viewer does not start, load or draw in time.
    """
    with tempfile.TemporaryDirectory(prefix="busybot-view-") as name:
        folder, port = Path(name), free_port()
        arguments = ["--headless", "--renderer", "vulkan", "--port", str(port), "--memory-limit", "2GiB"]
        arguments += ["--window-size", f"{SIZE[0]}x{SIZE[1] + TITLE_BAR}", "--hide-welcome-screen", str(rrd.resolve())]
        with viewer_process(arguments, folder) as process:
            try:
                client = go_to_step(process, port, step)
                png = _without_title_bar(_settled_picture(client))
            except FAULTS as error:
                said = last_words(folder)
                raise BusybotError(f"the headless viewer made no picture: {error}\n{said}".rstrip(), HINT) from None
    write_atomically(picture, png)


def go_to_step(process: "subprocess.Popen[bytes]", port: int, step: int | None) -> ViewerClient:
    """Wait until the viewer has loaded its recording, then set its time; raises one of `FAULTS`."""
    address = f"rerun+http://{LOOPBACK}:{port}/proxy"
    client = _once_open(process, port, START_SECONDS, lambda: ViewerClient.connect(address))
    _wait_until_loaded(client, process)
    if step is None:
        client.set_time(play_state="paused")
    else:
        client.set_time("step", sequence=step, play_state="paused")
    return client


def _once_open(process: "subprocess.Popen[bytes]", port: int, seconds: float, ask: Callable[[], T]) -> T:
    """Wait until a port answers, then ask; raises one of `FAULTS`."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        _refuse_ended(process)
        try:
            socket.create_connection((LOOPBACK, port), 1).close()
            return ask()
        except OSError:
            time.sleep(POLL_SECONDS)
    raise TimeoutError(f"it did not start within {seconds:.0f} s")


def _wait_until_loaded(client: ViewerClient, process: "subprocess.Popen[bytes]") -> None:
    deadline, reason = time.monotonic() + LOAD_SECONDS, "it answered nothing"
    while time.monotonic() < deadline:
        _refuse_ended(process)
        try:
            state = client.get_state()
            if not state.loading and any(recording.timelines for recording in state.recordings):
                return
            reason = "it is still loading"
        except (RuntimeError, ConnectionError) as error:
            reason = str(error)
        time.sleep(POLL_SECONDS)
    raise TimeoutError(f"it did not load the recording within {LOAD_SECONDS:.0f} s: {reason}")


def _refuse_ended(process: "subprocess.Popen[bytes]") -> None:
    if process.poll() is not None:
        raise RuntimeError(f"it ended with exit code {process.returncode}")


def _settled_picture(client: ViewerClient) -> bytes:
    """The first picture that equals the two before: views fade in and textures arrive late."""
    deadline = time.monotonic() + SETTLE_SECONDS
    before, same = b"", 0
    while time.monotonic() < deadline and same < 2:
        picture = client.take_screenshot()
        same = same + 1 if picture == before else 0
        before = picture
        time.sleep(POLL_SECONDS)
    if not before:
        raise TimeoutError(f"it drew nothing within {SETTLE_SECONDS:.0f} s")
    return before


def _without_title_bar(png: bytes) -> bytes:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("it sent something that is not a picture")
    return cv2.imencode(".png", image[TITLE_BAR:], [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()
