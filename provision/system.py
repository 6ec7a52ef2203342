"""This machine's facts for `provision.driver`, and its commands carried out as root or through sudo."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

from provision import driver
from provision.steps import Log, SetupError, say

ICD_FOLDERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")


def missing_packages(system: driver.Distribution) -> list[str]:
    """Debian packages whose shared libraries, or whose parts of Python, are not to be found."""
    missing = [driver.package_of(library, system) for library in driver.LIBRARIES if not _loads(library)]
    if importlib.util.find_spec("ensurepip") is None:
        missing.append(f"python{sys.version_info[0]}.{sys.version_info[1]}-venv")
    return missing


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def chosen_driver() -> str | None:
    """The environment variable that chooses the Vulkan driver, if one does."""
    return next((name for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES") if os.environ.get(name)), None)


def has_vulkan_driver() -> bool:
    """Whether any Vulkan driver is installed; whether SAPIEN can use it is another question."""
    # where the Vulkan loader looks beside the system's folders
    data = [os.environ.get("XDG_DATA_HOME") or "~/.local/share", *os.environ.get("XDG_DATA_DIRS", "").split(":")]
    folders = [*ICD_FOLDERS, *(f"{folder}/vulkan/icd.d" for folder in data if folder)]
    return chosen_driver() is not None or any(any(Path(f).expanduser().glob("*.json")) for f in folders)


def distribution() -> driver.Distribution:
    """This system, from its os-release."""
    for path in ("/etc/os-release", "/usr/lib/os-release"):
        try:
            return driver.parse_os_release(Path(path).read_text(encoding="utf-8"))
        except OSError:
            continue
    return driver.Distribution("unknown", "", "")


def sources() -> list[driver.Source]:
    """All enabled entries of apt's source lists."""
    folder = Path(driver.SOURCES_FOLDER)
    files = [folder.parent / "sources.list", *sorted(folder.glob("*.list")), *sorted(folder.glob("*.sources"))]
    found = []
    for file in files:
        try:
            found += driver.parse_sources(str(file), file.read_text(encoding="utf-8", errors="replace"))
        except OSError:
            continue
    return found


def root_prefix() -> tuple[str, ...] | None:
    """What to put before a command that needs root: nothing as root, sudo where it asks nothing, else None."""
    if os.geteuid() == 0:
        return ()
    if shutil.which("sudo") is None:
        return None
    allowed = subprocess.run(["sudo", "-n", "true"], stdin=subprocess.DEVNULL, capture_output=True)
    return ("sudo", "-n") if allowed.returncode == 0 else None


def apply(plan: driver.Plan, why: str, log: Log) -> None:
    """Carry the plan out, or say exactly what somebody with root has to run."""
    if plan.advice is not None:
        raise SetupError(why, plan.advice)
    prefix = root_prefix()
    if prefix is None:
        with_sudo = "sudo " if shutil.which("sudo") else ""
        lines = "\n".join(f"    {command.text(with_sudo)}" for command in plan.commands)
        who = "Run these commands" if with_sudo else "Run these commands as root"
        raise SetupError(why, f"{who}, then `make setup` again:\n{lines}")
    say(f"installing what the system lacks: {' '.join(_named(plan))}")
    for command in plan.commands:
        log.must(
            [*prefix, *command.argv],
            f"{why}, and `{command.text()}` failed",
            "Mend what the log says (a wrong or unreachable apt source, most likely), then run `make setup` again.",
            stdin=command.stdin,
        )


def _named(plan: driver.Plan) -> list[str]:
    argv = plan.commands[-1].argv
    words = list(argv[argv.index("--no-install-recommends") + 1 :])
    return words[2:] if words[0] == "-t" else words
