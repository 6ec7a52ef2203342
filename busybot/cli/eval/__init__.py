"""`busybot eval`: measure a skill on a dataset."""

from busybot.cli.eval.app import app

__all__ = ["app"]
