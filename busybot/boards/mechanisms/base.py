"""The interface of a mechanism: what decides a responder's state.

A mechanism reads the states of its inputs once an action, also after an action that moved nothing, and says which state
its responder takes. It may have a memory and a chance of its own, and nothing else: `step` is pure. Inputs are trigger
links, in their state after the action, and responders, in the state that they had *before* the action: what one
responder does to another shows one action later, so that the order of evaluation does not matter.

A kind is one class in one file, whose docstring is its specification; `boards.mechanisms.registry` lists them.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Protocol, Self

import numpy as np
from pydantic import Field, model_validator

from busybot.common.frozen_model import FrozenModel

State = Annotated[int, Field(ge=0, le=15)]
Inputs = tuple[int, ...]
"""State of each input."""
Memory = tuple[int, ...]
"""What a mechanism remembers from action to action; its kind knows the meaning."""


class Luck(Protocol):
    """Where luck comes from; a NumPy generator is one."""

    def random(self) -> float:
        """From 0 to 1; what has a probability happens if this is less."""
        ...


Chance = Luck | None
"""None is a world in which everything that may fail succeeds and nothing moves by itself."""


class Mechanism(FrozenModel, ABC):
    """Decides the state of one responder.

    Attributes:
        kind: its name, as a board's relations give it.
        draws: whether it asks for luck, so that none is derived for the others.
        arity: least and most number of inputs, inclusive.
        sizes: number of states of each input.
        table: state of the responder for each combination of the inputs' states, the last input fastest; a kind may
            read it otherwise and says so.
    """

    kind: ClassVar[str]
    draws: ClassVar[bool] = False
    arity: ClassVar[tuple[int, int]] = (1, 1)

    sizes: tuple[State, ...]
    table: tuple[State, ...]

    @model_validator(mode="after")
    def _fits(self) -> Self:
        least, most = self.arity
        if not least <= len(self.sizes) <= most:
            raise ValueError(f"{self.kind} has {least} to {most} inputs, not {len(self.sizes)}")
        if len(self.table) != self.rows(self.sizes):
            raise ValueError(f"{len(self.table)} states are listed, its inputs have {self.rows(self.sizes)}")
        return self

    @classmethod
    def rows(cls, sizes: Sequence[int]) -> int:
        """How many states the table lists for inputs of these sizes."""
        return math.prod(sizes)

    def start(self, inputs: Inputs) -> tuple[int, Memory]:
        """The responder's state and the memory on a new board, on which everything has rested for long.

        Here, and in `step`: what the table shows, with nothing to remember.
        """
        return self.shown(inputs), ()

    def step(self, inputs: Inputs, memory: Memory, chance: Chance) -> tuple[int, Memory]:
        """The responder's state and the memory after one more action."""
        return self.shown(inputs), ()

    @classmethod
    @abstractmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        """A mechanism of this kind; None if there is none of it.

        Args:
            sizes: number of states of each input.
            stages: number of states of the responder.
            novel: one that boards of the split `novel-mechanism` have and others do not; else the other way round.
        """

    def shown(self, inputs: Inputs) -> int:
        """The table's state for these inputs."""
        row = 0
        for state, size in zip(inputs, self.sizes, strict=True):
            row = row * size + state
        return self.table[row]

    @property
    def lag(self) -> int:
        """After how many actions an input's change shows at the earliest, 0: after the one that made it."""
        return 0

    def parameters(self) -> dict[str, Any]:
        """What a board writes down of it beside the table."""
        return self.model_dump(mode="json", exclude={"sizes", "table"})

    def sentence(self, inputs: Sequence[str]) -> str:
        """The mechanism in words, e.g. "follows a".

        Args:
            inputs: their names.
        """
        return f"{self.kind} of {', '.join(inputs)}" if inputs else self.kind
