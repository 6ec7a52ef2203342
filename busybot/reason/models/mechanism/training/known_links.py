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
        told: of links of boards as known ones, and as if they were new, log odds of what is true.
    """

    forms: np.ndarray
    rises: np.ndarray
    boards: np.ndarray
    objects: np.ndarray
    told: tuple[np.ndarray, np.ndarray] = (np.zeros(1), np.zeros(1))

    @staticmethod
    def of(boards: Sequence[LabelledTrace], rng: np.random.Generator) -> "KnownLinks":
        """Those of which it is known which way round they are, `KEPT` of them at most, drawn if there are more."""
        seen = [board.links for board in boards if board.links is not None and len(board.links.forms)]
        forms = np.concatenate([np.zeros((0, FORM), np.float32), *(one.forms for one in seen)])
        rises = np.concatenate([np.zeros(0, int), *(one.rises for one in seen)])
        owners = np.repeat([id(one) for one in seen], [len(one.rises) for one in seen])
        objects = np.array([name for one in seen for name in one.objects], str)
        kept = rng.permutation(np.flatnonzero(np.isfinite(forms).all(1) & (rises != 0)))[:KEPT]
        known = KnownLinks(forms[kept], rises[kept], owners[kept], objects[kept])
        told = [[known._odds(one.forms, known._others(one, new)) * one.rises for one in seen] for new in (False, True)]
        as_known, as_new = (np.concatenate([np.zeros(1), *each]) for each in told)
        return replace(known, told=(as_known, as_new))

    def heard(self, board: LabelledTrace, rng: np.random.Generator) -> LabelledTrace:
        """A board with what looks tell of its links, in all of the recording and in its parts; those of a board that
        was only drawn tell as much as some recorded link's do."""
        new = bool(rng.random() < AS_NEW)
        if board.links is None:
            return board
        if len(board.links.forms):
            others = self._others(board.links, new)
            parts = tuple(
                replace(one, rising=None if one.touched.forms is None else self._odds(one.touched.forms, others))
                for one in board.triggers
            )
            return replace(board, rising=self._odds(board.links.forms, others), triggers=parts)
        signs = rng.choice((-1, 1), len(board.links.rises))  # what is no link looks like one, either way round
        signs = np.where(board.links.rises, board.links.rises, signs)
        return replace(board, rising=signs * rng.choice(self.told[new], len(signs)))

    def _others(self, links: LabelledLinks, new: bool) -> np.ndarray:
        """Which known links are of other boards, bool (N,); if the board's objects are to be new, of other objects."""
        return ~np.isin(self.objects, links.objects) if new else self.boards != id(links)

    def _odds(self, forms: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Log odds, float (L,), of links of these forms, float32 (L, FORM)."""
        known = (forms, self.forms, np.where(others, self.rises, 0))
        return np.asarray(odds_of(*(torch.from_numpy(one).double() for one in known)).numpy())
