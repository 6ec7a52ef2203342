"""The packaged catalogue says of the paper's objects what the shared annotation says."""

import json
from collections import Counter
from pathlib import Path

from busybot.objects.library import Library
from busybot.objects.model import CATEGORIES, catalogue, kinds


def test_the_papers_numbers() -> None:
    entries = catalogue().values()
    counted = Counter((entry.category, entry.split) for entry in entries)
    assert [(counted[c, "train"], counted[c, "novel"]) for c in CATEGORIES] == [(32, 9), (3, 2), (5, 5), (1, 1)]
    assert sum(entry.role == "trigger" for entry in entries) == 41
    links = [kind for entry in entries if entry.role == "trigger" for kind in entry.kinds]
    assert Counter(links) == {"two-state": 53, "multi-direction": 5}


def test_agrees_with_the_annotated_objects(partnet: Path) -> None:
    library = Library.load(partnet)
    assert set(library.objects) == set(catalogue())
    listed = json.loads((partnet / "data.json").read_text())["Reason"]
    for key, entry in catalogue().items():
        model = library.get(key)
        assert (entry.role, entry.kinds) == (model.role, kinds(model))
        assert (
            listed[entry.category]["train" if entry.split == "train" else "test"].count(entry.instance) == entry.weight
        )
