"""Which procedural objects there are: families, how many of each, and their split.

Novel families have shapes that no training family has, in every role: two-state, small-displacement, multi-link and
multi-direction triggers, lamps, doors and toys.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from busybot.objects.procedural import doors, lamps, levers, panels, switches, toys
from busybot.objects.procedural.design import Design


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
    Family("Switch", "rocker", "train", switches.rocker, 4),
    Family("Switch", "toggle", "train", switches.toggle, 4),
    Family("Switch", "button", "train", switches.button, 4),
    Family("Switch", "key", "train", switches.key_cap, 2),
    Family("Switch", "slider", "train", switches.slider, 3),
    Family("Switch", "membrane", "train", switches.membrane, 2),
    Family("Switch", "rockers", "train", panels.rockers, 3),
    Family("Switch", "toggles", "train", panels.toggles, 2),
    Family("Switch", "buttons", "train", panels.buttons, 1),
    Family("Switch", "throttle", "train", levers.throttle, 2, 2),
    Family("Switch", "joystick", "train", levers.joystick, 1, 2),
    Family("Switch", "fader", "train", levers.fader, 3, 2),
    Family("Switch", "paddle", "novel", switches.paddle, 2),
    Family("Switch", "knife", "novel", switches.knife, 2),
    Family("Switch", "mushroom", "novel", switches.mushroom, 1),
    Family("Switch", "bolt", "novel", switches.bolt, 1),
    Family("Switch", "dip", "novel", panels.dip, 1),
    Family("Switch", "keys", "novel", panels.keys, 1),
    Family("Switch", "tbar", "novel", levers.t_bar, 1),
    Family("Switch", "rails", "novel", levers.rails, 1),
    Family("Lamp", "cone", "train", lamps.cone, 2),
    Family("Lamp", "globe", "train", lamps.globe, 1),
    Family("Lamp", "pyramid", "train", lamps.pyramid, 1),
    Family("Lamp", "desk", "train", lamps.desk, 1),
    Family("Lamp", "tube", "train", lamps.tube_light, 1),
    Family("Lamp", "lantern", "novel", lamps.lantern, 1),
    Family("Lamp", "tulip", "novel", lamps.tulip, 1),
    Family("Lamp", "star", "novel", lamps.star_light, 1),
    Family("Door", "panelled", "train", doors.panelled, 2),
    Family("Door", "glazed", "train", doors.glazed, 1),
    Family("Door", "planked", "train", doors.planked, 1),
    Family("Door", "louvred", "train", doors.louvred, 1),
    Family("Door", "flush", "train", doors.flush, 1),
    Family("Door", "arched", "novel", doors.arched, 1),
    Family("Door", "porthole", "novel", doors.porthole, 1),
    Family("Door", "lattice", "novel", doors.lattice, 1),
    Family("Door", "hatch", "novel", doors.hatch, 1),
    Family("Toy", "bead", "train", toys.bead, 1),
    Family("Toy", "loco", "train", toys.loco, 1),
    Family("Toy", "ladybird", "novel", toys.ladybird, 1),
)
