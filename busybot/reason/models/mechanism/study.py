"""What a recording tells of its board whatever a network makes of it: perceived, explained and counted once.

Evaluators ask several models of one board, and each of them several things: none of them looks or counts again.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import torch

from busybot.reason.inputs.sequence import BoardSequence
from busybot.reason.models.mechanism.changes import changes_of
from busybot.reason.models.mechanism.contexts import Explanations, explanations_of
from busybot.reason.models.mechanism.networks import explanation_graph, moments_of
from busybot.reason.models.mechanism.perception import perceive
from busybot.reason.pyg import HeteroData


class Study:
    """Of one recording. `study_of` makes it.

    Attributes:
        perceived: what pictures show.
    """

    def __init__(self, seen: BoardSequence, encoder: str):
        self.perceived, self._steps = perceive(seen, encoder), seen.steps
        self._places: np.ndarray | None = None

    @cached_property
    def found(self) -> Explanations:
        """What may explain it."""
        return explanations_of(self.perceived.trace)

    @cached_property
    def after_each(self) -> HeteroData:
        """What was counted on the new board and after each action."""
        return self._counted(range(self._steps + 1))

    @cached_property
    def at_the_end(self) -> HeteroData:
        """What was counted after the last action; by itself, that takes two thirds of the time."""
        if "after_each" in self.__dict__:
            return moments_of(self.after_each, torch.tensor([self._steps]))
        return self._counted([self._steps])

    @cached_property
    def places(self) -> np.ndarray:
        """Where responders' mechanisms changed, if they did, as of `Changes`."""
        return changes_of(self.perceived.trace, self.found, []).places if self._places is None else self._places

    def _counted(self, after: Sequence[int]) -> HeteroData:
        changes = changes_of(self.perceived.trace, self.found, after)
        self._places = changes.places  # the same after whatever actions
        return explanation_graph(self.perceived.trace, after, changes=changes)


def study_of(seen: BoardSequence, encoder: str) -> Study:
    """The study of a recording, the same one whenever it is asked for."""
    return seen.once(("study", encoder), lambda: Study(seen, encoder))
