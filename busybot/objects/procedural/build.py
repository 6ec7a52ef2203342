"""Making a library of procedural objects, and keeping the default one in the user's cache.

The cached library lies in a folder named by a hash over the generating code and the seed, so a new version of the code
never meets the objects of an old one. It is built beside its place and renamed into it: it is there whole or not at
all, and of two processes that build at once the second one's copy is dropped.

The families of procedural objects, how many of each there are, and their split.

Novel families have shapes that no training family has, in every role: two-state, small-displacement, multi-link and
multi-direction triggers, lamps, doors and toys.
"""

import contextlib
import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from busybot.common.atomic_io import make_folder, remove, remove_abandoned, rename, unfinished, write_json
from busybot.common.errors import BusybotError
from busybot.common.rng import generator
from busybot.objects import cache
from busybot.objects.library import SPLIT_FILE, Library
from busybot.objects.procedural import doors, lamps, toys
from busybot.objects.procedural import doors as gates
from busybot.objects.procedural import lamps as lights
from busybot.objects.procedural.design import Design
from busybot.objects.procedural.export import write_object
from busybot.objects.procedural.switches import basic as switches
from busybot.objects.procedural.switches import hinged as flaps
from busybot.objects.procedural.switches import levers
from busybot.objects.procedural.switches import levers as sticks
from busybot.objects.procedural.switches import novel as novelties
from busybot.objects.procedural.switches import pressed as panels
from busybot.objects.procedural.switches import pressed as presses
from busybot.objects.procedural.switches import sliding as slides
from busybot.objects.procedural.switches import turning as tilts
from busybot.objects.procedural.switches import turning as turns


@dataclass(frozen=True)
class Family:
    """Objects of one kind of shape.

    Attributes:
        make: variant number and generator to a design.
        count: variants made by default.
        weight: how often `data.json` lists each; multi-direction triggers are rare and needed, as in the paper's list.
    """

    category: str
    name: str
    split: Literal["train", "novel"]
    make: Callable[[int, np.random.Generator], Design]
    count: int
    weight: int = 1


FAMILIES = (
    Family("Switch", "rocker", "train", switches.rocker, 3),
    Family("Switch", "toggle", "train", switches.toggle, 3),
    Family("Switch", "button", "train", switches.button, 2),
    Family("Switch", "key", "train", switches.key_cap, 2),
    Family("Switch", "slider", "train", switches.slider, 2),
    Family("Switch", "membrane", "train", switches.membrane, 2),
    Family("Switch", "rockers", "train", panels.rockers, 3),
    Family("Switch", "toggles", "train", panels.toggles, 2),
    Family("Switch", "buttons", "train", panels.buttons, 1),
    Family("Switch", "throttle", "train", levers.throttle, 2, 2),
    Family("Switch", "joystick", "train", levers.joystick, 1, 2),
    Family("Switch", "fader", "train", levers.fader, 2, 2),
    Family("Switch", "cap", "train", presses.cap_switch, 7),
    Family("Switch", "plunger", "train", presses.plunger, 6),
    Family("Switch", "bell", "train", presses.bell, 1),
    Family("Switch", "pads", "train", presses.pads, 5),
    Family("Switch", "bars", "train", presses.bars, 2),
    Family("Switch", "cushion", "train", presses.cushion, 2),
    Family("Switch", "wedge", "train", tilts.wedge, 6),
    Family("Switch", "saucer", "train", tilts.saucer, 3),
    Family("Switch", "tabs", "train", tilts.tabs, 3),
    Family("Switch", "wheel", "train", tilts.wheel, 2),
    Family("Switch", "trackball", "train", tilts.trackball, 2),
    Family("Switch", "lid", "train", flaps.lid, 4),
    Family("Switch", "pedal", "train", flaps.pedal, 4),
    Family("Switch", "pedals", "train", flaps.pedals, 3),
    Family("Switch", "arm", "train", flaps.arm, 7),
    Family("Switch", "bail", "train", flaps.bail, 3),
    Family("Switch", "hood", "train", flaps.hood, 1),
    Family("Switch", "stick", "train", sticks.stick, 7),
    Family("Switch", "gear", "train", sticks.gear, 4, 2),
    Family("Switch", "blade", "train", sticks.blade, 2),
    Family("Switch", "stirrup", "train", sticks.stirrup, 3, 2),
    Family("Switch", "levers", "train", sticks.levers, 3),
    Family("Switch", "thumb", "train", slides.thumb, 7),
    Family("Switch", "tram", "train", slides.tram, 3, 2),
    Family("Switch", "channel", "train", slides.channel, 3),
    Family("Switch", "beads", "train", slides.beads, 3),
    Family("Switch", "faders", "train", slides.faders, 3),
    Family("Switch", "drawer", "train", slides.drawer, 2),
    Family("Switch", "shutter", "train", slides.shutter, 2),
    Family("Switch", "strap", "train", slides.strap, 3),
    Family("Switch", "dial", "train", turns.dial, 3),
    Family("Switch", "boom", "train", turns.boom, 3),
    Family("Switch", "tap", "train", turns.tap, 2),
    Family("Switch", "paddle", "novel", switches.paddle, 2),
    Family("Switch", "knife", "novel", switches.knife, 2),
    Family("Switch", "mushroom", "novel", switches.mushroom, 2),
    Family("Switch", "bolt", "novel", switches.bolt, 2),
    Family("Switch", "dip", "novel", panels.dip, 2),
    Family("Switch", "keys", "novel", panels.keys, 2),
    Family("Switch", "tbar", "novel", levers.t_bar, 1),
    Family("Switch", "rails", "novel", levers.rails, 2),
    Family("Switch", "seesaw", "novel", novelties.seesaw, 2),
    Family("Switch", "clam", "novel", novelties.clam, 1),
    Family("Switch", "crank", "novel", novelties.crank, 2),
    Family("Switch", "honeycomb", "novel", novelties.honeycomb, 1),
    Family("Switch", "boat", "novel", novelties.boat, 2),
    Family("Lamp", "cone", "train", lamps.cone, 2),
    Family("Lamp", "globe", "train", lamps.globe, 1),
    Family("Lamp", "pyramid", "train", lamps.pyramid, 1),
    Family("Lamp", "desk", "train", lamps.desk, 1),
    Family("Lamp", "tube", "train", lamps.tube_light, 1),
    Family("Lamp", "drum", "train", lights.drum, 1),
    Family("Lamp", "halo", "train", lights.halo, 1),
    Family("Lamp", "bulb", "train", lights.bulb, 1),
    Family("Lamp", "trio", "train", lights.trio, 1),
    Family("Lamp", "crystal", "train", lights.crystal, 1),
    Family("Lamp", "lamppost", "train", lights.lamppost, 1),
    Family("Lamp", "lantern", "novel", lamps.lantern, 1),
    Family("Lamp", "tulip", "novel", lamps.tulip, 1),
    Family("Lamp", "star", "novel", lamps.star_light, 1),
    Family("Lamp", "cactus", "novel", lights.cactus, 1),
    Family("Lamp", "cloud", "novel", lights.cloud, 1),
    Family("Door", "panelled", "train", doors.panelled, 2),
    Family("Door", "glazed", "train", doors.glazed, 1),
    Family("Door", "planked", "train", doors.planked, 1),
    Family("Door", "louvred", "train", doors.louvred, 1),
    Family("Door", "flush", "train", doors.flush, 1),
    Family("Door", "carved", "train", gates.carved, 3),
    Family("Door", "safe", "train", gates.safe, 1),
    Family("Door", "barred", "train", gates.barred, 2),
    Family("Door", "lights", "train", gates.lights, 2),
    Family("Door", "fridge", "train", gates.fridge, 1),
    Family("Door", "grooved", "train", gates.grooved, 2),
    Family("Door", "arched", "novel", doors.arched, 1),
    Family("Door", "porthole", "novel", doors.porthole, 1),
    Family("Door", "lattice", "novel", doors.lattice, 1),
    Family("Door", "hatch", "novel", doors.hatch, 1),
    Family("Door", "paper", "novel", gates.paper, 1),
    Family("Door", "saloon", "novel", gates.saloon, 1),
    Family("Toy", "bead", "train", toys.bead, 1),
    Family("Toy", "loco", "train", toys.loco, 1),
    Family("Toy", "car", "train", toys.car, 1),
    Family("Toy", "duck", "train", toys.duck, 1),
    Family("Toy", "ladybird", "novel", toys.ladybird, 1),
    Family("Toy", "rocket", "novel", toys.rocket, 1),
)


