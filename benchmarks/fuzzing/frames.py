"""CAN: a driver hears frames, and another decoder says what is to be heard."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import isclose
from random import Random
from typing import Protocol

import can

from .damage import damaged_frame, random_frame
from .outcome import Judged, Outcome

Values = Sequence[tuple[float, ...]]
_TOLD_MAX = 5
_SAME = {"rel_tol": 1e-9, "abs_tol": 1e-12}


class Listener(Protocol):
    """The decoder under test: what it makes of a frame."""

    def hear(self, frame: can.Message) -> Values: ...
    def close(self) -> None: ...


@dataclass
class FrameCodec:
    """``good`` makes a frame of the device's own; ``truth`` says what is to be read in any frame. ``fd``: of CAN FD."""

    name: str
    redundancy: str
    identifiers: tuple[int, ...]
    good: Callable[[Random], can.Message]
    listener: Listener
    truth: Callable[[can.Message], Values]
    fd: bool = False

    def outcomes(self, count: int, random: Random) -> Iterator[Outcome]:
        """Half of the frames random, half of them good ones that were damaged."""
        half = count // 2
        yield self._outcome("random", half, lambda: random_frame(random, self.identifiers, fd=self.fd))
        yield self._outcome("damaged", half, lambda: damaged_frame(self.good(random), random))
        self.listener.close()

    def _outcome(self, fed: str, count: int, make: Callable[[], can.Message]) -> Outcome:
        readings = wrong = 0
        exceptions: list[str] = []
        begin_s = time.perf_counter()
        for _ in range(count):
            frame = make()
            expected = self.truth(frame)
            try:
                heard = self.listener.hear(frame)
            except Exception as error:
                if len(exceptions) < _TOLD_MAX:
                    exceptions.append(f"{error!r} upon {frame}")
                continue
            readings += len(heard)
            wrong += not _same(heard, expected)
        seconds = time.perf_counter() - begin_s
        return Outcome(self.name, fed, count, "frames", Judged(readings, wrong), exceptions, self.redundancy, seconds)


def _same(heard: Values, expected: Values) -> bool:
    if len(heard) != len(expected):
        return False
    return all(
        len(one) == len(other) and all(isclose(a, b, **_SAME) for a, b in zip(one, other, strict=True))
        for one, other in zip(heard, expected, strict=True)
    )
