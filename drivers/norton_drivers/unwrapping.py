"""Positions that begin anew after a turn, or after their range, made to go on."""


class Unwrapped:
    """Follows a reading that comes modulo ``span``, in the reading's own steps; ``total`` is where it has got to."""

    def __init__(self, span: int) -> None:
        self._span = span
        self._last: int | None = None
        self.total = 0

    def follow(self, reading: int, expected_change: float = 0.0) -> int:
        """The new total: of all that agree with ``reading``, the one nearest to the ``expected_change``."""
        if self._last is None:
            self.total = reading
        else:
            change = reading - self._last
            self.total += change + self._span * round((expected_change - change) / self._span)
        self._last = reading
        return self.total
