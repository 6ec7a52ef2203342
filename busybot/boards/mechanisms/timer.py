"""A responder that stays on for some actions once its link is pressed.

Inputs: one link, pressed when it comes to rest in its highest state. Truth table: two states, at rest and "on", which
may be either of the responder's: else a lamp that burns at first would tell that no timer has it. Memory: for how many
more actions it stays on. Parameters: `actions`, 2 to 4. Example: `actions` 2: the switch is turned on and the
lamp burns after this action and the next one; then it goes out, though the switch is still on. Turned on again, it
begins anew.

None is held out.
"""

from collections.abc import Sequence
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field

from busybot.boards.mechanisms.base import Chance, Inputs, Mechanism, Memory
from busybot.boards.mechanisms.direct import follow


class Timer(Mechanism):
    """On for some actions after each press.

    The memory's second number is the link's state after the last action.

    Attributes:
        actions: for how long.
    """

    kind: ClassVar[str] = "timer"

    actions: Annotated[int, Field(ge=1, le=16)]

    @classmethod
    def rows(cls, sizes: Sequence[int]) -> int:
        return 2

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        return self.table[0], (0, inputs[0])

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        left, before = memory
        left = self.actions if pressed(before, inputs[0], self.sizes[0]) else max(0, left - 1)
        return self.table[int(left > 0)], (left, inputs[0])

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        if novel or len(sizes) != 1 or stages != 2:
            return None
        return cls(sizes=sizes, table=follow(2, rng), actions=int(rng.integers(2, 5)))

    def sentence(self, inputs: Sequence[str]) -> str:
        return f"is {'on' if self.table[1] else 'off'} for {self.actions} actions after {inputs[0]} is pressed"


def pressed(before: int, after: int, size: int) -> bool:
    """Whether a link came to rest in its highest state."""
    return before != after == size - 1
