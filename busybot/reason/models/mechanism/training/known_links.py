"""What training boards tell of which way round links are: of each other, and to those that are only drawn."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from busybot.reason.models.mechanism.rising import FORM, KEPT, odds_of
from busybot.reason.models.mechanism.training.labelled import LabelledLinks, LabelledTrace

AS_NEW = 0.5
"""So large a share of the boards hears what others tell of its links as if nobody had seen its objects before."""


@dataclass(frozen=True)
class KnownLinks:
    """Links that were seen on recorded boards, N of them.

    Attributes:
        forms: float32 (N, FORM).
        rises: int (N,), 1 or -1.
        boards: int (N,), `id` of the labelled links of each one's board.
        objects: names of their objects, str (N,).
        rng: draws what is heard.
        told: of links of boards as known ones, and as if they were new, log odds of what is true.
    """

    forms: np.ndarray
    rises: np.ndarray
    boards: np.ndarray
    objects: np.ndarray
    rng: np.random.Generator
    told: tuple[np.ndarray, np.ndarray] = (np.zeros(1), np.zeros(1))

    @staticmethod
    def of(boards: Sequence[LabelledTrace], rng: np.random.Generator) -> "KnownLinks":
        """Those of which it is known which way round they are, `KEPT` of them at most."""
        seen = [board.links for board in boards if board.links is not None and len(board.links.forms)]
        forms = np.concatenate([np.zeros((0, FORM), np.float32), *(one.forms for one in seen)])
        rises = np.concatenate([np.zeros(0, int), *(one.rises for one in seen)])
        owners = np.repeat([id(one) for one in seen], [len(one.rises) for one in seen])
        objects = np.array([name for one in seen for name in one.objects], str)
        kept = rng.permutation(np.flatnonzero(np.isfinite(forms).all(1) & (rises != 0)))[:KEPT]
        known = KnownLinks(forms[kept], rises[kept], owners[kept], objects[kept], rng)
        told = [np.concatenate([np.zeros(1), *(known._odds(one, new) * one.rises for one in seen)]) for new in (0, 1)]
        return replace(known, told=(told[0], told[1]))

    def heard(self, board: LabelledTrace) -> LabelledTrace:
        """A board with what looks tell of its links; those of a board that was only drawn tell as much as some
        recorded link's do."""
        new = bool(self.rng.random() < AS_NEW)
        if board.links is None:
            return board
        if len(board.links.forms):
            return replace(board, rising=self._odds(board.links, new))
        return replace(board, rising=board.links.rises * self.rng.choice(self.told[new], len(board.links.rises)))

    def _odds(self, links: LabelledLinks, new: bool | int) -> np.ndarray:
        """Log odds, float (L,), from other boards; from other objects alone if the board's are to be new."""
        own = np.array(links.objects, str)[:, None] == self.objects if new else id(links) == self.boards
        counted = np.where(own, 0, self.rises) * np.ones((len(links.forms), 1))
        told = odds_of(*(torch.from_numpy(one).double() for one in (links.forms, self.forms, counted)))
        return np.asarray(told.numpy())
