"""Pictures of the viewer without a screen: a headless viewer on the loopback interface, driven to a step."""

import socket
import subprocess
import tempfile
import time
from pathlib import Path

from rerun.experimental import ViewerClient

from busybot.errors import BusybotError
from busybot.files import write_atomically
from busybot.view.process import LOOPBACK, free_port, last_words, viewer_process

START_SECONDS = 60.0
"""Compiling the shaders of a software renderer on a busy machine takes that long at worst."""
LOAD_SECONDS = 60.0
SETTLE_SECONDS = 20.0
POLL_SECONDS = 0.25
MEND = "busybot doctor (it checks the Vulkan driver), or use --save and look at the file elsewhere"


def save_screenshot(rrd: Path, picture: Path, step: int, size: tuple[int, int] = (1920, 1080)) -> None:
    """Write a PNG of the viewer showing `rrd` at `step` of the timeline `step`.

    Args:
        size: of the picture, pixels.

    Raises:
        BusybotError: the viewer does not start, load or draw in time.
    """
    with tempfile.TemporaryDirectory(prefix="busybot-view-") as name:
        folder, port = Path(name), free_port()
        arguments = ["--headless", "--renderer", "vulkan", "--port", str(port), "--memory-limit", "2GiB"]
        arguments += ["--window-size", f"{size[0]}x{size[1]}", "--hide-welcome-screen", str(rrd.resolve())]
        with viewer_process(arguments, folder) as process:
            try:
                client = _connect(process, port)
                _wait_until_loaded(client, process)
                client.set_time("step", sequence=step, play_state="paused")
                write_atomically(picture, _settled_picture(client))
            except (RuntimeError, ConnectionError, TimeoutError, ValueError) as error:
                said = last_words(folder)
                raise BusybotError(f"the headless viewer made no picture: {error}\n{said}".rstrip(), MEND) from None


def _connect(process: "subprocess.Popen[bytes]", port: int) -> ViewerClient:
    deadline = time.monotonic() + START_SECONDS
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise RuntimeError(f"it ended with exit code {process.returncode}")
        try:
            socket.create_connection((LOOPBACK, port), 1).close()
            return ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
        except OSError:
            time.sleep(POLL_SECONDS)
    raise TimeoutError(f"it did not start within {START_SECONDS:.0f} s")


def _wait_until_loaded(client: ViewerClient, process: "subprocess.Popen[bytes]") -> None:
    deadline, reason = time.monotonic() + LOAD_SECONDS, "it answered nothing"
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise RuntimeError(f"it ended with exit code {process.returncode}")
        try:
            state = client.get_state()
            if not state.loading and any(recording.timelines for recording in state.recordings):
                return
            reason = "it is still loading"
        except (RuntimeError, ConnectionError) as error:
            reason = str(error)
        time.sleep(POLL_SECONDS)
    raise TimeoutError(f"it did not load the recording within {LOAD_SECONDS:.0f} s: {reason}")


def _settled_picture(client: ViewerClient) -> bytes:
    """The first picture that equals the one before: views fade in and textures arrive late."""
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
