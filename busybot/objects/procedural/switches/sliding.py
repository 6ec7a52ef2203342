"""Training switches that slide: grips in grooves, carriages on beams, blocks between walls, beads, drawers, bars."""

import numpy as np

from busybot.objects.procedural import cad, fixtures, palette
from busybot.objects.procedural.design import SLIDE_X, Design, MovingLink, Part, shifted, switch
from busybot.objects.procedural.fixtures import clutter, corners, ground, row, slid
from busybot.objects.procedural.grips import GRIPS, grip, lying, rod
from busybot.objects.procedural.palette import pick


def thumb(variant: int, rng: np.random.Generator) -> Design:
    """One grip in a groove; grips, bases, sizes and directions go through all there are."""
    size, travel = (0.036, 0.028, 0.048, 0.032)[variant % 4], (0.10, 0.15, 0.08, 0.19, 0.12)[variant % 5]
    width, height = travel + 2 * size + 0.11, (0.17, 0.22, 0.26)[variant % 3]
    base = ground(width, height, variant + 2, rng)
    metal = pick(rng, (*palette.METALS, palette.BLACK), unlike=base.cover)
    groove = fixtures.slot(travel + 2.2 * size, (0.6 + 0.3 * (variant % 3)) * size, metal, 0.01)
    body = [*base.parts, *shifted(groove, (0, 0, base.top - 0.001))]
    body += clutter(base, corners(width, height), rng) if variant % 5 != 2 else []
    color = pick(rng, (*palette.ACCENTS, palette.WHITE, palette.BLACK), unlike=base.cover)
    parts = grip(GRIPS[variant % len(GRIPS)], size, color, metal)
    link = slid(parts, (0, 0, base.top + 0.011), travel, "large" if travel > 0.16 else "small")
    return switch(body, [link], SLIDE_X, variant + variant // 4)


def tram(variant: int, rng: np.random.Generator) -> Design:
    """A carriage that rides on one raised beam between buffers."""
    travel, span = (0.20, 0.13, 0.24)[variant % 3], (0.36, 0.30, 0.40)[variant % 3]
    base = ground(span + 0.06, (0.18, 0.15, 0.21)[variant % 3], (0, 1, 2)[variant % 3], rng)
    beam = (
        cad.box(span, 0.05, 0.035, 0.006),
        cad.box(span, 0.03, 0.05, 0.006),
        lying(0.022, span).turned("z", np.pi / 2),
    )
    lift = (0.0, 0.0, 0.028)[variant % 3]
    metal = pick(rng, palette.METALS, unlike=base.cover)
    body = [*base.parts, Part(beam[variant % 3].moved(z=base.top - 0.001 + lift), metal)]
    wood = pick(rng, palette.WOODS, unlike=base.cover)
    for x in (-span / 2, span / 2):
        body.append(Part(cad.box(0.026, 0.10, 0.065, 0.008).moved(x, 0, base.top - 0.001), wood))
    color = pick(rng, palette.ACCENTS, unlike=base.cover)
    high = (0.036, 0.05, 0.05)[variant % 3]
    parts = [Part(cad.box(0.085, (0.10, 0.075, 0.12)[variant % 3], 0.03, 0.009).moved(z=high - 0.008), color)]
    parts += [Part(cad.box(0.085, 0.016, high + 0.01, 0.004).moved(0, s * 0.04, 0.003), color) for s in (-1, 1)]
    parts += _tram_top(variant, high + 0.02)
    link = slid(parts, (0, 0, base.top), travel, "small" if variant % 3 == 1 else "large")
    return switch(body, [link], SLIDE_X, variant + variant // 3)


def _tram_top(variant: int, z: float) -> list[Part]:
    """A short post with a disc, a low handle across, or two grooves to feel."""
    if variant % 3 == 0:
        post = cad.lathe([(0.016, 0), (0.014, 0.03), (0.032, 0.034), (0.032, 0.048), (0.026, 0.052), (0, 0.052)], 20)
        return [Part(post.moved(z=z), palette.IVORY)]
    if variant % 3 == 1:
        path = [(0.0, -0.03, 0.0), (0.0, -0.03, 0.035), (0.0, 0.03, 0.035), (0.0, 0.03, 0.0)]
        return [Part(cad.pipe(cad.bent(path, 0.015), 0.009, 10).moved(z=z), palette.IRON)]
    return [Part(cad.box(0.008, 0.08, 0.003).moved(x, 0, z - 0.0005), palette.SHADOW) for x in (-0.016, 0.016)]


def channel(variant: int, rng: np.random.Generator) -> Design:
    """A block that slides between two walls, guided from the sides."""
    travel, block = (0.14, 0.20, 0.10)[variant % 3], (0.08, 0.10, 0.12)[variant % 3]
    inner, wall = (0.11, 0.07, 0.14)[variant % 3], (0.035, 0.05, 0.028)[variant % 3]
    span = travel + block + 0.03
    base = ground(span + 0.06, inner + 0.12, (0, 1, 2)[variant % 3], rng, palette.WOODS)
    color = pick(rng, (*palette.ACCENTS, palette.WHITE), unlike=base.cover)
    rails = pick(rng, (*palette.WOODS, palette.GRAPHITE, palette.NAVY), unlike=base.cover)
    body = [*base.parts, Part(cad.box(span, inner, 0.003).moved(z=base.top - 0.001), palette.SHADOW)]
    rail = cad.box(span + 0.02, 0.026, wall, 0.006)
    body += [Part(rail.moved(0, s * (inner / 2 + 0.014), base.top - 0.001), rails) for s in (-1, 1)]
    high = wall + (0.02, -0.012, 0.035)[variant % 3]
    parts = [Part(cad.box(block, inner - 0.012, high, 0.010), color)]
    marks = (cad.circle(0.02, 20), cad.rectangle(0.014, inner - 0.035, 0.004), cad.rectangle(0.04, 0.04, 0.008))
    parts.append(Part(cad.prism(marks[variant % 3], high - 0.002, high + 0.006, bevel=0.002), palette.IVORY))
    link = slid(parts, (0, 0, base.top + 0.003), travel, "large" if variant % 3 == 1 else "small")
    return switch(body, [link], SLIDE_X, variant)


def beads(variant: int, rng: np.random.Generator) -> Design:
    """1 to 3 big beads, each on a rod of its own between posts, like an abacus."""
    count, span, travel = (2, 1, 3)[variant % 3], (0.34, 0.38, 0.30)[variant % 3], (0.17, 0.20, 0.14)[variant % 3]
    radius, pitch = (0.042, 0.055, 0.036)[variant % 3], (0.12, 0.15, 0.10)[variant % 3]
    across = pitch * count + 0.05
    wood = pick(rng, palette.WOODS)
    base = ground(span + 0.07, across + 0.02, (0, 2, 1)[variant % 3], rng)
    z = base.top + radius + 0.014
    end = cad.box(0.028, across, z - base.top + 0.024, 0.008)
    ends = [Part(end.moved(s * span / 2, 0, base.top - 0.001), wood) for s in (-1, 1)]
    body, links = [*base.parts, *ends], []
    for k, y in enumerate(row(count, pitch)):
        body.append(Part(rod((-span / 2, y, z), (span / 2, y, z), 0.010), palette.CHROME))
        color = palette.ACCENTS[(2 * k + 3 * variant) % len(palette.ACCENTS)]
        bead = cad.ball(radius, 22, 12).stretched(x=(1.0, 1.35, 0.8)[variant % 3])
        band = cad.torus(radius, 0.006, 22, 6).turned("y", np.pi / 2)
        links.append(slid([Part(bead, color), Part(band, palette.IVORY)], (0, y, z), travel))
    return switch(body, links, SLIDE_X, variant)


def faders(variant: int, rng: np.random.Generator) -> Design:
    """2 to 4 narrow grips in parallel grooves."""
    count, pitch = (3, 2, 4)[variant % 3], (0.095, 0.13, 0.085)[variant % 3]
    travel, size = (0.13, 0.10, 0.15)[variant % 3], (0.030, 0.036, 0.027)[variant % 3]
    across = pitch * count + 0.06
    base = ground(travel + 0.15, across, (0, 3, 1)[variant % 3], rng)
    body, links = list(base.parts), []
    metal = pick(rng, (palette.STEEL, palette.BLACK, palette.BRASS), unlike=base.cover)
    for k, y in enumerate(row(count, pitch)):
        body += shifted(fixtures.slot(travel + 2.2 * size, 0.018, metal, 0.007), (0, y, base.top - 0.001))
        color = palette.ACCENTS[(3 * k + variant) % len(palette.ACCENTS)]
        parts = grip(("saddle", "fin", "barrel")[variant % 3], size, color, metal)
        links.append(slid(parts, (0, y, base.top + 0.010), travel))
    return switch(body, links, SLIDE_X, variant + 1)


def drawer(variant: int, rng: np.random.Generator) -> Design:
    """A drawer in a chest, drawn out by its knob."""
    length, width, tall = (0.16, 0.13)[variant % 2], (0.20, 0.14)[variant % 2], (0.085, 0.11)[variant % 2]
    travel = (0.11, 0.09)[variant % 2]
    wood = pick(rng, palette.WOODS)
    foot = cad.prism(cad.rectangle(length + travel + 0.10, width + 0.08, 0.012), 0, 0.022, bevel=0.007)
    x = -travel / 2 - 0.01
    body = [Part(foot, pick(rng, (palette.SAGE, palette.NAVY, palette.IVORY, palette.BLUSH)))]
    body.append(Part(cad.box(length, 0.016, tall, 0.004).moved(x, width / 2 + 0.008, 0.02), wood))
    body.append(Part(cad.box(length, 0.016, tall, 0.004).moved(x, -width / 2 - 0.008, 0.02), wood))
    body.append(Part(cad.box(0.016, width + 0.03, tall, 0.004).moved(x - length / 2, 0, 0.02), wood))
    body.append(Part(cad.box(length - 0.03, width + 0.05, 0.016, 0.005).moved(x - 0.025, 0, 0.018 + tall), wood))
    color = pick(rng, palette.ACCENTS, unlike=wood)
    outer, inner = cad.rectangle(length - 0.02, width - 0.01, 0.004), cad.rectangle(length - 0.05, width - 0.04, 0.004)
    floor = cad.prism(cad.rectangle(length - 0.03, width - 0.02, 0.004), 0, 0.006)
    parts = [Part(cad.frame(outer, inner, 0, tall - 0.02, 0.003), wood), Part(floor, palette.BLUSH)]
    parts.append(Part(cad.box(0.022, width - 0.004, tall - 0.012, 0.006).moved(length / 2 - 0.006), color))
    knob = cad.lathe([(0.014, 0), (0.014, 0.016), (0.034, 0.024), (0.037, 0.042), (0.026, 0.054), (0, 0.056)], 20)
    parts.append(Part(knob.turned("y", np.pi / 2).moved(length / 2, 0, 0.5 * tall), palette.BRASS))
    at = (x, 0.0, 0.025)
    link = MovingLink(shifted(parts, at), "prismatic", at, (1, 0, 0), 0.0, travel, "small", "drawer")
    return switch(body, [link], SLIDE_X, 3 + 2 * variant)


def shutter(variant: int, rng: np.random.Generator) -> Design:
    """A flat plate that slides over a window, with a grip at its end."""
    travel, width = (0.12, 0.09)[variant % 2], (0.14, 0.20)[variant % 2]
    span = 2 * travel + 0.11
    base = ground(span + 0.05, width + 0.09, (3, 0)[variant % 2], rng)
    glass = cad.prism(cad.rectangle(travel + 0.01, width - 0.03, 0.01), 0, 0.006, bevel=0.002)
    body = [*base.parts, Part(glass.moved(-travel / 2 - 0.02, 0, base.top - 0.001), palette.GLASS)]
    guide = cad.box(span, 0.02, 0.030, 0.006)
    body += [Part(guide.moved(0, s * width / 2, base.top - 0.001), palette.STEEL) for s in (-1, 1)]
    color = pick(rng, palette.ACCENTS, unlike=base.cover)
    parts = [Part(cad.prism(cad.rectangle(travel + 0.05, width - 0.024, 0.01), 0, 0.014, bevel=0.004), color)]
    knob = cad.lathe([(0.024, 0), (0.02, 0.02), (0.028, 0.03), (0, 0.034)], 20)
    handle = knob if variant % 2 else cad.box(0.016, 0.6 * width, 0.03, 0.005)
    parts.append(Part(handle.moved(0.3 * travel, 0, 0.012), palette.IVORY))
    return switch(body, [slid(parts, (0, 0, base.top + 0.008), travel)], SLIDE_X, variant + 2)


def strap(variant: int, rng: np.random.Generator) -> Design:
    """A flat bar under flat straps, moved by an upright tab."""
    span, travel, broad = ((0.34, 0.12, 0.05), (0.28, 0.09, 0.075), (0.40, 0.19, 0.035))[variant % 3]
    base = ground(span + 0.10, broad + 0.13, (0, 2, 1)[variant % 3], rng)
    metal = pick(rng, palette.METALS, unlike=base.cover)
    body, z = list(base.parts), base.top + 0.004
    for x in (-0.36 * span, 0.36 * span):
        bridge = cad.box(0.034, broad + 0.06, 0.010, 0.003).moved(x, 0, z + 0.024)
        feet = [cad.box(0.034, 0.022, 0.036, 0.004).moved(x, s * (broad / 2 + 0.02), base.top - 0.001) for s in (-1, 1)]
        body += [Part(solid, metal) for solid in (bridge, *feet)]
    color = pick(rng, (*palette.ACCENTS, palette.BLACK), unlike=base.cover)
    bar = cad.box(span - travel + 0.13, broad, 0.018, 0.005)
    parts = [Part(bar, pick(rng, (palette.STEEL, palette.IRON), unlike=base.cover))]
    tab = (
        cad.box(0.026, broad, 0.075, 0.008),
        cad.box(0.07, 0.7 * broad, 0.04, 0.01),
        lying(0.026, 0.08).moved(z=0.035),
    )
    parts.append(Part(tab[variant % 3].moved(z=0.014), color))
    link = slid(parts, (0, 0, z), travel, "large" if variant % 3 == 2 else "small")
    return switch(body, [link], SLIDE_X, variant + 1)
