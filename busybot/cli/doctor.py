"""`busybot doctor`: what this machine offers, and for each failure the command that mends it.

Whatever can crash or hang (Vulkan, native libraries) is asked in processes of its own with a time limit, so this works
when sapien or torch cannot be imported at all. `--report` prints what is to be put into a bug report: the
machine, without whose it is.
"""

import getpass
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any

import typer

from busybot.cli.common import console, print_json, tell
from busybot.cli.options import JsonOption
from busybot.common.device import CHOICE
from busybot.common.errors import current_folder
from busybot.common.text import plain

SETUP = "make setup"
ROOT = Path(__file__).resolve().parents[2]
PYTHONS = ((3, 11), (3, 13))
IMPORTS = ("sapien", "torch", "cv2", "rerun", "pyarrow")
TIME_LIMIT_S = 120.0
TOGETHER_S = 60.0
"""For a picture while torch computes."""
LEAST_FREE_BYTES = 2 << 30
CHOOSE_DRIVER = ("VK_DRIVER_FILES", "VK_ICD_FILENAMES")
DRAW_ON_CORES = f"--device auto, {SETUP} (Mesa's driver), no {CHOOSE_DRIVER[0]} without it: pictures on the cores"
"""What mends it where networks and pictures cannot share a GPU."""
WHICH = """
from busybot.common.device import chosen, gpus
from busybot.sim.vulkan_check import render_device
print(chosen(), gpus(), render_device())
"""
CATEGORIES = ("Switch", "Door", "Lamp", "Toy")

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


@dataclass(frozen=True)
class Check:
    """One row: `value` is what was found, `hint` the command or sentence that mends a failure (None when ok)."""

    name: str
    ok: bool
    value: str
    hint: str | None = None


