"""Checks that a recording belongs to its board and to the collection that its dataset describes."""

import json
from typing import Any

from busybot.datasets.info import CollectInfo
from busybot.episodes.mcap.salvage import SALVAGED
from busybot.episodes.tables import Rows

ENDED = "ended"
"""Among the settings of an episode that its policy ended before its last step: {"of": steps that it might have had}."""


def faults_of(rows: Rows, index: int, board_digest: str | None, collect: CollectInfo | None) -> list[str]:
    """What speaks against it, nothing if it belongs there.

    An episode that was saved in part, or that its policy ended, may have fewer steps than the collection if it says
    so.

    Args:
        rows: of the episode, as `tables.episode_rows` returns them.
        board_digest: of board `index`; None if it is not known, likewise `collect`.
    """
    episode = {name: rows["episodes"][name][0].as_py() for name in rows["episodes"].column_names}
    faults = []
    if board_digest is not None and episode["board_digest"] != board_digest:
        faults.append(f"its board is not board {index} of the dataset")
    if collect is None:
        return faults
    pairs = [("policy", collect.policy), ("strict", collect.strict), ("delta", collect.delta)]
    pairs.append(("image_format", collect.images))
    faults += [
        f"{name} is {episode[name]!r}, the dataset says {value!r}"
        for name, value in pairs
        if episode[name] is not None and episode[name] != value
    ]
    if _possible_steps(episode["steps"], json.loads(episode["settings"])) != collect.steps:
        faults.append(f"it has {episode['steps']} steps, the dataset says {collect.steps}")
    return faults


def _possible_steps(steps: int, settings: dict[str, Any]) -> int:
    """How many steps an episode with so many might have had, by its own account; -1 if that contradicts itself."""
    for name in (SALVAGED, ENDED):
        said = settings.get(name)
        if isinstance(said, dict):
            of = said.get("of")
            if not isinstance(of, int) or of < steps:
                return -1
            steps = of
    return steps


def is_partial(settings: dict[str, Any]) -> bool:
    """Whether an episode's settings say that it was saved in part."""
    return isinstance(settings.get(SALVAGED), dict)
