"""Fixtures for all tests: the real objects where they are, and the number of skipped tests at the end."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def real_objects(variable: str, folder: str) -> Path | None:
    """The folder that the environment names, else `../shared/FOLDER` beside the repository, else None."""
    named = os.environ.get(variable)
    path = Path(named) if named else ROOT.parent / "shared" / folder
    return path if path.is_dir() else None


@pytest.fixture(scope="session")
def partnet() -> Path:
    """The 58 annotated PartNet-Mobility objects of the paper (folders Switch, Door, Lamp, Toy)."""
    path = real_objects("BUSYBOT_PARTNET_DIR", "partnet-mobility")
    if path is None:
        pytest.skip("the annotated PartNet-Mobility objects are absent; BUSYBOT_PARTNET_DIR can name their folder")
    return path


@pytest.fixture(scope="session")
def partnet_raw() -> Path:
    """PartNet-Mobility objects as downloaded, without annotation (folders named by id)."""
    path = real_objects("BUSYBOT_PARTNET_RAW_DIR", "partnet-mobility-raw")
    if path is None:
        pytest.skip("raw PartNet-Mobility objects are absent; BUSYBOT_PARTNET_RAW_DIR can name their folder")
    return path


@pytest.fixture(scope="session")
def tiny() -> Path:
    """The small frozen dataset of procedural objects in `datasets/tiny`: 12 boards, 13 steps on each."""
    return ROOT / "datasets" / "tiny"


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests leave the user's cache alone: one cache of the test run, shared by all of its tests."""
    base = tmp_path_factory.getbasetemp()
    monkeypatch.setenv("BUSYBOT_CACHE", str(base / "busybot-cache"))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    skipped = terminalreporter.stats.get("skipped", [])
    terminalreporter.write_line(f"skipped tests: {len(skipped)}")
    for reason in sorted({str(report.longrepr[2]) for report in skipped if isinstance(report.longrepr, tuple)}):
        terminalreporter.write_line(f"  {reason}")
