"""What a stranger's package may bring, for `test_base`."""

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


NOTHING = 3
