"""One procedural library for all tests of objects."""

from pathlib import Path

import pytest

from busybot.objects.procedural.build import make_library


@pytest.fixture(scope="session")
def procedural(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the default procedural library; tests that change something copy from it."""
    folder = tmp_path_factory.mktemp("objects") / "library"
    make_library(folder)
    return folder
