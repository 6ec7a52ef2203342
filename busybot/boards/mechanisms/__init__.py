"""What decides a responder's state: one file per kind, whose docstring is its specification."""

from busybot.boards.mechanisms.base import Mechanism
from busybot.boards.mechanisms.registry import available, mechanism_of

__all__ = ["Mechanism", "available", "mechanism_of"]
