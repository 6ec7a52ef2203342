"""One procedural library for all tests of objects."""

from pathlib import Path

import pytest

from busybot.objects.resolve import find


@pytest.fixture(scope="session")
def procedural() -> Path:
    """A folder with the default procedural library; tests that change something copy from it."""
    return find("procedural").folder
