"""How a board looks beside what stands on it, drawn for each board: camera, lights, surfaces (`render.randomise`).

Each term has a generator of its own, `generator(seed, split, board, "appearance/TERM")`, of the board alone: the same
board looks the same whatever is collected on it. Boards of one appearance group share what stands where and differ in
how they are seen. Objects keep their own looks: their states are told by them.
"""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from busybot.boards.spec import BoardSpec
from busybot.common.frozen_model import FrozenModel
from busybot.common.rng import generator

Share = Annotated[float, Field(ge=0, le=1)]
Vector = tuple[float, float, float]


class Randomise(FrozenModel):
    """Terms of what is drawn for each board, with their strengths; 0 leaves a term as it is.

    Attributes:
        pose: the camera stands up to so far (board units) from its place, in any direction, and is aimed at a point up
            to a quarter as far from its target. Its field of view is widened until the board's corners show.
        fov: share by which the field of view is narrower or wider, then widened likewise.
        lights: 1 turns the key light anywhere about the board, makes it and the light from all sides up to 1.6 times
            brighter or darker, and warmer or colder by up to a fifth.
        textures: 1 turns and displaces the board's texture and gives each colour of board and table up to a third more
            or less.

    JSON has only the terms that are there.
    """

    pose: Share = 0.0
    fov: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    lights: Share = 0.0
    textures: Share = 0.0

    @model_serializer(mode="wrap")
    def _what_is_there(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {name: value for name, value in handler(self).items() if value}


@dataclass(frozen=True)
class Lights:
    """The lights of a board beside the usual ones.

    Attributes:
        turn: of the key light about the board's z axis, radians.
        key, ambient: factors of the key light's colour and of that from all sides, RGB.
    """

    turn: float = 0.0
    key: Vector = (1.0, 1.0, 1.0)
    ambient: Vector = (1.0, 1.0, 1.0)

    def turned(self, direction: Vector) -> Vector:
        """A direction of the key light, turned with it."""
        x, y, z = direction
        cosine, sine = float(np.cos(self.turn)), float(np.sin(self.turn))
        return (cosine * x - sine * y, sine * x + cosine * y, z)


@dataclass(frozen=True)
class Surfaces:
    """The surfaces of a board beside the usual ones.

    Attributes:
        quarters: turns of the texture by 90 degrees; `shift`: its displacement, shares of its sides.
        board, table: factors of their colours, RGB.
    """

    quarters: int = 0
    shift: tuple[float, float] = (0.0, 0.0)
    board: Vector = (1.0, 1.0, 1.0)
    table: Vector = (1.0, 1.0, 1.0)

    def of(self, texture: np.ndarray) -> np.ndarray:
        """A texture, uint8 (S, S, 3), as it lies on this board, in its colours."""
        rows, columns = (round(share * len(texture)) for share in self.shift)
        placed = np.rot90(np.roll(texture, (rows, columns), axis=(0, 1)), self.quarters)
        return np.asarray((placed * np.array(self.board)).round().clip(0, 255), np.uint8)


USUAL_LIGHTS, USUAL_SURFACES = Lights(), Surfaces()


def moved_camera(strength: float, spec: BoardSpec, position: Vector, target: Vector) -> tuple[Vector, Vector]:
    """Position and target of the board's camera."""
    rng = _drawn(spec, "pose")
    offsets = [rng.standard_normal(3) for _ in range(2)]
    lengths = strength * np.cbrt(rng.random(2)) * (1, 0.25)
    moved = [
        np.add(place, offset / np.linalg.norm(offset) * length)
        for place, offset, length in zip((position, target), offsets, lengths, strict=True)
    ]
    return _vector(moved[0]), _vector(moved[1])


def zoom_of(strength: float, spec: BoardSpec) -> float:
    """Factor of the field of view of the board's camera."""
    return float(_drawn(spec, "fov").uniform(1 - strength, 1 + strength))


def lights_of(strength: float, spec: BoardSpec) -> Lights:
    """The lights of the board."""
    if not strength:
        return USUAL_LIGHTS
    rng = _drawn(spec, "lights")
    turn = strength * rng.uniform(-np.pi, np.pi)
    bright, warm = 1.6 ** rng.uniform(-strength, strength, 2), 0.2 * rng.uniform(-strength, strength, 2)
    key, ambient = (_vector(b * np.array([1 + w, 1, 1 - w])) for b, w in zip(bright, warm, strict=True))
    return Lights(float(turn), key, ambient)


def surfaces_of(strength: float, spec: BoardSpec) -> Surfaces:
    """The surfaces of the board."""
    if not strength:
        return USUAL_SURFACES
    rng = _drawn(spec, "textures")
    shift = rng.random(2) * strength
    board, table = (_vector(rng.uniform(1 - strength / 3, 1 + strength / 3, 3)) for _ in range(2))
    return Surfaces(int(rng.integers(4)), (float(shift[0]), float(shift[1])), board, table)


def _drawn(spec: BoardSpec, term: str) -> np.random.Generator:
    return generator(spec.seed, spec.split, spec.index, f"appearance/{term}")


def _vector(values: np.ndarray) -> Vector:
    x, y, z = (float(value) for value in values)
    return (x, y, z)