DEFAULT_SEED = 0


def make_library(folder: Path, seed: int = DEFAULT_SEED) -> list[str]:
    """Make all procedural objects in a new or empty folder.

    Returns:
        The objects' keys.

    Raises:
        BusybotError: the folder has something in it, or cannot be written.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BusybotError(f"{folder}: is not an empty folder", "name a new folder, or remove what is in it")
    keys, splits = [], dict[str, dict[str, list[str]]]()
    try:
        for family in FAMILIES:
            lists = splits.setdefault(family.category, {"train": [], "test": []})
            for variant in range(family.count):
                instance = f"{family.name}-{variant + 1:02d}"
                rng = generator(seed, "procedural", variant, f"{family.category}/{family.name}")
                design = replace(family.make(variant, rng), name=f"{family.category}_{instance}")
                write_object(design, folder / family.category / instance)
                lists["train" if family.split == "train" else "test"] += [instance] * family.weight
                keys.append(f"{family.category}/{instance}")
        write_json(folder / SPLIT_FILE, {"Reason": splits})
    except OSError as error:
        raise BusybotError(f"{folder}: cannot be written: {error.strerror}", "choose another folder") from None
    return keys


def procedural_library() -> Library:
    """The procedural library from the user's cache, made there first if it is absent or damaged."""
    place = cache.cache_folder() / f"procedural-{_code_hash()}"
    if place.is_dir():
        try:
            return _named(Library.load(place))
        except BusybotError:
            with contextlib.suppress(OSError):
                remove(place)
    _build_into(place)
    return _named(Library.load(place))


def _named(library: Library) -> Library:
    return replace(library, name="procedural")


def _build_into(place: Path) -> None:
    try:
        make_folder(place.parent)
        remove_abandoned(place.parent, "procedural")
        with unfinished(place.parent, "procedural") as made:
            make_library(made)
            try:
                rename(made, place)
            except OSError:
                if not place.is_dir():  # nobody else was faster
                    raise
    except OSError as error:
        raise BusybotError(
            f"{place}: cannot be written: {error.strerror}", "set BUSYBOT_CACHE to a folder that can be written"
        ) from None


def _code_hash() -> str:
    """Names the library that this code makes from its seed."""
    digest = hashlib.sha256(str(DEFAULT_SEED).encode())
    folder = Path(__file__).parent
    for source in sorted(folder.rglob("*.py")):  # subfolders, too: a change anywhere makes the library anew
        digest.update(source.relative_to(folder).as_posix().encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()[:16]
