"""Licences of objects: who may pass an object's files on.

What this project generates is known by its hash and goes under the project's licence. The paper's objects and all that
look like downloads from PartNet-Mobility (numeric ids) are never copied. Of others only their owner can tell.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from busybot.objects import cache
from busybot.objects.model import ObjectModel, catalogue

PROCEDURAL = "MIT"
PARTNET = "PartNet-Mobility terms of use (research; not to be redistributed)"
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Licence:
    """An SPDX identifier or words, and whether copies of the object may be given away with a dataset."""

    name: str
    copies: bool


def licences(models: Iterable[ObjectModel], stated: str | None = None) -> dict[str, Licence]:
    """The licence of each object, by key.

    Args:
        stated: of objects that the owner made, an SPDX identifier; it never applies to PartNet-Mobility's.
    """
    wanted = {model.key: model for model in models}
    found = {key: Licence(PARTNET, False) for key, model in wanted.items() if _is_partnet(model)}
    rest = [model for key, model in wanted.items() if key not in found]
    if stated is not None:
        return found | {model.key: Licence(stated, True) for model in rest}
    known = _procedural_hashes() if any(not _in_own_cache(model) for model in rest) else {}
    for model in rest:
        ours = _in_own_cache(model) or known.get(model.key) == model.sha256
        found[model.key] = Licence(PROCEDURAL, True) if ours else Licence(UNKNOWN, False)
    return found


def _is_partnet(model: ObjectModel) -> bool:
    return model.key in catalogue() or model.instance.isdigit()


def _in_own_cache(model: ObjectModel) -> bool:
    """Whether it lies in a procedural library, perhaps of an earlier version, that this project keeps in its cache."""
    library = model.folder.parent.parent
    return library.name.startswith("procedural-") and library.parent.resolve() == cache.cache_folder().resolve()


def _procedural_hashes() -> dict[str, str]:
    from busybot.objects.procedural.build import procedural_library  # builds the library at its first use

    return procedural_library().hashes()
