"""The 58 objects of the paper, as facts without meshes: category, role, kinds, split and sampling weight.

The split is the authors' `Reason` split, which the protocol uses for all skills; repeated ids in their lists are the
weights.
"""

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Literal

from busybot.objects.model import ObjectModel, Role

Split = Literal["train", "novel"]
SPLITS: tuple[Split, ...] = ("train", "novel")


@dataclass(frozen=True)
class CatalogueEntry:
    """One object of the paper.

    Attributes:
        kinds: of a trigger one per movable link (`two-state`, `multi-direction`); of a responder the stages that it can
            take (`single-stage`, `multi-stage`).
        split: `train` or `novel`.
        weight: how many times the authors list it.
    """

    category: str
    instance: str
    role: Role
    kinds: tuple[str, ...]
    split: Split
    weight: int

    @property
    def key(self) -> str:
        return f"{self.category}/{self.instance}"


@cache
def catalogue() -> dict[str, CatalogueEntry]:
    """The paper's 58 objects by `Category/instance`."""
    text = resources.files("busybot.objects").joinpath("catalogue.json").read_text(encoding="utf-8")
    entries = (CatalogueEntry(**{**row, "kinds": tuple(row["kinds"])}) for row in json.loads(text)["objects"])
    return {entry.key: entry for entry in entries}


def kinds(model: ObjectModel) -> tuple[str, ...]:
    """What `CatalogueEntry.kinds` says, for any object."""
    if model.effect is None:
        return tuple(link.kind for link in model.trigger_links)
    stages = (("single-stage", model.effect.single), ("multi-stage", model.effect.multi))
    return tuple(name for name, values in stages if values is not None)
