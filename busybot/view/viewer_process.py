"""The viewer's process: it listens on this machine alone and never outlives the one that started it."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from busybot.common.atomic_io import new_file, write_json
from busybot.common.errors import BusybotError

LOOPBACK = "127.0.0.1"
STOP_SECONDS = 3.0

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
    raise BusybotError(f"{folder / 'rerun'}: Rerun's viewer is not there", "pip install --force-reinstall rerun-sdk")


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
