"""`busybot dataset`: look at a dataset, check it, repair it, freeze it, compare it, make it again, share it."""

from busybot.cli.dataset.app import app

__all__ = ["app"]
