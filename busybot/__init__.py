"""BusyBot: learn to interact, to reason about cause and effect, and to plan on procedurally generated toy boards.

The package follows the way of the data: `objects` -> `boards` -> `sim` -> `episodes` -> `interact`, `reason`, `plan`,
and `view` shows each of them. Nothing is imported or set up here.
"""

__version__ = "0.1.0"
