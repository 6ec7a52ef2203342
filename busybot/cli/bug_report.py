"""What `busybot doctor --report` prints to be put into a bug report: the machine, without whose it is."""

import getpass
import os
import platform
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

SYSTEM = ("/usr/", "/lib", "/opt/", "/etc/", "/dev/", "/proc/", "/bin/", "/sbin/")
"""Folders whose names say nothing about a user."""
SECRET = re.compile(r"TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIAL|KEY", re.IGNORECASE)
TELLING = re.compile(r"BUSYBOT_|VK_|CUDA_|NVIDIA_|RAY_|DVC_|LC_|LANG$|PYTHON|DISPLAY$|WAYLAND_|MESA_|OMP_")
"""Environment variables that change what commands do; that they are set is told, not what they say."""
SHORTEST = 4
"""Characters of a secret or a name of a user: shorter ones stand in ordinary words."""
_PATH = re.compile(r"(?<![\w.:/~-])(?:[A-Za-z]:[\\/]|/)(?!/)[^\s,;'\"()<>|]*[^\s,;'\"()<>|:.]")
_LOGIN = re.compile(r"(\w+://)[^\s/@]+@")

REPORT = """\
**What I did** (the command, and how its data were made)

**What I expected, and what happened** (the whole message)

**The machine**

| | |
|---|---|
{facts}

| | check | found |
|---|---|---|
{checks}
"""


def machine() -> dict[str, str]:
    """Versions and size of this machine."""
    from busybot.evaluation.results import commit, package_versions

    versions = {name: version for name, version in package_versions().items() if name not in ("busybot", "python")}
    packages = ", ".join(f"{name} {version}" for name, version in versions.items())
    own = package_versions(())["busybot"]
    return {
        "busybot": f"{own}, {source}" if (source := commit()) else own,
        "Python": f"{platform.python_implementation()} {platform.python_version()}",
        "system": f"{_distribution()}{platform.system()} {platform.release()}, {platform.machine()}",
        "cores": str(os.cpu_count()),
        "packages": packages,
        "variables that are set": ", ".join(sorted(filter(TELLING.match, os.environ))) or "none",
    }


def _distribution() -> str:
    try:
        return f"{platform.freedesktop_os_release()['PRETTY_NAME']}, "
    except (OSError, KeyError):
        return ""


def nameless() -> Callable[[str], str]:
    """A function that takes out of a text: places outside the system's own folders, the user's name, and secrets."""
    secrets = {value for name, value in os.environ.items() if SECRET.search(name) and len(value) >= SHORTEST}
    named = (value for value in os.environ.values() if value.startswith("/") and os.pathsep not in value)
    places = {str(Path.home()), os.getcwd(), sys.prefix, *named}
    own = {place for place in places if len(place) >= SHORTEST and not place.startswith(SYSTEM)}
    names = {name for name in (_user(), Path.home().name) if len(name) >= SHORTEST and name not in ("root", "user")}

    def told(text: str) -> str:
        for secret in sorted(secrets, key=len, reverse=True):
            text = text.replace(secret, "***")
        text = _LOGIN.sub(r"\1***@", text)
        for place in sorted(own, key=len, reverse=True):  # with blanks in them, too
            text = text.replace(place, "/PLACE")
        text = _PATH.sub(lambda path: path[0] if path[0].startswith(SYSTEM) else "(a path)", text)
        for name in names:
            text = re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", "(the user)", text)
        return text

    return told


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return ""


def report(checks: list[Any]) -> dict[str, Any]:
    """Facts and checks without names and places; `text` has both as Markdown to be filled in."""
    told = nameless()
    facts = {name: told(value) for name, value in machine().items()}
    rows = [{"name": check.name, "ok": check.ok, "value": told(check.value)} for check in checks]
    lines = "\n".join(f"| {name} | {_cell(value)} |" for name, value in facts.items())
    found = "\n".join(f"| {'ok' if row['ok'] else 'FAIL'} | {row['name']} | {_cell(row['value'])} |" for row in rows)
    return {"machine": facts, "checks": rows, "text": REPORT.format(facts=lines, checks=found)}


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())
