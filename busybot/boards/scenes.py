"""Scenes: a stove and a room, boards whose objects have parts and places, seen obliquely (docs/guides/scenes.md).

Beside the worlds, which say what decides responders, a scene says what stands where and who looks at it. Its relations
are the paper's simplest: each control sets one target. On the first board of a group the k-th control sets the k-th
target, on the others another wiring is drawn. Bystanders neither control (`BoardSpec.idle`) nor respond.

A board depends on (seed, split, group) and the library alone. Every part prefers its families, those that only scenes
have among them; in a library without them it takes any object of the category that suits.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from busybot.boards.layout import Area, footprint, free_spot
from busybot.boards.relations import direct_relation
from busybot.boards.spec import SCENES_VERSION, BoardCamera, BoardSpec, LinkRef, PlacedObject
from busybot.boards.textures import COLORS
from busybot.common.errors import BusybotError
from busybot.common.frozen_model import FrozenModel
from busybot.common.rng import generator
from busybot.objects.library import OTHER, Library
from busybot.objects.model import ObjectModel

LAYOUT_TRIES = 400
TURN = round(np.pi / 2, 6)
Pair = tuple[float, float]
Three = tuple[float, float, float]


class Part(FrozenModel):
    """Objects that have the same part in a scene.

    Attributes:
        does: `control` and `target` are wired, a `bystander` is not.
        category: of the objects; `families` of them that are preferred.
        count: least and most of them.
        places: (x, y) of the first, the second, ...; without, each stands anywhere free in one of `areas`
            (x from, y from, x to, y to).
        scale: they are so many times as large as on boards.
        yaw: their turn.
    """

    does: Literal["control", "target", "bystander"]
    category: Literal["Switch", "Lamp", "Door", "Toy"]
    families: tuple[str, ...] = ()
    count: tuple[int, int]
    places: tuple[Pair, ...] = ()
    areas: tuple[tuple[float, float, float, float], ...] = ()
    scale: Pair = (1.0, 1.0)
    yaw: float = 0.0


class Scene(FrozenModel):
    """What the boards of a scene are drawn from.

    Attributes:
        about: what is there, in words.
        size: of the surface, board units.
        textures, colors: of the surface.
        position, target: of the camera; `sway`: each coordinate of its position differs by up to so much.
        fov: horizontal field of view, degrees, from and to.
        margin: free space around objects, board units.
    """

    about: str
    size: Pair
    textures: tuple[str, ...]
    colors: tuple[Three, ...]
    position: Three
    sway: Three
    target: Three
    fov: Pair
    margin: Annotated[float, Field(ge=0)] = 0.04
    parts: tuple[Part, ...]

    @property
    def distance(self) -> float:
        """How far its camera stands from what it looks at, at most, board units."""
        return float(np.linalg.norm(np.abs(np.subtract(self.position, self.target)) + self.sway))


_WORKTOPS = ((-2.9, -2.05, -1.3, 2.05), (1.3, -2.05, 2.9, 2.05))
_WALL = ((-3.0, -2.0, 3.0, 2.0),)
SCENES: dict[str, Scene] = {
    "kitchen": Scene(
        about="a stove with four knobs and four burners between worktops, from the cook's place",
        size=(6.0, 4.4), textures=("brushed", "felt"),
        colors=((0.80, 0.82, 0.85), (0.94, 0.92, 0.86), (0.62, 0.74, 0.88)),
        position=(0.0, -3.6, 3.9), sway=(1.2, 0.3, 0.3), target=(0.0, -0.15, 0.0), fov=(66, 71),
        parts=(
            Part(does="control", category="Switch", families=("stoveknob",), count=(4, 4), scale=(1.2, 1.7),
                 places=((-0.9, -1.6), (-0.3, -1.6), (0.3, -1.6), (0.9, -1.6))),
            Part(does="target", category="Lamp", families=("burner",), count=(4, 4), scale=(1.5, 1.9),
                 places=((-0.62, -0.5), (0.62, -0.5), (-0.62, 0.8), (0.62, 0.8))),
            Part(does="bystander", category="Door", families=("pot", "kettle"), count=(2, 6), areas=_WORKTOPS,
                 scale=(0.9, 1.4)),
            Part(does="bystander", category="Switch", count=(1, 3), areas=_WORKTOPS, scale=(0.9, 1.2)),
            Part(does="bystander", category="Lamp", count=(1, 4), areas=_WORKTOPS, scale=(0.8, 1.1)),
            Part(does="bystander", category="Toy", count=(0, 2), areas=_WORKTOPS, yaw=TURN),
        ),
    ),
    "room": Scene(
        about="a wall with switches, lamps, a fan and a door, and things that belong to nothing, from one side",
        size=(6.4, 4.4), textures=("plywood", "felt", "cork"), colors=COLORS,
        position=(-2.7, -0.8, 4.0), sway=(0.6, 0.4, 0.2), target=(-0.3, 0.0, 0.0), fov=(73, 78),
        parts=(
            Part(does="target", category="Door", count=(1, 1), places=((1.9, -0.75),), scale=(2.4, 2.8), yaw=TURN),
            Part(does="target", category="Door", families=("fan",), count=(1, 1), scale=(1.0, 1.4), areas=_WALL),
            Part(does="target", category="Lamp", count=(3, 3), scale=(0.9, 1.5), areas=_WALL),
            Part(does="control", category="Switch", count=(5, 5), scale=(0.9, 1.3), areas=_WALL),
            Part(does="bystander", category="Switch", count=(1, 3), scale=(0.9, 1.3), areas=_WALL),
            Part(does="bystander", category="Lamp", count=(1, 3), scale=(0.9, 1.2), areas=_WALL),
            Part(does="bystander", category="Door", count=(0, 2), scale=(0.9, 1.3), areas=_WALL),
            Part(does="bystander", category="Toy", count=(0, 2), scale=(0.8, 1.0), areas=_WALL),
        ),
    ),
}  # fmt: skip
"""By the name that `--world` takes."""


def scene_group(board: BoardSpec, count: int, library: Library, instances: str) -> Iterator[BoardSpec]:
    """The boards of a group: one scene, differently wired.

    Args:
        board: its seed, split, group and world; the rest is drawn.
        count: of boards.
        instances: the library's split that objects are drawn from.

    Raises:
        BusybotError: the library lacks what the scene needs, or no draw finds a place for everything.
    """
    scene, rng = SCENES[board.world], generator(board.seed, board.split, board.appearance_group, "scene")
    parts, objects = _furnished(scene, board, library, instances, rng)
    drawn = board.model_copy(
        update={
            "schema_version": SCENES_VERSION,
            "size": scene.size,
            "texture": str(rng.choice(scene.textures)),
            "color": scene.colors[int(rng.integers(len(scene.colors)))],
            "objects": objects,
            "camera": _camera(scene, rng),
        }
    )
    by_part: dict[str, list[tuple[int, ObjectModel]]] = {"control": [], "target": [], "bystander": []}
    for index, (part, model) in enumerate(parts):
        by_part[part.does].append((index, model))
    idle = [LinkRef(object=index, link=link.name) for index, one in by_part["bystander"] for link in one.trigger_links]
    for number, wiring in enumerate(_wirings(len(by_part["target"]), count, rng)):
        relations = [
            direct_relation(index, model.trigger_links[0], 1, by_part["target"][target][0])
            for (index, model), target in zip(by_part["control"], wiring, strict=True)
        ]
        wired = {"index": board.appearance_group * count + number, "relations": relations, "idle": idle}
        yield BoardSpec.model_validate({**dict(drawn), **wired})


def _pool(part: Part, library: Library, instances: str) -> list[ObjectModel]:
    """What a part may be played by: of its families if there are any, else of the split."""
    keys = [key for key, _ in library.weights(instances, part.category)]
    if part.families:
        keys += [key for key in library.splits.get(OTHER, {}) if key.startswith(f"{part.category}/")]
        keys = [key for key in keys if key.split("/")[1].rsplit("-", 1)[0] in part.families] or keys
    found = [library.get(key) for key in sorted(keys) if _suits(part, library.get(key))]
    if not found:
        what = f"{library.name}: no {part.category} for a {part.does} of the scene"
        raise BusybotError(what, "`busybot assets list` shows what there is: it takes switches with one two-state link")
    return found


def _suits(part: Part, model: ObjectModel) -> bool:
    if part.does == "control":
        return len(model.trigger_links) == 1 and model.trigger_links[0].kind == "two-state"
    return part.does == "bystander" or (model.effect is not None and model.effect.single is not None)


def _furnished(
    scene: Scene, board: BoardSpec, library: Library, instances: str, rng: np.random.Generator
) -> tuple[list[tuple[Part, ObjectModel]], tuple[PlacedObject, ...]]:
    """The objects with their parts, and where they stand."""
    pools = [_pool(part, library, instances) for part in scene.parts]
    for _ in range(LAYOUT_TRIES):
        parts = []
        for part, pool in zip(scene.parts, pools, strict=True):
            alike = pool[int(rng.integers(len(pool)))]  # knobs of one stove are of one kind
            for _ in range(int(rng.integers(*part.count, endpoint=True))):
                parts.append((part, alike if part.places else pool[int(rng.integers(len(pool)))]))
        objects = _placed(scene, parts, rng)
        if objects is not None:
            return parts, objects
    what = f"{library.name}: no {board.world} of group {board.appearance_group} fits after {LAYOUT_TRIES} draws"
    raise BusybotError(what, "its objects are too large: take another library")


def _placed(
    scene: Scene, parts: Sequence[tuple[Part, ObjectModel]], rng: np.random.Generator
) -> tuple[PlacedObject, ...] | None:
    """All objects at their places; None if one finds none."""
    taken: list[Area] = []
    found: list[PlacedObject] = []
    sizes = {id(part): float(rng.uniform(*part.scale)) for part in scene.parts}
    for number, (part, model) in enumerate(parts):
        scale = sizes[id(part)]
        low, high = footprint(replace(model, scale=model.scale * scale), part.yaw, scene.margin)
        spot: np.ndarray | None
        if part.places:
            nth = sum(other is part for other, _ in parts[:number])
            spot = np.array(part.places[nth])
        else:
            x0, y0, x1, y1 = part.areas[int(rng.integers(len(part.areas)))]
            spot = free_spot((low, high), (np.array([x0, y0]), np.array([x1, y1])), taken, rng)
        if spot is None or any((spot + low < b).all() and (spot + high > a).all() for a, b in taken):
            return None
        taken.append((spot + low, spot + high))
        position = (round(float(spot[0]), 6), round(float(spot[1]), 6), round(model.offset_z * scale, 6))
        states = tuple(int(rng.integers(link.states)) for link in model.trigger_links)
        placed = PlacedObject(
            key=model.key,
            role=model.role,
            position=position,
            yaw=part.yaw,
            scale=round(model.scale * scale, 6),
            states=states,
        )
        found.append(placed)
    return tuple(found)


def _camera(scene: Scene, rng: np.random.Generator) -> BoardCamera:
    x, y, z = (round(float(a + rng.uniform(-b, b)), 4) for a, b in zip(scene.position, scene.sway, strict=True))
    return BoardCamera(position=(x, y, z), target=scene.target, fov_deg=round(float(rng.uniform(*scene.fov)), 3))


def _wirings(targets: int, count: int, rng: np.random.Generator) -> Iterator[tuple[int, ...]]:
    """Which target each control sets, on each board: the k-th the k-th first, then others in random order."""
    first, *others = permutations(range(targets))
    order = [others[place] for place in rng.permutation(len(others))]
    for number in range(count):
        yield first if number == 0 else order[(number - 1) % len(order)]
