"""From os-release and source lists to the commands that install a Vulkan driver; nothing is run."""

import subprocess
from pathlib import Path

import pytest

from provision import driver
from tests.setup import samples

INSTALL = ("env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "install", "-y", "--no-install-recommends")
FROM_BACKPORTS = (*INSTALL, "-t", "bookworm-backports", "mesa-vulkan-drivers")


def plan(release: str, lists: dict[str, str], packages: tuple[str, ...] = (), mesa: bool = True) -> driver.Plan:
    sources = [source for path, text in lists.items() for source in driver.parse_sources(path, text)]
    return driver.plan(driver.parse_os_release(release), sources, list(packages), mesa)


def test_debian_12_deb822_uses_the_mirror_and_key_that_are_there() -> None:
    write, update, install = plan(samples.DEBIAN_12, {"debian.sources": samples.BOOKWORM_DEB822}).commands
    assert write.argv == ("tee", "/etc/apt/sources.list.d/busybot-backports.sources")
    assert write.stdin == (
        "Types: deb\nURIs: http://mirror.example/debian\nSuites: bookworm-backports\nComponents: main\n"
        "Signed-By: /usr/share/keyrings/debian-archive-keyring.gpg\n"
    )
    assert update.argv == ("apt-get", "update")
    assert install.argv == FROM_BACKPORTS


def test_debian_12_one_line_skips_the_installation_medium_and_security() -> None:
    write, _, install = plan(samples.DEBIAN_12, {"sources.list": samples.BOOKWORM_ONE_LINE}).commands
    assert write.argv == ("tee", "/etc/apt/sources.list.d/busybot-backports.list")
    assert write.stdin == "deb http://mirror.example/debian/ bookworm-backports main\n"
    assert install.argv == FROM_BACKPORTS


def test_debian_12_one_line_keeps_the_options() -> None:
    write = plan(samples.DEBIAN_12, {"own.list": samples.BOOKWORM_OPTIONS}).commands[0]
    options = "[arch=amd64 signed-by=/usr/share/keyrings/own.gpg]"
    assert write.stdin == f"deb {options} https://inside.example/debian bookworm-backports main\n"


def test_debian_12_keeps_an_embedded_key_whole() -> None:
    write = plan(samples.DEBIAN_12, {"own.sources": samples.BOOKWORM_EMBEDDED_KEY}).commands[0]
    (copied,) = driver.parse_sources("x.sources", write.stdin or "")
    (original,) = driver.parse_sources("x.sources", samples.BOOKWORM_EMBEDDED_KEY)
    assert copied.options == original.options
    assert "mDMEYCQjIxYJKwYBBAHaRw8BAQdAD" in copied.options
    assert copied.uris == ("https://inside.example/debian",)
    assert copied.suites == ("bookworm-backports",)


@pytest.mark.parametrize("name", ["bp.list", "bp.sources"])
def test_debian_12_with_backports_adds_no_source(name: str) -> None:
    (source,) = driver.parse_sources("a.list", samples.BACKPORTS_ONE_LINE)
    text = samples.BACKPORTS_ONE_LINE
    if name.endswith(".sources"):
        text = f"Types: deb\nURIs: {source.uris[0]}\nSuites: bookworm-backports\nComponents: main\n"
    commands = plan(samples.DEBIAN_12, {"debian.sources": samples.BOOKWORM_DEB822, name: text}).commands
    assert [command.argv for command in commands] == [("apt-get", "update"), FROM_BACKPORTS]


def test_debian_12_with_disabled_backports_adds_the_source() -> None:
    lists = {"debian.sources": samples.BOOKWORM_DEB822, "bp.sources": samples.BACKPORTS_DISABLED}
    assert plan(samples.DEBIAN_12, lists).commands[0].argv[0] == "tee"


def test_debian_12_without_a_mirror_says_what_is_needed() -> None:
    made = plan(samples.DEBIAN_12, {})
    assert not made.commands
    assert made.advice is not None and "bookworm-backports" in made.advice


@pytest.mark.parametrize(
    ("release", "lists"),
    [
        (samples.DEBIAN_13, {"debian.sources": samples.TRIXIE_DEB822}),
        (samples.DEBIAN_SID, {}),
        (samples.UBUNTU_24, {"ubuntu.sources": samples.NOBLE_DEB822}),
        (samples.UBUNTU_26, {}),
        (samples.MINT_22, {"official.sources": samples.NOBLE_DEB822}),
    ],
)
def test_newer_systems_install_from_their_own_suites(release: str, lists: dict[str, str]) -> None:
    commands = plan(release, lists).commands
    assert [command.argv for command in commands] == [("apt-get", "update"), (*INSTALL, "mesa-vulkan-drivers")]


@pytest.mark.parametrize(
    ("release", "lists", "word"),
    [
        (samples.UBUNTU_22, {"sources.list": samples.JAMMY_ONE_LINE}, "Ubuntu 22.04.5 LTS has an older Mesa"),
        (samples.DEBIAN_11, {}, "bullseye"),
        (samples.UBUNTU_24, {"ubuntu.sources": samples.NOBLE_WITHOUT_UPDATES}, "noble-updates"),
        (samples.FEDORA, {}, "Fedora Linux 42"),
        ("", {}, "this system"),
    ],
)
def test_systems_without_a_known_way_are_told_what_is_needed(release: str, lists: dict[str, str], word: str) -> None:
    made = plan(release, lists)
    assert not made.commands
    assert made.advice is not None
    assert word in made.advice and "Mesa 24.3" in made.advice


def test_missing_packages_alone_need_no_backports() -> None:
    commands = plan(samples.DEBIAN_12, {}, packages=("libgl1", "python3.11-venv"), mesa=False).commands
    assert [command.argv for command in commands] == [("apt-get", "update"), (*INSTALL, "libgl1", "python3.11-venv")]


def test_missing_packages_and_driver_come_in_one_go() -> None:
    commands = plan(samples.DEBIAN_12, {"a.sources": samples.BOOKWORM_DEB822}, packages=("libgl1",)).commands
    assert commands[-1].argv == (*INSTALL, "-t", "bookworm-backports", "libgl1", "mesa-vulkan-drivers")


@pytest.mark.parametrize(
    ("release", "package"),
    [
        (samples.DEBIAN_12, "libglib2.0-0"),
        (samples.UBUNTU_22, "libglib2.0-0"),
        (samples.DEBIAN_13, "libglib2.0-0t64"),
        (samples.UBUNTU_24, "libglib2.0-0t64"),
    ],
)
def test_glib_is_named_as_the_release_names_it(release: str, package: str) -> None:
    assert driver.package_of("libgthread-2.0.so.0", driver.parse_os_release(release)) == package


@pytest.mark.parametrize("text", [samples.BOOKWORM_DEB822, samples.BOOKWORM_EMBEDDED_KEY])
def test_the_printed_command_writes_exactly_the_file(text: str, tmp_path: Path) -> None:
    """A person who pastes the line gets the same bytes as the set-up would have written."""
    source = driver.backports_source(driver.parse_sources("a.sources", text))
    assert source is not None
    target = tmp_path / "list with space"
    line = driver.Command(("tee", str(target)), source.stdin).text("env ")
    subprocess.run(["sh", "-c", line], check=True)
    assert target.read_text() == source.stdin


def test_no_host_is_written_into_the_set_up() -> None:
    """Mirrors come from the machine's own sources and packages from the user's registry settings."""
    root = Path(driver.__file__).parents[1]
    texts = [path.read_text() for path in (*root.glob("provision/*.py"), root / "Makefile", root / "pyproject.toml")]
    assert not [text for text in texts if "http:" in text or "https:" in text]
