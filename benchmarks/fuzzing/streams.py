"""Serial lines: a device's bytes go astray on the way, and all that is read of them must have been sent."""

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import Protocol

from .damage import damaged
from .outcome import Judged, Outcome

_TOLD_MAX = 5
_PIECE = 64  # random bytes fed between two looks at what was read
_JUNK_SHARE = 0.05
_JUNK_BYTES = (3, 20, 200)
_REMEMBERED = 512  # sent values that may still be read


class Device(Protocol):
    """Both ends of a line: what the device says, and the decoder under test at the host's end."""

    def message(self, random: Random) -> tuple[bytes, object]:
        """Bytes of the next message, and the reading that it stands for."""
        ...

    def told(self, wire: bytes) -> Sequence[object]:
        """What may be read of ``wire`` by its form, where there is no checksum; else nothing."""
        ...

    def hear(self, data: bytes) -> Sequence[object]:
        """The readings that ``data`` complete."""
        ...

    def pause(self) -> None:
        """The message is over."""
        ...

    def close(self) -> None: ...

    @property
    def by_chance(self) -> float:
        """How many damaged messages the checksum should have let through so far."""
        ...


@dataclass
class StreamCodec:
    """``make`` opens a device anew; ``damaged_share`` of its messages are damaged in the second half."""

    name: str
    redundancy: str
    make: Callable[[], Device]
    damaged_share: float = 0.2

    def outcomes(self, count: int, random: Random) -> Iterator[Outcome]:
        """Half of the bytes random, half of them messages with damage and junk; all of it byte by byte."""
        yield self._outcome("random", _Feeder(self.make(), random).feed_noise, count // 2)
        feeder = _Feeder(self.make(), random)
        yield self._outcome("damaged", lambda size: feeder.feed_messages(size, self.damaged_share), count // 2)

    def _outcome(self, fed: str, feed: "Callable[[int], _Feeder]", count: int) -> Outcome:
        begin_s = time.perf_counter()
        fed_by = feed(count)
        seconds = time.perf_counter() - begin_s
        fed_by.device.close()
        return Outcome(self.name, fed, count, "bytes", fed_by.judged, fed_by.exceptions, self.redundancy, seconds)


@dataclass
class _Feeder:
    device: Device
    random: Random
    exceptions: list[str] = field(default_factory=list)
    _sent: deque[tuple[object, bool]] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))  # and whether whole
    _readings: int = 0
    _wrong: int = 0
    _altered: int = 0

    @property
    def judged(self) -> Judged:
        return Judged(self._readings, self._wrong, self.device.by_chance, self._altered)

    def feed_noise(self, count: int) -> "_Feeder":
        for _ in range(0, count, _PIECE):
            self._feed(self.random.randbytes(_PIECE))
        return self

    def feed_messages(self, count: int, damaged_share: float) -> "_Feeder":
        fed = 0
        while fed < count:
            message, value = self.device.message(self.random)
            wire = self._on_its_way(message, damaged_share)
            told = self.device.told(wire)
            if value not in told:
                self._sent.append((value, True))  # damage may still leave what was sent
            self._sent.extend((each, each == value) for each in told)
            self._feed(wire)
            fed += len(wire)
        return self

    def _on_its_way(self, wire: bytes, damaged_share: float) -> bytes:
        if self.random.random() < damaged_share:
            wire = bytes(damaged(wire, self.random))
        if self.random.random() < _JUNK_SHARE:
            wire = self.random.randbytes(self.random.randint(1, self.random.choice(_JUNK_BYTES))) + wire
        return wire

    def _feed(self, wire: bytes) -> None:
        for byte in wire:
            try:
                heard = self.device.hear(bytes((byte,)))
            except Exception as error:
                if len(self.exceptions) < _TOLD_MAX:
                    self.exceptions.append(f"{error!r} upon {wire!r}")
                continue
            for value in heard:
                self._readings += 1
                self._judge(value)
        self.device.pause()

    def _judge(self, value: object) -> None:
        """Readings come in the order in which they were sent."""
        place = next((place for place, (sent, _) in enumerate(self._sent) if sent == value), None)
        if place is None:
            self._wrong += 1
            return
        self._altered += not self._sent[place][1]
        for _ in range(place + 1):
            self._sent.popleft()
