"""Versions of packages that are told beside what they made."""

from importlib.metadata import PackageNotFoundError

import pytest

from busybot.common import installed
from busybot.common.errors import BusybotError


def test_opencv_may_have_another_packages_name(monkeypatch: pytest.MonkeyPatch) -> None:
    known = {"numpy": "2", "opencv-python-headless": "5.1"}

    def version(name: str) -> str:
        if name not in known:
            raise PackageNotFoundError(name)
        return known[name]

    monkeypatch.setattr(installed, "version", version)
    assert [installed.installed_version(name) for name in ("numpy", "opencv-python")] == ["2", "5.1"]
    with pytest.raises(BusybotError, match="sapien is not installed"):
        installed.installed_version("sapien")
