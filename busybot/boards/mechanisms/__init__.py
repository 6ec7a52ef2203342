"""What decides a responder's state: one file per kind, whose docstring is its specification."""

from busybot.boards.mechanisms.base import Mechanism
from busybot.boards.mechanisms.registry import OWN, available, kind_named, known_kind, mechanism_of

__all__ = ["OWN", "Mechanism", "available", "kind_named", "known_kind", "mechanism_of"]
