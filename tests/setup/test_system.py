"""Carrying a plan out as root, through sudo, or telling somebody with root what to run."""

from pathlib import Path

import pytest

from provision import driver, system
from provision.steps import Log, SetupError

PLAN = driver.Plan(
    (
        driver.Command(("tee", "/etc/apt/own.list"), "deb m bookworm-backports main\n"),
        *driver.install(["libgl1"], "bookworm-backports"),
    )
)


@pytest.fixture
def log(tmp_path: Path) -> Log:
    return Log(tmp_path / "log")


def test_without_root_and_sudo_the_commands_are_told(monkeypatch: pytest.MonkeyPatch, log: Log) -> None:
    monkeypatch.setattr(system, "root_prefix", lambda: None)
    monkeypatch.setattr(system.shutil, "which", lambda name: None)
    with pytest.raises(SetupError) as caught:
        system.apply(PLAN, "no driver", log)
    assert caught.value.what == "no driver"
    assert caught.value.hint.splitlines() == [
        "Run these commands as root, then `make setup` again:",
        "    printf '%s\\n' 'deb m bookworm-backports main' | tee /etc/apt/own.list > /dev/null",
        "    apt-get update",
        f"    {PLAN.commands[-1].text()}",
    ]
    assert log.path.read_text() == "", "nothing was run"


def test_where_sudo_asks_for_a_password_the_commands_have_sudo(monkeypatch: pytest.MonkeyPatch, log: Log) -> None:
    monkeypatch.setattr(system, "root_prefix", lambda: None)
    monkeypatch.setattr(system.shutil, "which", lambda name: f"/usr/bin/{name}")
    with pytest.raises(SetupError) as caught:
        system.apply(PLAN, "no driver", log)
    lines = caught.value.hint.splitlines()
    assert "| sudo tee" in lines[1]
    assert lines[2].strip() == "sudo apt-get update"


def test_with_root_the_commands_run_in_order(monkeypatch: pytest.MonkeyPatch, log: Log, tmp_path: Path) -> None:
    monkeypatch.setattr(system, "root_prefix", lambda: ())
    target = tmp_path / "added.list"
    steps = (driver.Command(("tee", str(target)), "deb x\n"), driver.Command(("grep", "deb x", str(target))))
    last = driver.Command(("true", "--no-install-recommends", "libgl1"))
    system.apply(driver.Plan((*steps, last)), "why", log)
    assert target.read_text() == "deb x\n"


def test_a_failing_command_is_named(monkeypatch: pytest.MonkeyPatch, log: Log) -> None:
    monkeypatch.setattr(system, "root_prefix", lambda: ())
    with pytest.raises(SetupError, match="`false --no-install-recommends x` failed"):
        system.apply(driver.Plan((driver.Command(("false", "--no-install-recommends", "x")),)), "why", log)


def test_advice_is_passed_on(log: Log) -> None:
    with pytest.raises(SetupError) as caught:
        system.apply(driver.Plan(advice="buy a GPU"), "no driver", log)
    assert caught.value.hint == "buy a GPU"


def test_a_library_that_nobody_has_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(driver.LIBRARIES, "libno-such-thing.so.7", "libno-such-thing7")
    here = driver.parse_os_release("ID=debian\nVERSION_CODENAME=bookworm\n")
    assert "libno-such-thing7" in system.missing_packages(here)
