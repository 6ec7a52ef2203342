"""Episodes that are hard to explain: of boards with more links than most, and such as no law would have led to.

All are symbolic, as `tests.episodes.symbolic` makes them.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from busybot.boards.config import BoardConfig
from busybot.boards.generate import generate_boards
from busybot.episodes.episode import Episode, Image
from tests.episodes import symbolic

DRAWN = 10
"""Objects that have a colour of their own."""
LINKS = (11, 13)


def large_episodes(folder: Path, world: str, boards: int) -> list[Episode]:
    """Of boards of a world with so many links, of the objects in a folder."""
    room = {"switches": (6, 7), "responders": (6, 7), "toys": (0, 1), "max_objects": 14}
    told = {"world": world, "boards": boards, "group_size": 1, "links": LINKS, **room}
    library = symbolic.library_at(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(symbolic, "_draw", _drawing(symbolic._draw))
        drawn = generate_boards(BoardConfig.model_validate(told), library)
        return [symbolic.make_world_episode(board, library) for board in drawn]


def contradicted(episode: Episode) -> Episode:
    """The same, but that a responder shows at last what it cannot show: so the board's law is not known."""
    last, responder = episode.steps[-1], episode.board.relations[0].responder
    shown = [1 - state if index == responder else state for index, state in enumerate(last.responder_states_after)]
    return replace(episode, steps=[*episode.steps[:-1], replace(last, responder_states_after=tuple(shown))])


def _drawing(draw: Any) -> Any:
    """The first objects are drawn, those behind them are where the last of these is."""

    def some(board: Any, *state: Any) -> Image:
        image = draw(board.model_copy(update={"objects": board.objects[:DRAWN]}), *state)
        more = np.repeat(image.boxes[-1:], len(board.objects) - len(image.boxes), axis=0)
        return replace(image, boxes=np.concatenate([image.boxes, more]))

    return some
