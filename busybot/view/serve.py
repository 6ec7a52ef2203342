"""The viewer for people: in a window, or in a browser on this machine."""

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

from busybot.common.errors import BusybotError
from busybot.view.screenshot import FAULTS, go_to_step
from busybot.view.viewer_process import LOOPBACK, free_port, last_words, viewer_process

WEB_PORT = 9090
START_SECONDS = 30.0


def has_display() -> bool:
    """Whether a window can open here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def require_display() -> None:
    """Refuse early where no window can open."""
    if not has_display():
        raise BusybotError(
            "there is no display for the viewer's window",
            "use --web (in a browser), --save F.rrd (to open elsewhere) or --screenshot F.png",
        )


def show_window(rrd: Path, step: int | None = None) -> None:
    """Open the native viewer and return when it is closed.

    Raises:
        BusybotError: there is no display, or the viewer fails.
    """
    require_display()
    with tempfile.TemporaryDirectory(prefix="busybot-view-") as name:
        port = free_port()
        with viewer_process(["--port", str(port), str(rrd.resolve())], Path(name), private=False) as process:
            if step is not None:
                with contextlib.suppress(*FAULTS):  # the window is open all the same
                    go_to_step(process, port, step)
            if process.wait() != 0:
                what = f"the viewer ended with exit code {process.returncode}\n{last_words(Path(name))}"
                raise BusybotError(what.rstrip(), "busybot doctor, or use --web")


def serve_web(rrd: Path, announce: Callable[[str], None]) -> None:
    """Serve the viewer to browsers on this machine until Ctrl-C; `announce` is given the address once it answers.

    Raises:
        BusybotError: the server does not start or ends by itself.
    """
    with tempfile.TemporaryDirectory(prefix="busybot-view-") as name:
        data_port, web_port = free_port(), _preferred_port()
        origin = f"http://{LOOPBACK}:{web_port}"
        arguments = ["--serve-web", "--port", str(data_port), "--web-viewer-port", str(web_port)]
        arguments += ["--cors-allow-origin", origin, str(rrd.resolve())]
        with viewer_process(arguments, Path(name)) as process:
            try:
                _wait_for_port(process, web_port, Path(name))
                announce(f"{origin}?url={quote(f'rerun+http://{LOOPBACK}:{data_port}/proxy', safe='')}")
                process.wait()
            except KeyboardInterrupt:
                return
            _refuse(f"it ended with exit code {process.returncode}", Path(name))


def _preferred_port() -> int:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, WEB_PORT))
            return WEB_PORT
        except OSError:
            return free_port()


def _wait_for_port(process: "subprocess.Popen[bytes]", port: int, folder: Path) -> None:
    deadline = time.monotonic() + START_SECONDS
    while time.monotonic() < deadline and process.poll() is None:
        try:
            socket.create_connection((LOOPBACK, port), 1).close()
            return
        except OSError:
            time.sleep(0.1)
    _refuse("it does not answer" if process.poll() is None else f"it ended with exit code {process.returncode}", folder)


def _refuse(what: str, folder: Path) -> None:
    said = last_words(folder)
    raise BusybotError(f"the web viewer: {what}\n{said}".rstrip(), "use --save F.rrd and open the file with rerun")
