"""What packages bring by entry points is found by its name, and blamed by it."""

from importlib.metadata import Distribution, EntryPoint
from pathlib import Path

import numpy as np
import pytest

from busybot.common import plugins
from busybot.common.errors import BusybotError
from busybot.evaluation.results import of_this_code, package_versions
from busybot.objects.resolve import find
from busybot.plan.agents.registry import kind_of
from busybot.reason.encoders.registry import make_extractor
from busybot.reason.inputs.sequence import threshold_of
from busybot.reason.models.registry import config_class, reasoner_of

HERE = "tests.common.test_plugins"


class Zeros:
    """An encoder."""

    key, threshold = "1", 0.25

    def encode(self, looks: list) -> np.ndarray:
        return np.zeros((len(looks), 256), np.float32)


class Silent:
    """A reasoner, and an agent of it."""

    name, encoder = "silent", "zeros"

    def __init__(self, reasoner: object = None):
        self.reasoner = reasoner


def nowhere() -> Path:
    """A library that is not there."""
    return Path("/nonexistent")


def broken() -> None:
    raise ValueError("no luck")


def point(kind: str, name: str, value: str) -> EntryPoint:
    return EntryPoint(name, f"{HERE}:{value}", f"busybot.{kind}")


def test_each_kind_is_known_by_its_name(registered: list[EntryPoint]) -> None:
    registered += [point("encoders", "zeros", "Zeros"), point("reasoners", "silent", "Silent")]
    registered += [point("agents", "silent", "Silent"), point("objects", "nowhere", "nowhere")]
    assert make_extractor("zeros-box").pixels == "box" and threshold_of("zeros-box") == 0.25
    reasoner = reasoner_of("silent", config_class("silent")())
    make = kind_of("silent").make
    assert reasoner.name == "silent" and make is not None and make(reasoner).reasoner is reasoner  # type: ignore
    with pytest.raises(BusybotError, match="/nonexistent"):
        find("nowhere")


def test_names_of_our_own_stay_ours(registered: list[EntryPoint]) -> None:
    registered += [point("reasoners", "lookup", "Silent"), point("encoders", "random", "Zeros")]
    registered += [point("agents", "noop", "broken")]
    assert reasoner_of("lookup").name == "lookup" and kind_of("noop").make is not None
    assert not isinstance(make_extractor("random").encoder, Zeros)


def test_whoever_fails_is_named(registered: list[EntryPoint]) -> None:
    registered += [point("reasoners", "broken", "broken"), point("reasoners", "absent", "absent")]
    registered += [point("reasoners", "twice", "Silent"), point("reasoners", "twice", "Zeros")]
    for name, told in (
        ("broken", "test_plugins:broken' of the group busybot.reasoners cannot be made: ValueError: no luck"),
        ("absent", "test_plugins:absent' of the group busybot.reasoners cannot be loaded"),
        ("twice", "has the same name 'twice'"),
    ):
        with pytest.raises(BusybotError, match=told) as error:
            reasoner_of(name)
        assert error.value.hint
    assert plugins.names("reasoners") == ["absent", "broken", "twice"]


def test_an_installed_package_is_named(registered: list[EntryPoint], tmp_path: Path) -> None:
    folder = tmp_path / "strangers_switches-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: strangers-switches\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("[busybot.reasoners]\nabsent = no_such_module:Absent\n")
    registered += Distribution.at(folder).entry_points
    with pytest.raises(BusybotError, match=r"cannot be loaded") as error:
        reasoner_of("absent")
    assert "(package strangers-switches)" in error.value.what


def test_versions_tell_which_code_packages_brought(
    registered: list[EntryPoint], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever module of a package changes: evaluations that others' code began are not continued."""
    (tmp_path / "stranger").mkdir()
    for name in ("stranger/__init__.py", "stranger/inner.py", "alone_of_stranger.py"):
        (tmp_path / name).write_text("")
    folder = tmp_path / "stranger-2.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 2.0\n")
    agents = "[busybot.agents]\na = stranger.inner:A\nb = alone_of_stranger:B\n"
    (folder / "entry_points.txt").write_text(f"{agents}[busybot.reasoners]\nc = not_there:C\nd = no-name:D\n")
    registered += Distribution.at(folder).entry_points
    monkeypatch.syspath_prepend(tmp_path)
    told = []
    for name in ("stranger/inner.py", "alone_of_stranger.py", "stranger/weights.bin"):
        (tmp_path / name).write_text("changed = True")
        plugins.packages.cache_clear()
        told.append(package_versions())
    assert len({one["stranger"] for one in told}) == 3 and told[0]["stranger"].startswith("2.0, ")
    assert [of_this_code({"versions": one}) for one in told] == [False, False, True]
