"""Pictures of the viewer without a screen: a headless viewer on the loopback interface, driven to a step."""

import socket
import subprocess
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from rerun.experimental import ViewerClient

from busybot.common.atomic_io import write_atomically
from busybot.common.errors import BusybotError
from busybot.view.viewer_process import LOOPBACK, free_port, last_words, viewer_process

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


def save_screenshot(rrd: Path, picture: Path, step: int) -> None:
    """Write a PNG of the viewer showing `rrd` at `step` of the timeline `step`.

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


def go_to_step(process: "subprocess.Popen[bytes]", port: int, step: int) -> ViewerClient:
    """Wait until the viewer has loaded its recording, then set its time; raises one of `FAULTS`."""
    client = _connect(process, port)
    _wait_until_loaded(client, process)
    client.set_time("step", sequence=step, play_state="paused")
    return client


def _connect(process: "subprocess.Popen[bytes]", port: int) -> ViewerClient:
    deadline = time.monotonic() + START_SECONDS
    while time.monotonic() < deadline:
        _refuse_ended(process)
        try:
            socket.create_connection((LOOPBACK, port), 1).close()
            return ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
        except OSError:
            time.sleep(POLL_SECONDS)
    raise TimeoutError(f"it did not start within {START_SECONDS:.0f} s")


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