def doctor(
    report: Annotated[
        bool,
        typer.Option(
            "--report",
            help="Print a text for a bug report instead: versions and checks, without names, paths, secrets.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show what this machine offers; for each failure the command that mends it."""
    checks = examine()
    if report:
        found = about(checks)
        if as_json:
            print_json(found)
        else:
            tell(found["text"])
        return
    ok = all(check.ok for check in checks)
    if as_json:
        print_json({"ok": ok, "checks": checks})
    else:
        _show(checks, ok)
    raise typer.Exit(0 if ok else 1)


def examine() -> list[Check]:
    """All checks, in the order of the table."""
    parts: tuple[Callable[[], list[Check]], ...] = (python, packages, imports, vulkan, gpu, assets, disk)
    with ThreadPoolExecutor() as pool:
        return [check for rows in pool.map(_guarded, parts) for check in rows]


def _guarded(part: Callable[[], list[Check]]) -> list[Check]:
    """A check that fails in a way nobody foresaw is a row, not the end of the table."""
    try:
        return part()
    except Exception as error:  # the doctor must finish whatever is broken
        return [Check(part.__name__, False, f"{type(error).__name__}: {error}", SETUP)]


def python() -> list[Check]:
    """The version of Python and the place of its environment."""
    ok = PYTHONS[0] <= sys.version_info[:2] <= PYTHONS[1]
    wanted = " to ".join(f"{major}.{minor}" for major, minor in PYTHONS)
    return [Check("Python", ok, f"{platform.python_version()}, {sys.prefix}", None if ok else f"use Python {wanted}")]


def packages() -> list[Check]:
    """Pinned against installed versions: one row for all that agree, one for each that does not."""
    try:
        requirements = metadata.requires("busybot") or []
    except metadata.PackageNotFoundError:
        return [Check("packages", False, "busybot itself is not installed", SETUP)]
    exact = _pins()
    named = {line: re.match(r"[\w.-]+", line)[0] for line in requirements}  # type: ignore[index]
    own = {name for line, name in named.items() if name in exact or "extra ==" not in line}
    rows = []
    pins = {name: exact.get(name) for name in own - {"busybot"}}
    for name, pinned in sorted(pins.items()):
        found = _version(name)
        # A local part names a build of the same version: torch 2.13.0+cpu is torch 2.13.0.
        if found is None or pinned and found.split("+")[0] != pinned:
            told = f"{found or 'absent'}, pinned is {pinned}" if pinned else "absent"
            rows.append(Check(f"package {name}", False, told, SETUP))
    agreeing = f"{len(pins) - len(rows)} of {len(pins)} {'as pinned' if exact else 'are there'}"
    return [Check("packages", not rows, agreeing, SETUP if rows else None), *rows]


def _pins() -> dict[str, str]:
    """The exact versions of the set-up's lock; outside of the repository there are none."""
    files = (ROOT / "requirements" / name for name in ("lock.txt", "constraints.txt"))
    text = "\n".join(file.read_text(encoding="utf-8") for file in files if file.is_file())
    return dict(re.findall(r"^([\w.-]+)==([^\s;\\]+)", text, re.MULTILINE))


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def imports() -> list[Check]:
    """Whether the packages with native libraries can be imported, each in its own process."""
    with ThreadPoolExecutor(max_workers=2) as pool:
        return list(pool.map(_import_check, IMPORTS))


def _import_check(name: str) -> Check:
    code = f"import {name}; print({name}.__version__)"
    answer, error = _ask([sys.executable, "-c", code])
    if error is not None:
        return Check(f"import {name}", False, error, SETUP)
    return Check(f"import {name}", True, answer.splitlines()[-1] if answer else "ok")


def vulkan() -> list[Check]:
    """The device and driver that SAPIEN takes, and whether a tiny image comes out right."""
    from busybot.sim.vulkan_check import run

    found = run(sys.executable, TIME_LIMIT_S)
    chosen = next((name for name in CHOOSE_DRIVER if os.environ.get(name)), None)
    cure = (
        f"unset {chosen} (it names another driver)" if chosen else f"{SETUP} (installs a driver, or says what to run)"
    )
    there, renders = found["device"] is not None, found["renders"]
    rows = (
        ("Vulkan device", there, found["device"] or "none"),
        ("Vulkan driver", there, found["driver"] or "unknown"),
        ("rendering", renders, "a test image is right" if renders else found["error"]),
    )
    return [Check(name, ok, value, None if ok or renders else cure) for name, ok, value in rows]


def gpu() -> list[Check]:
    """NVIDIA GPUs, whether torch uses them and SAPIEN draws meanwhile, and what `--device` chooses. None is needed."""
    tool = shutil.which("nvidia-smi")
    listed, error = _ask([tool, "--query-gpu=name", "--format=csv,noheader"]) if tool else ("", "absent")
    if error is not None or not listed:
        return [Check("GPU", True, "none (not needed; everything runs on the CPU)"), _device()]
    names = ", ".join(listed.splitlines())
    seen, error = _ask([sys.executable, "-c", "import torch; print(torch.cuda.is_available())"])
    if error is None and seen.endswith("True"):
        return [Check("GPU", True, f"{names}, CUDA"), _together(), _device()]
    return [Check("GPU", True, f"{names}, not used by torch", SETUP), _device()]


def _together() -> Check:
    """Whether pictures are drawn, where this process would, while torch uses the GPU: on some hosts both hang there."""
    from busybot.sim.vulkan_check import run

    found = run(sys.executable, TOGETHER_S, cuda=True)
    told = f"{found['device']} draws while torch computes" if found["renders"] else found["error"]
    return Check("CUDA and rendering", found["renders"], told, None if found["renders"] else DRAW_ON_CORES)


def _device() -> Check:
    """What commands use that are not told by `--device`; fails if the environment names what is not there."""
    answer, error = _ask([sys.executable, "-c", WHICH])
    if error is not None:
        named = os.environ.get(CHOICE)
        what = f"{named} is not there" if named else error
        return Check("device", False, what, f"unset {CHOICE}, or set it to auto" if named else SETUP)
    name, count, drawn = answer.splitlines()[-1].split()
    of_all = f"{count} GPU{'s, in turn' if int(count) > 1 else ''}" if int(count) else "the CPU"
    of_all += ", pictures on the cores" if int(count) and drawn == "cpu" else ""
    return Check("device", True, f"{name}: {of_all}" if name in ("auto", "cuda") else name)


def assets() -> list[Check]:
    """Where objects come from: procedural ones through the cache, real ones where a folder is named."""
    from busybot.objects.cache import cache_folder

    cache = cache_folder()
    existing = next(folder for folder in (cache, *cache.absolute().parents) if folder.is_dir())
    writable = os.access(existing, os.W_OK | os.X_OK)
    hint = None if writable else "export BUSYBOT_CACHE=FOLDER (one that can be written)"
    rows = [Check("procedural objects", writable, f"cache {cache}{'' if writable else ' cannot be written'}", hint)]
    named = os.environ.get("BUSYBOT_PARTNET_DIR")
    if not named:
        return [*rows, Check("PartNet-Mobility objects", True, "none (BUSYBOT_PARTNET_DIR can name their folder)")]
    found = [name for name in CATEGORIES if (Path(named) / name).is_dir()]
    counts = [f"{sum(1 for _ in (Path(named) / name).iterdir())} {name}" for name in found]
    value = f"{named}: {', '.join(counts) or 'no folder Switch, Door, Lamp or Toy'}"
    hint = None if found else "export BUSYBOT_PARTNET_DIR=FOLDER (the folder of Switch, Door, Lamp, Toy), or unset it"
    return [*rows, Check("PartNet-Mobility objects", bool(found), value, hint)]


def disk() -> list[Check]:
    """Free space where commands write by default."""
    if not (here := current_folder()):
        return [Check("disk", False, "the current folder was deleted", "change into a folder that exists")]
    free = shutil.disk_usage(here).free
    ok = free >= LEAST_FREE_BYTES
    hint = None if ok else f"free at least {LEAST_FREE_BYTES >> 30} GiB, or work in another folder"
    return [Check("disk", ok, f"{free / (1 << 30):.1f} GiB free in {here}", hint)]


def _ask(argv: list[str]) -> tuple[str, str | None]:
    """What a command prints, and None; or whatever, and why it failed."""
    try:
        done = subprocess.run(
            argv, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", timeout=TIME_LIMIT_S
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return "", str(error)
    if done.returncode == 0:
        return done.stdout.strip(), None
    words = [line for line in done.stderr.splitlines() if line.strip()]
    return done.stdout, words[-1].strip() if words else f"ended with code {done.returncode}"


def _show(checks: list[Check], ok: bool) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table("", "check", "found", "hint")
    for check in checks:
        mark = Text("ok", "green") if check.ok else Text("FAIL", "bold red")
        table.add_row(mark, check.name, Text(plain(check.value)), Text(plain(check.hint or "")))
    screen = console()
    screen.print(table)
    screen.print("Everything is in order." if ok else "Something needs mending: see the last column.")


def machine() -> dict[str, str]:
    """Versions and size of this machine."""
    from busybot.evaluation.results import PACKAGES, commit, package_versions

    versions = package_versions()
    packages = ", ".join(f"{name} {versions[name]}" for name in PACKAGES if name in versions)
    own = versions["busybot"]
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


def about(checks: list[Check]) -> dict[str, Any]:
    """Facts and checks without names and places; `text` has both as Markdown to be filled in."""
    told = nameless()
    facts = {name: told(value) for name, value in machine().items()}
    rows: list[dict[str, Any]] = [{"name": check.name, "ok": check.ok, "value": told(check.value)} for check in checks]
    lines = "\n".join(f"| {name} | {_cell(value)} |" for name, value in facts.items())
    found = "\n".join(f"| {'ok' if row['ok'] else 'FAIL'} | {row['name']} | {_cell(row['value'])} |" for row in rows)
    return {"machine": facts, "checks": rows, "text": REPORT.format(facts=lines, checks=found)}


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())
