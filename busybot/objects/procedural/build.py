"""The families of procedural objects with their split; libraries of them, and the default one in the user's cache.

Novel families have shapes that no training family has, in every role: two-state, small-displacement, multi-link and
multi-direction triggers, lamps, doors and toys.

The cached library lies in a folder named by a hash over the generating code and the seed, so a new version of the code
never meets the objects of an old one. It is built beside its place and renamed into it: it is there whole or not at
all, and of two processes that build at once the second one's copy is dropped.
"""

import contextlib
import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np

from busybot.common.atomic_io import make_folder, refuse_taken, remove, remove_abandoned, rename, unfinished, write_json
from busybot.common.errors import BusybotError, explained
from busybot.common.rng import generator
from busybot.objects import cache
from busybot.objects.library import LISTS, OTHER, SPLIT_FILE, Library
from busybot.objects.model import ObjectModel, Split
from busybot.objects.procedural import doors, household, lamps, toys
from busybot.objects.procedural.design import Design
from busybot.objects.procedural.export import write_object
from busybot.objects.procedural.switches import basic, drawn, hinged, levers, pressed, sliding, turning


@dataclass(frozen=True)
class Family:
    """Objects of one kind of shape.

    Attributes:
        split: None for objects of scenes (`boards.scenes`), which other boards never have.
        make: variant number and generator to a design.
        count: variants made by default.
    """

    category: str
    name: str
    split: Split | None
    make: Callable[[int, np.random.Generator], Design]
    count: int

    @property
    def weight(self) -> int:
        """How often `data.json` lists each; multi-direction triggers are rare and needed, as in the paper's list."""
        return 2 if self.name in ("throttle", "joystick", "fader", "gear", "stirrup", "tram") else 1


def _families(category: str, split: Split | None, module: ModuleType, **counts: int) -> list[Family]:
    """Families of a module, whose functions have the families' names, with the numbers of variants."""
    return [Family(category, name, split, getattr(module, name), count) for name, count in counts.items()]


FAMILIES = (
    *_families("Switch", "train", basic, rocker=3, toggle=3, button=2, key=2, slider=2, membrane=2),
    *_families("Switch", "train", pressed, rockers=3, toggles=2, buttons=1),
    *_families("Switch", "train", levers, throttle=2, joystick=1, fader=2),
    *_families("Switch", "train", pressed, cap=7, plunger=6, bell=1, pads=5, bars=2, cushion=2),
    *_families("Switch", "train", turning, wedge=6, saucer=3, tabs=3, wheel=2, trackball=2),
    *_families("Switch", "train", hinged, lid=4, pedal=4, pedals=3, arm=7, bail=3, hood=1),
    *_families("Switch", "train", levers, stick=7, gear=4, blade=2, stirrup=3, levers=3),
    *_families("Switch", "train", sliding, thumb=7, tram=3, channel=3, beads=3, faders=3, drawer=2, shutter=2, strap=3),
    *_families("Switch", "train", turning, dial=3, boom=3, tap=2),
    *_families("Switch", "novel", basic, paddle=2, knife=2, mushroom=2, bolt=2),
    *_families("Switch", "novel", pressed, dip=2, keys=2),
    *_families("Switch", "novel", levers, tbar=1, rails=2),
    *_families("Switch", "novel", hinged, seesaw=2, clam=1, crank=2, honeycomb=1, boat=2),
    *_families("Lamp", "train", lamps, cone=2, globe=1, pyramid=1, desk=1, tube=1, drum=1, halo=1, bulb=1, trio=1),
    *_families("Lamp", "train", lamps, crystal=1, lamppost=1),
    *_families("Lamp", "novel", lamps, lantern=1, tulip=1, star=1, cactus=1, cloud=1),
    *_families("Door", "train", doors, panelled=2, glazed=1, planked=1, louvred=1, flush=1),
    *_families("Door", "train", doors, carved=3, safe=1, barred=2, lights=2, fridge=1, grooved=2),
    *_families("Door", "novel", doors, arched=1, porthole=1, lattice=1, hatch=1, paper=1, saloon=1),
    *_families("Toy", "train", toys, bead=1, loco=1, car=1, duck=1),
    *_families("Toy", "novel", toys, ladybird=1, rocket=1),
    *_families("Switch", None, household, stoveknob=3),
    *_families("Lamp", None, household, burner=4),
    *_families("Door", None, household, pot=4, kettle=2, fan=2),
)


DEFAULT_SEED = 0


def make_library(folder: Path, seed: int = DEFAULT_SEED, new: int = 0) -> list[str]:
    """Make all procedural objects in a new or empty folder; they are there all or not at all.

    Args:
        new: the novel switches are so many whose shapes the seed draws (`switches.drawn`), in place of those that
            models may have been chosen by.

    Returns:
        The objects' keys.

    Raises:
        BusybotError: the folder has something in it.
    """
    place = folder.absolute()
    refuse_taken(place)
    make_folder(place.parent)
    remove_abandoned(place.parent, place.name)
    with unfinished(place.parent, place.name) as made:
        keys = _make(made, seed, families_with(new))
        rename(made, place)
    return keys


def families_with(new: int) -> list[Family]:
    """All families, the novel switches among them replaced by so many drawn ones, if by any."""
    if not new:
        return list(FAMILIES)
    kept = [family for family in FAMILIES if (family.category, family.split) != ("Switch", "novel")]
    return [*kept, Family("Switch", "drawn", "novel", drawn.drawn, new)]


def _make(folder: Path, seed: int, families: Sequence[Family]) -> list[str]:
    keys, splits = [], dict[str, dict[str, list[str]]]()
    for family in families:
        lists = splits.setdefault(family.category, {"train": [], "test": []})
        for variant in range(family.count):
            instance = f"{family.name}-{variant + 1:02d}"
            rng = generator(seed, "procedural", variant, f"{family.category}/{family.name}")
            design = replace(family.make(variant, rng), name=f"{family.category}_{instance}")
            write_object(design, folder / family.category / instance)
            lists.setdefault(LISTS[family.split or OTHER], []).extend([instance] * family.weight)
            keys.append(f"{family.category}/{instance}")
    write_json(folder / SPLIT_FILE, {"Reason": splits})
    return keys


def procedural_library(known: dict[str, ObjectModel] | None = None) -> Library:
    """The procedural library from the user's cache, made there first if it is absent or damaged.

    Args:
        known: objects that need not be parsed again, see `objects.partnet.loader.load_object`.
    """
    place = cache.cache_folder() / f"procedural-{_code_hash()}"
    if place.is_dir():
        try:
            return _named(Library.load(place, known))
        except BusybotError:
            with contextlib.suppress(OSError):
                remove(place)
    _build_into(place)
    return _named(Library.load(place, known))


def _named(library: Library) -> Library:
    return replace(library, name="procedural")


def _build_into(place: Path) -> None:
    try:
        make_folder(place.parent)
        remove_abandoned(place.parent, "procedural")
        with unfinished(place.parent, "procedural") as made:
            _make(made, DEFAULT_SEED, FAMILIES)
            try:
                rename(made, place)
            except OSError:
                if not place.is_dir():  # nobody else was faster
                    raise
    except OSError as error:
        raise BusybotError(explained(error).what, "set BUSYBOT_CACHE to a folder that can be written") from None


def _code_hash() -> str:
    """Names the library that this code makes from its seed."""
    digest = hashlib.sha256(str(DEFAULT_SEED).encode())
    folder = Path(__file__).parent
    for source in sorted(folder.rglob("*.py")):  # subfolders, too: a change anywhere makes the library anew
        digest.update(source.relative_to(folder).as_posix().encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()[:16]
