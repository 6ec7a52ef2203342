"""Which commands bring a Vulkan driver that SAPIEN can use, and missing system libraries, onto this distribution.

SAPIEN renders with `VK_KHR_external_semaphore_fd`, which Mesa's software driver has from 24.3 on. Debian 12 has it in
its suite bookworm-backports, Debian 13 in its main suite, Ubuntu 24.04 among its updates. Everything here is a function
of texts (os-release, apt's source lists) and runs nothing.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, field

BACKPORTS = "bookworm-backports"
MESA = "mesa-vulkan-drivers"
SOURCES_FOLDER = "/etc/apt/sources.list.d"
NEEDED = (
    "SAPIEN needs a Vulkan driver with VK_KHR_external_semaphore_fd: that of a GPU's vendor, or Mesa 24.3 or newer "
    "(its software driver lavapipe needs no GPU)"
)
# Shared libraries that the packages from the registry expect to find, and the Debian package of each.
LIBRARIES = {
    "libGL.so.1": "libgl1",
    "libgthread-2.0.so.0": "libglib2.0-0",
    "libX11.so.6": "libx11-6",
    "libxcb.so.1": "libxcb1",
    "libudev.so.1": "libudev1",
}


@dataclass(frozen=True)
class Source:
    """One entry of apt's source lists. `options` is what a copy of the entry must keep, trust above all."""

    types: tuple[str, ...]
    uris: tuple[str, ...]
    suites: tuple[str, ...]
    components: tuple[str, ...]
    options: str
    deb822: bool


@dataclass(frozen=True)
class Command:
    """A command that needs root, and what it reads on standard input."""

    argv: tuple[str, ...]
    stdin: str | None = None

    def text(self, prefix: str = "") -> str:
        """As a person types it in a shell, `prefix` (`sudo `) before the program."""
        call = prefix + shlex.join(self.argv)
        if self.stdin is None:
            return call
        lines = " ".join(shlex.quote(line) for line in self.stdin.splitlines())
        return f"printf '%s\\n' {lines} | {call} > /dev/null"


@dataclass(frozen=True)
class Plan:
    """What to run as root, in this order; or, where nothing is known to help, what a person has to see to."""

    commands: tuple[Command, ...] = ()
    advice: str | None = None


@dataclass(frozen=True)
class Distribution:
    """What os-release says. `codename` is the Debian or Ubuntu release that a derivative builds on."""

    id: str
    version: str
    codename: str
    name: str = field(default="this system", compare=False)


def parse_os_release(text: str) -> Distribution:
    """Read os-release: KEY=value lines, values perhaps quoted."""
    pairs = (line.split("=", 1) for line in text.splitlines() if "=" in line and not line.lstrip().startswith("#"))
    values = {key.strip(): " ".join(shlex.split(value)) for key, value in pairs}
    ubuntu, debian = values.get("UBUNTU_CODENAME", ""), values.get("DEBIAN_CODENAME", "")
    return Distribution(
        id="ubuntu" if ubuntu else "debian" if debian else values.get("ID", "unknown"),
        version=values.get("VERSION_ID", ""),
        codename=ubuntu or debian or values.get("VERSION_CODENAME", ""),
        name=values.get("PRETTY_NAME", "this system"),
    )


def parse_sources(path: str, text: str) -> list[Source]:
    """Enabled entries of one source list, deb822 (`*.sources`) or one line each (`*.list`)."""
    return _parse_deb822(text) if path.endswith(".sources") else _parse_one_line(text)


def _parse_one_line(text: str) -> list[Source]:
    entry = re.compile(r"^(deb|deb-src)\s+(?:\[([^\]]*)\]\s+)?(\S+)\s+(\S+)((?:\s+\S+)*)\s*$")
    matches = (entry.match(line.split("#", 1)[0].strip()) for line in text.splitlines())
    return [
        Source((m[1],), (m[3],), (m[4],), tuple(m[5].split()), (m[2] or "").strip(), deb822=False)
        for m in matches
        if m is not None
    ]


def _parse_deb822(text: str) -> list[Source]:
    found = []
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    for stanza in re.split(r"\n[ \t]*\n", "\n".join(lines)):
        fields = dict(re.findall(r"^([A-Za-z-]+):[ \t]*((?:.*)(?:\n[ \t]+.*)*)", stanza, flags=re.MULTILINE))
        values = {key.lower(): value.strip() for key, value in fields.items()}
        if "uris" not in values or values.get("enabled", "yes").lower() in ("no", "false", "off", "0", "without"):
            continue
        own = ("types", "uris", "suites", "components", "enabled")
        kept = [f"{key}: {value.rstrip()}" for key, value in fields.items() if key.lower() not in own]
        types, uris, suites, components = (tuple(values.get(key, "").split()) for key in own[:4])
        found.append(Source(types, uris, suites, components, "\n".join(kept), deb822=True))
    return found


