"""A responder that a boolean function of two or three links drives.

Inputs: two or three, each true while it rests in its highest state (a multi-direction link rests high). Truth table:
the function's, so that an effect shows only in some contexts. Memory: none. Parameters: `function`, one of `FUNCTIONS`.
Example: `and` of a and b: the lamp burns while both are on; moving a changes nothing while b is off.

Held out for the split `novel-mechanism`: `xor`, `xnor`, `a-and-not-b`, `not-a-and-b` and all functions of three links.
Training has the others. A responder with three stages has no gate.
"""

from collections.abc import Callable, Sequence
from itertools import product
from typing import ClassVar, Self

import numpy as np
from pydantic import field_validator

from busybot.boards.mechanisms.base import Mechanism

FUNCTIONS: dict[str, Callable[..., bool]] = {
    "and": lambda *on: all(on),
    "or": lambda *on: any(on),
    "nand": lambda *on: not all(on),
    "nor": lambda *on: not any(on),
    "xor": lambda *on: sum(on) % 2 == 1,
    "xnor": lambda *on: sum(on) % 2 == 0,
    "a-and-not-b": lambda a, b: a and not b,
    "not-a-and-b": lambda a, b: b and not a,
    "majority": lambda a, b, c: a + b + c >= 2,
}
"""What a gate computes of its inputs, by name."""
TRAINED = ("and", "or", "nand", "nor")
HELD_OUT = {2: ("xor", "xnor", "a-and-not-b", "not-a-and-b"), 3: ("and", "or", "nand", "nor", "majority", "xor")}
"""Names of the functions that only `novel-mechanism` has, by number of inputs."""


def truth_table(function: str, sizes: Sequence[int]) -> tuple[int, ...]:
    """State for each combination of the inputs' states, the last input fastest."""
    combinations = product(*(range(size) for size in sizes))
    high = ([state == size - 1 for state, size in zip(states, sizes, strict=True)] for states in combinations)
    return tuple(int(FUNCTIONS[function](*on)) for on in high)


def draw_function(inputs: int, novel: bool, rng: np.random.Generator) -> str | None:
    """Name of a function of so many inputs, None if there is none (`novel`: held out)."""
    names = HELD_OUT.get(inputs, ()) if novel else TRAINED if inputs == 2 else ()
    return str(rng.choice(names)) if names else None


def in_words(sizes: tuple[int, ...], table: tuple[int, ...], inputs: Sequence[str]) -> str:
    """A table of one link, or of a function of several, in words.

    Args:
        inputs: names of the links.
    """
    if len(sizes) == 1:
        return f"is the opposite of {inputs[0]}" if table == (1, 0) else f"follows {inputs[0]}"
    names = (name for name in (*TRAINED, *HELD_OUT.get(len(sizes), ())) if truth_table(name, sizes) == table)
    function = next(names, None)
    if function is None:
        return f"shows a function of {', '.join(inputs)}"
    if function in ("a-and-not-b", "not-a-and-b"):
        yes, no = inputs if function == "a-and-not-b" else reversed(inputs)
        return f"shows {yes} and not {no}"
    return f"shows {function.upper()}({', '.join(inputs)})"


class Gate(Mechanism):
    """A boolean function of two or three links.

    Attributes:
        function: one of `FUNCTIONS`; the table says what it does.
    """

    kind: ClassVar[str] = "gate"
    arity: ClassVar[tuple[int, int]] = (2, 3)

    function: str

    @field_validator("function")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in FUNCTIONS:
            raise ValueError(f"there is no function {name!r}, choose from {', '.join(FUNCTIONS)}")
        return name

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        function = draw_function(len(sizes), novel, rng) if stages == 2 else None
        return cls(sizes=sizes, table=truth_table(function, sizes), function=function) if function else None

    def sentence(self, inputs: Sequence[str]) -> str:
        return in_words(self.sizes, self.table, inputs)
