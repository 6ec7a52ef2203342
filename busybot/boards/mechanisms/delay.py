"""A responder that follows its links some actions late.

Inputs: one link, or two through a gate. Truth table: as without delay, of the inputs `actions` actions ago. Memory:
what the table said after each of the last `actions` actions, the oldest first; on a new board everything has rested for
long. Parameters: `actions`, 1 to 3. Example: `actions` 2, table (0, 1): a switch is turned on, nothing happens; after
the next action nothing; after the one after that the lamp burns, whatever these actions were.

Held out for the split `novel-mechanism`: delays of 2 and 3. Training has 1.
"""

from collections.abc import Sequence
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field

from busybot.boards.mechanisms.base import Chance, Inputs, Mechanism, Memory
from busybot.boards.mechanisms.direct import follow
from busybot.boards.mechanisms.gate import draw_function, in_words, truth_table


class Delay(Mechanism):
    """A table of its inputs as they were some actions ago.

    Attributes:
        actions: how long ago.
    """

    kind: ClassVar[str] = "delay"
    arity: ClassVar[tuple[int, int]] = (1, 2)

    actions: Annotated[int, Field(ge=1, le=3)]

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        now = self.shown(inputs)
        return now, (now,) * self.actions

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        return memory[0], (*memory[1:], self.shown(inputs))

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        actions = int(rng.integers(2, 4)) if novel else 1
        if len(sizes) == 1:
            return cls(sizes=sizes, table=follow(stages, rng), actions=actions) if sizes[0] == stages else None
        function = draw_function(len(sizes), False, rng) if stages == 2 else None
        return cls(sizes=sizes, table=truth_table(function, sizes), actions=actions) if function else None

    @property
    def lag(self) -> int:
        return self.actions

    def sentence(self, inputs: Sequence[str]) -> str:
        late = f"{self.actions} {'action' if self.actions == 1 else 'actions'} later"
        return f"{in_words(self.sizes, self.table, inputs)}, {late}"
