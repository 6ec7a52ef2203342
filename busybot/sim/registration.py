"""Registers the environments with Gymnasium: now if it is imported already, else as soon as it is.

`import busybot` imports this, so that `gymnasium.make("busybot/Board-v0")` works in whatever order both were imported,
and commands that need no environment do not wait for Gymnasium. The simulator is imported by the first `make`.
"""

import sys
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

ENV_ID, PIXELS_ID = "busybot/Board-v0", "busybot/BoardPixels-v0"
PIXELS_SIZE = {"width": 160, "height": 120}
"""Of the pictures of `PIXELS_ID` if nothing else is asked for: what small networks for pictures are made for."""


def register() -> None:
    """Register what is not registered yet; Gymnasium is imported."""
    from gymnasium.envs.registration import WrapperSpec, register, registry

    core, own = "busybot.sim.env:BusyBoardEnv", "busybot.sim.env"
    wrappers = (
        WrapperSpec("PixelActions", f"{own}:PixelActions", {}),
        WrapperSpec("ImageObservations", f"{own}:ImageObservations", {"kind": "rgb"}),
    )
    if ENV_ID not in registry:
        register(ENV_ID, core)
        register(PIXELS_ID, core, kwargs={"render": PIXELS_SIZE}, additional_wrappers=wrappers)


class _WhenImported:
    """Stands before the finders of modules until Gymnasium is imported, and registers then."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if name != "gymnasium":
            return None
        others = (finder.find_spec(name, path, target) for finder in sys.meta_path if finder is not self)
        spec = next(filter(None, others), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                register()
                sys.meta_path.remove(self)

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


if "gymnasium" in sys.modules:
    register()
else:
    sys.meta_path.insert(0, _WhenImported())
