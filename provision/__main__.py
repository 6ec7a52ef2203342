"""`python3 -m provision`: the whole set-up behind `make setup`. Needs nothing but Python's standard library.

1. System libraries, Python's venv and, where there is no Vulkan driver at all, a driver.
2. `.venv` with the pinned packages.
3. A probe renders a tiny image with SAPIEN; where it cannot, a new enough Mesa is installed.

What is already there is left alone, so a second run only probes.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import time
from pathlib import Path

from provision import driver, packages, system
from provision.steps import Log, SetupError, alone_in, say

ROOT = Path(__file__).resolve().parents[1]
OLDEST, NEWEST = (3, 11), (3, 13)
PROBE_SECONDS = 180.0


def main() -> int:
    """Set up, or say what went wrong and what to do; the exit code."""
    start = time.monotonic()
    try:
        _right_python()
        with alone_in(ROOT):
            line = set_up(Log(ROOT / ".setup.log"))
    except SetupError as error:
        say(f"error: {error.what}")
        print(error.hint, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        say("interrupted; `make setup` goes on from here")
        return 130
    say(f"{line} ({time.monotonic() - start:.0f} s)")
    return 0


def set_up(log: Log) -> str:
    """All three parts; the line that says that everything is ready."""
    here = system.distribution()
    environment = packages.Environment(ROOT, packages.has_nvidia_gpu())
    if environment.ready():
        # where it renders already, nothing is installed, wherever the driver may lie
        found = probe(environment)
        if found["renders"]:
            return _ready(found)
    missing, driverless = system.missing_packages(here), not system.has_vulkan_driver()
    if missing or driverless:
        why = " and ".join(["system packages are missing"] * bool(missing) + ["there is no Vulkan driver"] * driverless)
        system.apply(driver.plan(here, system.sources(), missing, driverless), why, log)
    if not environment.ready():
        packages.create(environment, log)
        packages.install(environment, log)
    found = probe(environment)
    if not found["renders"]:
        why = f"SAPIEN cannot render here ({found['error']})"
        if chosen := system.chosen_driver():
            raise SetupError(why, f"{chosen} names the driver: unset it, then run `make setup` again.")
        system.apply(driver.plan(here, system.sources(), [], driver=True), why, log)
        found = probe(environment)
    if not found["renders"]:
        raise SetupError(
            f"SAPIEN still cannot render: {found['error']}",
            "`.venv/bin/busybot doctor` shows the Vulkan device. VK_DRIVER_FILES can name another driver's JSON file.",
        )
    return _ready(found)


def _ready(found: dict[str, object]) -> str:
    return f"ready: Python {platform.python_version()}, {found['device']}, {found['driver']}"


def probe(environment: packages.Environment) -> dict[str, object]:
    """Render a tiny image in a process of its own."""
    from busybot.sim.vulkan_check import run

    return run(str(environment.python), PROBE_SECONDS)


def _right_python() -> None:
    """Go on under a Python that the pinned packages exist for, or say so."""
    if OLDEST <= sys.version_info[:2] <= NEWEST:
        return
    for minor in range(OLDEST[1], NEWEST[1] + 1):
        other = shutil.which(f"python3.{minor}")
        if other and subprocess.run([other, "-c", ""], capture_output=True).returncode == 0:
            os.execv(other, [other, "-m", "provision"])
    raise SetupError(
        f"Python {platform.python_version()} is not among 3.{OLDEST[1]} to 3.{NEWEST[1]}",
        f"Install one of these, for example python3.{OLDEST[1]}, or name it: make setup PYTHON=/path/to/python3",
    )


if __name__ == "__main__":
    sys.exit(main())
