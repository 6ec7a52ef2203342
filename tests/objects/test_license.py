"""Whose objects may be given away."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from busybot.objects.library import Library
from busybot.objects.license import PARTNET, licences
from busybot.objects.resolve import find


@pytest.mark.long
def test_generated_objects_are_known_by_their_hashes(few_objects: Callable[[int], Path]) -> None:
    for library in (find("procedural"), Library.load(few_objects(0))):
        found = licences(library.objects.values())
        assert set(found) == set(library.objects)
        assert {(licence.name, licence.copies) for licence in found.values()} == {("MIT", True)}
    changed = replace(next(iter(library.objects.values())), sha256="0" * 64)
    assert not licences([changed])[changed.key].copies
    assert licences([changed], "CC0-1.0")[changed.key].copies


def test_partnet_objects_may_never_be_copied_whatever_is_stated(partnet: Path) -> None:
    models = Library.load(partnet).objects.values()
    for stated in (None, "MIT"):
        found = licences(models, stated)
        assert {(licence.name, licence.copies) for licence in found.values()} == {(PARTNET, False)}
    raw = replace(next(iter(models)), instance="999999")
    assert not licences([raw], "MIT")[raw.key].copies, "a numeric id looks like a download"
