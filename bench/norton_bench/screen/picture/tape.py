"""The last stretch of the ticks, in columns that can be drawn without copying."""

import numpy as np

from norton_bench.records import TICK, Table


class Tape:
    """Keeps the last ``length`` rows; :meth:`rows` gives them as one piece."""

    def __init__(self, length: int) -> None:
        self._length = length
        self._rows: Table = np.zeros(2 * length, TICK)
        self._end = 0

    def append(self, ticks: Table) -> None:
        """Rows that follow; of more than there is room for, the last."""
        ticks = ticks[-self._length :]
        if self._end + len(ticks) > len(self._rows):
            kept = self.rows()[-self._length :].copy()
            self._rows[: len(kept)] = kept
            self._end = len(kept)
        self._rows[self._end : self._end + len(ticks)] = ticks
        self._end += len(ticks)

    def rows(self) -> Table:
        """The rows kept, oldest first: a view, good until the next append."""
        return self._rows[max(0, self._end - self._length) : self._end]

    def since(self, stamp_ns: int) -> Table:
        """The rows from ``stamp_ns`` on."""
        rows = self.rows()
        return rows[np.searchsorted(rows["tick_ns"], stamp_ns) :]
