"""What a stranger's package may bring."""

from typing import ClassVar, Self

import numpy as np

from busybot.boards.mechanisms.base import Chance, Inputs, Mechanism, Memory


class Echo(Mechanism):
    """Shows what its link did one action ago."""

    kind: ClassVar[str] = "echo"

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        return self.shown(inputs), inputs

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        return self.shown(memory), inputs

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        return cls(sizes=sizes, table=(0, 1)) if sizes == (2,) and stages == 2 and not novel else None


class Taken(Echo):
    """Has a name that is taken."""

    kind: ClassVar[str] = "toggle"


class Late(Echo):
    """The same, but begins with nothing to remember."""

    kind: ClassVar[str] = "late"

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        return self.shown(inputs), ()

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        return self.shown(memory or inputs), inputs


class Beyond(Echo):
    """Shows, once it is moved, what no responder has."""

    kind: ClassVar[str] = "beyond"

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        return (0 if inputs == memory else -1), inputs


class Scaled(Echo):
    """Calculates with its luck."""

    kind: ClassVar[str] = "scaled"
    draws: ClassVar[bool] = True

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        return self.shown(inputs if chance is None or 10 * chance.random() > 1 else memory), inputs


class Counting(Echo):
    """Shows what its link does, and counts all actions, without end."""

    kind: ClassVar[str] = "counting"

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        return self.shown(inputs), (0,)

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        return self.shown(inputs), (memory[0] + 1,)


class Misnamed(Echo):
    """Has a name that no board can write down."""

    kind: ClassVar[str] = "in_order"


class Many(Echo):
    """Has more inputs than are ever drawn."""

    kind: ClassVar[str] = "many"
    arity: ClassVar[tuple[int, int]] = (4, 4)


class Never(Echo):
    """Draws none of itself, and has one input."""

    kind: ClassVar[str] = "never"

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        (size,) = sizes
        assert size
        return None


NOTHING = 3


class Odd(Echo):
    """Says how many inputs it has as one number."""

    kind: ClassVar[str] = "odd"
    arity: ClassVar = 2  # type: ignore[assignment]
