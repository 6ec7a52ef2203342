"""Responders that nothing moves.

Inputs: none. Truth table: the one state that it shows. Memory: none. Example: table (1,), a lamp that burns whatever is
done. Every split has it.
"""

from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np

from busybot.boards.mechanisms.base import Mechanism


class Rest(Mechanism):
    """Always the same state."""

    kind: ClassVar[str] = "rest"
    arity: ClassVar[tuple[int, int]] = (0, 0)

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        return None if sizes else cls(sizes=(), table=(int(rng.integers(stages)),))

    def sentence(self, inputs: Sequence[str]) -> str:
        return f"always shows {self.table[0]}"
