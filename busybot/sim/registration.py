"""Importing this module registers the environment: the one import of ours that does something.

That is how Gymnasium finds environments: `gymnasium.make("busybot.sim.registration:busybot/Board-v0")` imports the part
before the colon, and after `import busybot.sim.registration` the id alone will do.
"""

import gymnasium

ENV_ID = "busybot/Board-v0"

gymnasium.register(ENV_ID, entry_point="busybot.sim.env:BusyBoardEnv")
