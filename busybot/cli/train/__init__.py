"""`busybot train`: learn a skill from recorded files."""

from busybot.cli.train.app import app

__all__ = ["app"]
