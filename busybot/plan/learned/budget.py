"""How much time a training has had, through all of its interruptions."""

import time


class Budget:
    """Counts seconds while a training runs.

    Args:
        minutes: that it may have.

    Attributes:
        seconds: so far.
    """

    def __init__(self, minutes: float):
        self._limit, self.seconds = 60 * minutes, 0.0
        self._last = time.monotonic()

    def spent(self) -> bool:
        """Count until now; returns whether no time is left."""
        now = time.monotonic()
        self.seconds += now - self._last
        self._last = now
        return self.seconds >= self._limit
