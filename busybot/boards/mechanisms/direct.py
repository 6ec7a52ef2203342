"""The paper's three kinds: a responder follows one link (section 3 "Relations").

Inputs: one link. Truth table: `table[s]` while the link rests in state s. Memory: none. Example: table (0, 1), the lamp
burns while its switch is on; (1, 0, 2) is the paper's for a link with a middle.

They differ in what else is there: `one-to-one` is a two-state link alone on its object, `one-to-many-objects` one of
several links of an object, `one-to-many-effects` a multi-direction link, whose responder has three stages.
"""

from collections.abc import Sequence
from typing import ClassVar, Self

import numpy as np

from busybot.boards.mechanisms.base import Mechanism
from busybot.boards.mechanisms.gate import in_words
from busybot.boards.relations import STEP_OF_STATE


class OneToOne(Mechanism):
    """A responder that follows a two-state link."""

    kind: ClassVar[str] = "one-to-one"

    @classmethod
    def draw(cls, sizes: tuple[int, ...], stages: int, novel: bool, rng: np.random.Generator) -> Self | None:
        """As is or inverted for two states, the paper's steps for three; none is held out."""
        if novel or len(sizes) != 1 or sizes[0] != stages:
            return None
        return cls(sizes=sizes, table=follow(stages, rng))

    def sentence(self, inputs: Sequence[str]) -> str:
        return in_words(self.sizes, self.table, inputs)


class ManyEffects(OneToOne):
    """A three-stage responder that follows a multi-direction link."""

    kind: ClassVar[str] = "one-to-many-effects"


class ManyObjects(OneToOne):
    """A responder that follows one of an object's several links."""

    kind: ClassVar[str] = "one-to-many-objects"


def follow(stages: int, rng: np.random.Generator) -> tuple[int, ...]:
    """Table of a responder that shows each of its states for one of a link's."""
    if stages == 2:
        return ((0, 1), (1, 0))[int(rng.integers(2))]
    return STEP_OF_STATE
