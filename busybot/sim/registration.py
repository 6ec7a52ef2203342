"""Gymnasium's id of the environment.

`pyproject.toml` names `register` as a plugin of Gymnasium, which calls it when it is imported: then
`gymnasium.make("busybot/Board-v0")` works without importing anything of ours.
"""

import gymnasium

ENV_ID = "busybot/Board-v0"


def register() -> None:
    """Register the environment; safe to call twice."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(ENV_ID, entry_point="busybot.sim.env:BusyBoardEnv")
