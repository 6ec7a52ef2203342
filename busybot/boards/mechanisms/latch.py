"""A responder that one link sets and another one resets.

Inputs: two links, each pressed when it comes to rest in its highest state. Truth table: two states, reset and set.
Memory: both links' states after the last action, and whether it is set. Parameters: `first`, whether it is set on a
new board. Example: pressing a lights the lamp, and pressing it again changes nothing until b was pressed, which puts
it out.

None is held out.
"""

from collections.abc import Sequence
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field

from busybot.boards.mechanisms.base import Chance, Inputs, Mechanism, Memory
from busybot.boards.mechanisms.timer import pressed


class Latch(Mechanism):
    """Set by the first link, reset by the second.

    Attributes:
        first: whether it is set on a new board, 0 or 1.
    """

    kind: ClassVar[str] = "latch"
    arity: ClassVar[tuple[int, int]] = (2, 2)

    first: Annotated[int, Field(ge=0, le=1)] = 0

    @classmethod
    def rows(cls, sizes: Sequence[int]) -> int:
        return 2

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        return self.table[self.first], (*inputs, self.first)

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        *before, on = memory
        for place, state in ((0, 1), (1, 0)):
            if pressed(before[place], inputs[place], self.sizes[place]):
                on = state
                break
        return self.table[on], (*inputs, on)

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        if novel or len(sizes) != 2 or stages != 2:
            return None
        return cls(sizes=sizes, table=(0, 1), first=int(rng.integers(2)))

    def sentence(self, inputs: Sequence[str]) -> str:
        return f"is set by {inputs[0]}, reset by {inputs[1]}"
