"""Holds boards of a training back to judge by.

Boards of one appearance group look alike, so a group is trained on or held out as a whole.
"""

import math
from typing import Any

from busybot.common.rng import generator


def groups_apart(groups: set[Any], share: float, seed: int, purpose: str) -> set[Any]:
    """The groups that are held out.

    Args:
        share: of them, rounded up; 0 for none. Of a single group none is.
        purpose: of the draw.
    """
    known = sorted(groups)
    order = generator(seed, "train", 0, purpose).permutation(len(known))
    count = math.ceil(share * len(known)) if len(known) > 1 else 0
    return {known[place] for place in order[:count]}
