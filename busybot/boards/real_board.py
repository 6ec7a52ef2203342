"""The twin of the paper's real board (section 4.5): three switches, three LEDs, rewired six times.

The paper tells that four of its wirings are one-to-one and two are one-to-many, not which. Here LED k is wired to
switch `WIRINGS[n][k]`: of the six one-to-one wirings four, of which no two agree in more than one LED, and two in which
a switch has two LEDs and another one has none (its link is declared idle). Each wiring has three relations, as the
paper counts them. Board n has wiring n mod 6; boards of one appearance group are one board, rewired.

Switches stand in a row below the LEDs, each somewhat off its place. An LED is a lamp of the procedural library, made
small. Switches, LEDs, places, colours and how switches stand at first are drawn for each group.
"""

from busybot.boards.config import BoardConfig
from busybot.boards.spec import WORLDS_VERSION, BoardSpec, LinkRef, PlacedObject, Relation
from busybot.boards.textures import COLORS, TEXTURES
from busybot.boards.worlds import DIRECT, REAL_BOARD, links_of
from busybot.common.rng import generator
from busybot.objects.library import Library

SWITCHES = (
    *(f"Switch/{family}-{variant:02d}" for family in ("toggle", "rocker") for variant in (1, 2, 3)),
    *(f"Switch/{family}-{variant:02d}" for family in ("slider", "button") for variant in (1, 2)),
)
LEDS = ("Lamp/globe-01", "Lamp/bulb-01", "Lamp/drum-01")
LED_SIZE = 0.55
"""Of the lamp that it is made of."""
WIRINGS = ((0, 1, 2), (1, 0, 2), (1, 2, 0), (2, 1, 0), (0, 0, 1), (2, 1, 2))
COLUMNS, ROWS, ASIDE = (-1.1, 0.0, 1.1), (-0.75, 0.75), 0.2
"""Where things stand, and how far off at most, board units: switches in the lower row, LEDs in the upper one."""


def real_board(config: BoardConfig, library: Library, index: int) -> BoardSpec:
    """Board `index` of the configuration.

    Raises:
        BusybotError: the library lacks an object.
    """
    group = index // config.group_size
    rng = generator(config.seed, config.split, group, REAL_BOARD)
    keys = [str(key) for key in rng.choice(SWITCHES, 3, replace=False)] + [str(rng.choice(LEDS))] * 3
    models = [library.get(key) for key in keys]
    objects = []
    for number, model in enumerate(models):
        size = LED_SIZE if number >= len(COLUMNS) else 1.0
        x, y = rng.uniform(-ASIDE, ASIDE, 2) + (COLUMNS[number % 3], ROWS[number // 3])
        states = tuple(int(rng.integers(link.states)) for link in model.trigger_links)
        position = (round(float(x), 6), round(float(y), 6), round(model.offset_z * size, 6))
        scale = model.scale * size
        objects.append(
            PlacedObject(key=model.key, role=model.role, position=position, yaw=0.0, scale=scale, states=states)
        )
    links = [LinkRef(object=number, link=name) for number, name in links_of(models).names]
    wired = WIRINGS[index % len(WIRINGS)]
    return BoardSpec(
        schema_version=WORLDS_VERSION,
        index=index,
        seed=config.seed,
        split=config.split,
        appearance_group=group,
        texture=str(rng.choice(TEXTURES)),
        color=COLORS[int(rng.integers(len(COLORS)))],
        objects=tuple(objects),
        relations=tuple(
            Relation(kind=DIRECT, triggers=(links[switch],), responder=3 + led, stage="single", states=(0, 1))
            for led, switch in enumerate(wired)
        ),
        world=REAL_BOARD,
        idle=tuple(link for number, link in enumerate(links) if number not in wired),
    )
