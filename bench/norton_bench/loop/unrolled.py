"""An array whose values are asked for one by one, in order, by a loop that must not stop for it."""

import numpy as np

from norton_bench.arrays import FloatArray

CHUNK = 512
# Who looks ahead by less than this does not make chunks be unrolled again and again.
BACK = 64


class Unrolled:
    """Items of ``values`` (n,) as Python's floats, whose use costs a tick a fifth of what an array's items cost.

    They are unrolled in chunks as they are asked for: of a segment of 20 s all at once take 20 ms where the memory for
    them is new to the process, and the loop stands still for as long.
    """

    def __init__(self, values: FloatArray) -> None:
        self._values = np.asarray(values, dtype=np.float64)
        self._first = self._end = 0
        self._chunk: list[float] = []

    def __len__(self) -> int:
        return len(self._values)

    def __getitem__(self, index: int) -> float:
        if not self._first <= index < self._end:
            self._unroll(index)
        return self._chunk[index - self._first]

    def _unroll(self, index: int) -> None:
        self._first = max(index - BACK, 0)
        self._chunk = self._values[self._first : index + CHUNK].tolist()
        self._end = self._first + len(self._chunk)
