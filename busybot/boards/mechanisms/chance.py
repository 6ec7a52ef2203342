"""Responders with a luck of their own: those that may fail, that flicker, that a hidden clock moves.

`unreliable`. Inputs: one link, or two through a gate. Truth table: where it is to go. Memory: the state that it shows.
After each action it goes there with `probability` (.7 to .9), so that it catches up later. Example: the switch is
turned on, the lamp stays dark; two actions later, which did other things, it burns. Held out: the gates that are held
out.

`flicker`. Inputs: none. Truth table: two states. Memory: which it shows. Changes by itself with `probability` (.05 to
.2) an action. Every split has it.

`clock`. Inputs: none that anybody sees. As `flicker`, but two or three responders have their luck in common
(`stream`), so that they always change together: a hidden clock. Every split has it.
"""

from collections.abc import Sequence
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field

from busybot.boards.mechanisms.base import Chance, Inputs, Mechanism, Memory
from busybot.boards.mechanisms.direct import follow
from busybot.boards.mechanisms.gate import draw_function, in_words, truth_table

Share = Annotated[float, Field(gt=0, lt=1)]
FIRES = (0.7, 0.9)
FLICKERS = (0.05, 0.2)
DIGITS = 2


class Unreliable(Mechanism):
    """Goes where its table says with a probability, once an action.

    Attributes:
        probability: of going there.
    """

    kind: ClassVar[str] = "unreliable"
    draws: ClassVar[bool] = True
    arity: ClassVar[tuple[int, int]] = (1, 2)

    probability: Share

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        now = self.shown(inputs)
        return now, (now,)

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        fires = chance is None or chance.random() < self.probability
        now = self.shown(inputs) if fires else memory[0]
        return now, (now,)

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        probability = round(float(rng.uniform(*FIRES)), DIGITS)
        if len(sizes) == 1:
            fits = sizes[0] == stages and not novel
            return cls(sizes=sizes, table=follow(stages, rng), probability=probability) if fits else None
        function = draw_function(2, novel, rng) if (len(sizes), stages) == (2, 2) else None
        return cls(sizes=sizes, table=truth_table(function, sizes), probability=probability) if function else None

    def sentence(self, inputs: Sequence[str]) -> str:
        return f"{in_words(self.sizes, self.table, inputs)} with luck ({self.probability:.0%} an action)"


class Flicker(Mechanism):
    """Changes by itself.

    Attributes:
        probability: of a change, an action.
    """

    kind: ClassVar[str] = "flicker"
    draws: ClassVar[bool] = True
    arity: ClassVar[tuple[int, int]] = (0, 0)

    probability: Share

    @classmethod
    def rows(cls, sizes: Sequence[int]) -> int:
        return 2

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        return self.table[0], (0,)

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        changes = chance is not None and chance.random() < self.probability
        now = memory[0] ^ int(changes)
        return self.table[now], (now,)

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        if sizes or stages != 2:
            return None
        return cls(sizes=(), table=follow(2, rng), probability=round(float(rng.uniform(*FLICKERS)), DIGITS))

    def sentence(self, inputs: Sequence[str]) -> str:
        return f"flickers ({self.probability:.0%} an action)"


class Clock(Flicker):
    """Changes when a hidden clock strikes, together with the others that it moves."""

    kind: ClassVar[str] = "clock"

    def sentence(self, inputs: Sequence[str]) -> str:
        return f"moves with a hidden clock ({self.probability:.0%} an action)"
