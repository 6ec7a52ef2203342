"""The colours of all pictures, in the viewer (dark) and in figures (light): one meaning, one colour."""

from itertools import cycle

Rgb = tuple[int, int, int]

TRIGGER: Rgb = (240, 150, 20)
RESPONDER: Rgb = (45, 135, 240)
ACTION: Rgb = (240, 30, 140)
"""What was done, and what it changed."""

TRUTH: Rgb = (150, 115, 245)
CORRECT: Rgb = (25, 180, 120)
WRONG: Rgb = (225, 50, 55)
MISSED: Rgb = (140, 150, 165)
CLAIMED: Rgb = (85, 95, 205)
"""Relations: as the board has them; inferred and true; inferred but not true; true but not inferred; inferred where
nobody knows the truth."""

CHANCE: Rgb = (20, 165, 185)
CLOCK: Rgb = (120, 130, 150)
LOCK: Rgb = (190, 110, 50)
"""Mechanisms with a luck of their own, hidden clocks, locks; other mechanisms have the truth's colour."""

INK: Rgb = (36, 41, 51)
MUTED: Rgb = (125, 134, 148)
FAINT: Rgb = (222, 226, 232)
PAPER: Rgb = (255, 255, 255)
"""Text, secondary text, hairlines and background of figures."""

TRUE_CURVES: tuple[Rgb, ...] = ((25, 180, 120), (95, 160, 245), (175, 205, 60), (60, 205, 225), (175, 140, 255))
WRONG_CURVES: tuple[Rgb, ...] = ((225, 50, 55), (245, 120, 60), (215, 70, 140), (165, 60, 50))
"""Several relations in one plot: cool colours are true, warm ones are not."""

ROLES = {"trigger": TRIGGER, "responder": RESPONDER}
FACTORS = {"mechanism": TRUTH, "chance": CHANCE, "clock": CLOCK, "lock": LOCK}
VERDICTS = {"correct": CORRECT, "wrong": WRONG, "missed": MISSED, "claimed": CLAIMED}

STATES: tuple[Rgb, ...] = ((96, 110, 130), (245, 195, 66), (90, 190, 170))
"""Discrete state 0, 1, 2 of a trigger or responder."""


def mix(color: Rgb, other: Rgb, share: float) -> Rgb:
    """`share` of `other` in `color`, 0..1."""
    red, green, blue = (round(a + (b - a) * share) for a, b in zip(color, other, strict=True))
    return red, green, blue


def text_on_dark(color: Rgb) -> Rgb:
    """Nearly white with a tinge of the colour: text on the viewer's translucent grey."""
    return mix(color, PAPER, 0.78)


def unit(color: Rgb) -> tuple[float, float, float]:
    """The colour as matplotlib wants it, 0..1."""
    return color[0] / 255, color[1] / 255, color[2] / 255


def curve_colors(truth: list[bool]) -> list[Rgb]:
    """A colour for each relation of a plot, by whether it is true; colours repeat when there are many."""
    rights, wrongs = cycle(TRUE_CURVES), cycle(WRONG_CURVES)
    return [next(rights if true else wrongs) for true in truth]
