"""Where a driver keeps its readings until they are taken."""

from typing import Generic, TypeVar

Reading = TypeVar("Reading")

# Ten seconds at 1 kHz. Nobody may be taking, and memory must not grow; a loss shows as a gap in the sequence.
CAPACITY = 10_000


class Inbox(Generic[Reading]):
    """Readings in the order of their arrival, each handed out once; ``count`` is how many were ever put."""

    def __init__(self) -> None:
        self.count = 0
        self._waiting: list[Reading] = []

    def put(self, reading: Reading) -> None:
        self.count += 1
        if len(self._waiting) >= CAPACITY:
            del self._waiting[0]
        self._waiting.append(reading)

    def take(self) -> list[Reading]:
        """What was put since the last call."""
        taken, self._waiting = self._waiting, []
        return taken
