"""A responder that follows most of its links.

Inputs: three links. Truth table: on while two of them or all are in their highest state. Memory, parameters: none.
Example: a and b on light the lamp, c makes no difference then. None is held out.
"""

from itertools import product
from typing import ClassVar, Self

import numpy as np

from busybot.boards.mechanisms.base import Chance, Inputs, Mechanism, Memory


class Majority(Mechanism):
    """On while most of three links are."""

    kind: ClassVar[str] = "majority"
    arity: ClassVar[tuple[int, int]] = (3, 3)

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        return self.step(inputs, (), None)

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        return self.table[int(np.ravel_multi_index(inputs, self.sizes))], ()

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        if len(sizes) != 3 or stages != 2 or novel:
            return None
        highest = [
            [state == size - 1 for state, size in zip(row, sizes, strict=True)] for row in product(*map(range, sizes))
        ]
        return cls(sizes=sizes, table=tuple(int(sum(row) >= 2) for row in highest))