def backports_source(sources: list[Source]) -> Command | None:
    """Write a source for backports: mirror and trust are those of the entry that the suite bookworm comes from."""
    for source in sources:
        usable = [uri for uri in source.uris if not uri.startswith("cdrom:")]
        if (
            "deb" not in source.types
            or "bookworm" not in source.suites
            or "main" not in source.components
            or not usable
        ):
            continue
        if source.deb822:
            text = (
                f"Types: deb\nURIs: {usable[0]}\nSuites: {BACKPORTS}\nComponents: main\n{source.options}".rstrip()
                + "\n"
            )
            return Command(("tee", f"{SOURCES_FOLDER}/busybot-backports.sources"), text)
        options = f"[{source.options}] " if source.options else ""
        text = f"deb {options}{usable[0]} {BACKPORTS} main\n"
        return Command(("tee", f"{SOURCES_FOLDER}/busybot-backports.list"), text)
    return None


def install(packages: list[str], suite: str | None = None) -> tuple[Command, Command]:
    """Refresh apt's lists and install packages, from `suite` where given."""
    target = ("-t", suite) if suite else ()
    call = ("env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "install", "-y", "--no-install-recommends", *target)
    return Command(("apt-get", "update")), Command((*call, *packages))


def package_of(library: str, system: Distribution) -> str:
    """The package that has a shared library; glib was renamed in the releases with 64-bit time."""
    package = LIBRARIES[library]
    old = (system.id, system.codename) in (("debian", "bookworm"), ("ubuntu", "jammy"))
    return "libglib2.0-0t64" if package == "libglib2.0-0" and not old else package


def plan(system: Distribution, sources: list[Source], packages: list[str], driver: bool) -> Plan:
    """Commands that install `packages` and, where `driver`, a new enough Vulkan driver.

    Args:
        system: what os-release says.
        sources: all enabled entries of apt's source lists.
        packages: Debian packages that are missing, by name; may be empty.
        driver: whether a Vulkan driver is needed too.
    """
    if system.id not in ("debian", "ubuntu"):
        return Plan(advice=_unknown(system, packages, driver))
    if not driver:
        return Plan(install(packages))
    wanted = [*packages, MESA]
    suites = {suite for source in sources for suite in source.suites if "deb" in source.types}
    if system.id == "debian":
        return _plan_debian(system, sources, suites, wanted)
    return _plan_ubuntu(system, suites, wanted)


def _plan_debian(system: Distribution, sources: list[Source], suites: set[str], wanted: list[str]) -> Plan:
    if system.codename != "bookworm":
        if system.version.split(".")[0].isdecimal() and int(system.version.split(".")[0]) < 12:
            return Plan(advice=_too_old(system))
        return Plan(install(wanted))
    if BACKPORTS in suites:
        return Plan(install(wanted, BACKPORTS))
    source = backports_source(sources)
    if source is None:
        return Plan(
            advice=f"{NEEDED}. Debian 12 has it in {BACKPORTS}, but no apt source names a mirror of bookworm: "
            f"add {BACKPORTS} to the sources in {SOURCES_FOLDER}, then run the set-up again"
        )
    return Plan((source, *install(wanted, BACKPORTS)))


def _plan_ubuntu(system: Distribution, suites: set[str], wanted: list[str]) -> Plan:
    if system.codename != "noble":
        year = system.version.split(".")[0]
        newer = year.isdecimal() and int(year) >= 24 and system.codename not in ("bionic", "focal", "jammy")
        return Plan(install(wanted)) if newer else Plan(advice=_too_old(system))
    if "noble-updates" not in suites:
        return Plan(
            advice=f"{NEEDED}. Ubuntu 24.04 has it in its suite noble-updates, which no apt source names: "
            f"add it to the sources in {SOURCES_FOLDER}, then run the set-up again"
        )
    return Plan(install(wanted))


def _too_old(system: Distribution) -> str:
    return (
        f"{NEEDED}. {system.name} has an older Mesa and no suite with a newer one is known. "
        "Use Debian 12 or newer or Ubuntu 24.04 or newer, or install the driver of the GPU's vendor"
    )


def _unknown(system: Distribution, packages: list[str], driver: bool) -> str:
    parts = [NEEDED] if driver else []
    if packages:
        parts.append(f"the contents of these Debian packages are missing: {' '.join(packages)}")
    return f"{'; '.join(parts)}. How {system.name} names its packages is not known here: install them, then run again"
