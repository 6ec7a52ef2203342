"""BusyBot: learn to interact, to reason about cause and effect, and to plan on procedurally generated toy boards.

The package follows the way of the data: `objects` -> `boards` -> `sim` -> `episodes` -> `interact`, `reason`, `plan`,
and `view` shows each of them. What is offered here is imported when it is first used:

    load_dataset    a recorded dataset: episodes, frames for PyTorch, graphs for PyTorch Geometric, tables for pandas
    load_model      a trained model by name or folder
    make_board      one board, drawn from a seed
    Board, Dataset, Episode     what these return and hold

Importing the package also registers `busybot/Board-v0` and `busybot/BoardPixels-v0` with Gymnasium.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from busybot.sim import registration as _registration  # noqa: F401

if TYPE_CHECKING:
    from busybot.api import Dataset, load_dataset, make_board
    from busybot.boards.spec import BoardSpec as Board
    from busybot.episodes.episode import Episode
    from busybot.models import load_model

__version__ = "0.1.0"
__all__ = ["Board", "Dataset", "Episode", "__version__", "load_dataset", "load_model", "make_board"]

_OFFERED = {
    "Board": ("boards.spec", "BoardSpec"),
    "Dataset": ("api", "Dataset"),
    "Episode": ("episodes.episode", "Episode"),
    "load_dataset": ("api", "load_dataset"),
    "load_model": ("models", "load_model"),
    "make_board": ("api", "make_board"),
}
"""Module and name of what is imported when it is first used (PEP 562)."""


def __getattr__(name: str) -> Any:
    if name not in _OFFERED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, own_name = _OFFERED[name]
    return getattr(import_module(f"{__name__}.{module}"), own_name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
