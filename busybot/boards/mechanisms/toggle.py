"""A responder that changes with each press of its link.

Inputs: one link, pressed when it comes to rest in its highest state. Truth table: two states, that of a new board and
the other. Memory: the link's state after the last action, and whether the responder has changed an odd number of times.
Parameters: none. Example: table (0, 1): the switch is turned on and the lamp burns; turned off, nothing; on again, and
the lamp goes out.

The whole kind is held out for the split `novel-mechanism`.
"""

from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np

from busybot.boards.mechanisms.base import Chance, Inputs, Mechanism, Memory
from busybot.boards.mechanisms.direct import follow
from busybot.boards.mechanisms.timer import pressed


class Toggle(Mechanism):
    """The other state after each press."""

    kind: ClassVar[str] = "toggle"

    @classmethod
    def rows(cls, sizes: Sequence[int]) -> int:
        return 2

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        return self.table[0], (inputs[0], 0)

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        before, odd = memory
        odd ^= pressed(before, inputs[0], self.sizes[0])
        return self.table[odd], (inputs[0], odd)

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        if not novel or len(sizes) != 1 or stages != 2:
            return None
        return cls(sizes=sizes, table=follow(2, rng))

    def sentence(self, inputs: Sequence[str]) -> str:
        return f"changes with every press of {inputs[0]}"
