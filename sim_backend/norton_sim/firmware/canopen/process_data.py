"""Process data as the communication and mapping parameters say: received PDOs into objects, objects into sent ones.

Source: CiA 301, objects 1400h, 1600h, 1800h, 1A00h. A mapping can be changed only while its PDO is switched off and its
number of entries is zero, and only before the node is operational.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from struct import Struct

from norton_drivers.codecs import canopen as protocol
from norton_sim.firmware.canopen.objects import U8, U16, U32, AbortError, Entry, Objects
from norton_sim.world import World


class Timer:
    """A device's timer: an action each so many milliseconds of its own clock, until it is stopped or set anew.

    ``clock_ppm`` is how much slower than the world's its clock goes, in parts per million.
    """

    def __init__(self, world: World, clock_ppm: float) -> None:
        self._world = world
        self._ns_per_ms = 1e6 * (1 + clock_ppm * 1e-6)
        self.running = False
        self._period_ns = 0
        self._action: Callable[[], None] = _nothing
        self._round = 0  # of which start; what an earlier one has planned is void

    def start(self, period_ms: float, action: Callable[[], None]) -> None:
        """First after one period; a period of zero stops it."""
        self.stop()
        self._period_ns = round(period_ms * self._ns_per_ms)
        self._action = action
        self.running = self._period_ns > 0
        if self.running:
            self._plan(self._round)

    def stop(self) -> None:
        self.running = False
        self._round += 1

    def _plan(self, started: int) -> None:
        self._world.at(self._world.now_ns + self._period_ns, lambda _stamp_ns: self._ring(started))

    def _ring(self, started: int) -> None:
        if started == self._round:
            self._plan(started)
            self._action()


def _nothing() -> None:
    """Never rings."""


_ENTRIES_MAX = 8
_BITS_MAX = 64
_SYNCHRONOUS_MAX = 240
_COB_MASK = 0x7FF


class Pdo:
    """Communication and mapping parameters of one PDO in the object dictionary.

    ``locked`` says whether the node is operational: its process data are then exchanged, and cannot be changed.
    """

    def __init__(
        self, objects: Objects, communication: int, identifier: int, mapped: Sequence[int], locked: Callable[[], bool]
    ) -> None:
        self._objects = objects
        self._locked = locked
        self._entries: list[Entry] = []
        self._layout = Struct("<")
        mapping = communication + 0x200
        add = objects.add
        self._cob_id = add(communication, 1, Entry(U32, identifier, writable=True, written=self._cob_id_written))
        self._type = add(communication, 2, Entry(U8, protocol.EVENT_DRIVEN, writable=True, written=self._type_written))
        self._timer_ms = add(communication, 5, Entry(U16, 0, writable=True))
        self._count = add(mapping, 0, Entry(U8, len(mapped), writable=True, written=self._count_written))
        words = [*mapped, *[0] * (_ENTRIES_MAX - len(mapped))]
        self._words = [
            add(mapping, number, Entry(U32, word, writable=True, written=self._word_written))
            for number, word in enumerate(words, start=1)
        ]

    @property
    def enabled(self) -> bool:
        return not self._cob_id.value & protocol.PDO_NOT_VALID

    @property
    def identifier(self) -> int:
        return self._cob_id.value & _COB_MASK

    @property
    def synchronous(self) -> bool:
        return self._type.value <= _SYNCHRONOUS_MAX

    def begin(self) -> None:
        """The node has become operational: make ready what its parameters say."""
        self._entries = [self._entry_of(word.value) for word in self._words[: self._count.value]]
        # The same layouts side by side, without padding.
        self._layout = Struct("<" + "".join(entry.layout.format.lstrip("<") for entry in self._entries))

    def _entry_of(self, word: int) -> Entry:
        entry = self._objects.entry(word >> 16, word >> 8 & 0xFF)
        if not entry.mappable or entry.bits != word & 0xFF:
            raise AbortError(protocol.ABORT_NOT_MAPPABLE)
        return entry

    def _cob_id_written(self, value: int) -> None:
        moved = (value ^ self._cob_id.value) & _COB_MASK
        if self._locked() or (moved and self.enabled and not value & protocol.PDO_NOT_VALID):
            raise AbortError(protocol.ABORT_DEVICE_STATE)

    def _type_written(self, value: int) -> None:
        if _SYNCHRONOUS_MAX < value < protocol.EVENT_DRIVEN - 1:
            raise AbortError(protocol.ABORT_VALUE)

    def _count_written(self, count: int) -> None:
        self._check_changeable()
        if count > _ENTRIES_MAX:
            raise AbortError(protocol.ABORT_PDO_TOO_LONG)
        entries = [self._entry_of(word.value) for word in self._words[:count]]
        if sum(entry.bits for entry in entries) > _BITS_MAX:
            raise AbortError(protocol.ABORT_PDO_TOO_LONG)

    def _word_written(self, word: int) -> None:
        self._check_changeable()
        if self._count.value:
            raise AbortError(protocol.ABORT_DEVICE_STATE)
        self._entry_of(word)

    def _check_changeable(self) -> None:
        if self._locked() or self.enabled:
            raise AbortError(protocol.ABORT_DEVICE_STATE)


class ReceivedPdo(Pdo):
    """Its frame is obeyed when it comes, or at the next SYNC."""

    def begin(self) -> None:
        super().begin()
        self._waiting: tuple[int, ...] | None = None

    def receive(self, data: bytes | bytearray) -> bool:
        """One frame; False where it is too short for the mapping."""
        if len(data) < self._layout.size:
            return False
        values = self._layout.unpack_from(data)
        if self.synchronous:
            self._waiting = values
        else:
            self._obey(values)
        return True

    def sync(self) -> None:
        """A SYNC has come."""
        if self._waiting is not None:
            values, self._waiting = self._waiting, None
            self._obey(values)

    def _obey(self, values: tuple[int, ...]) -> None:
        for entry, value in zip(self._entries, values, strict=True):
            with suppress(AbortError):  # there is nobody to tell
                entry.set(value)


class SentPdo(Pdo):
    """Sent at every so many SYNCs, or at an event and each time its timer has run out."""

    def __init__(
        self,
        objects: Objects,
        communication: int,
        identifier: int,
        mapped: Sequence[int],
        locked: Callable[[], bool],
        *,
        timer: Timer,
        send: Callable[[int, bytes], None],
    ) -> None:
        super().__init__(objects, communication, identifier, mapped, locked)
        self._timer = timer
        self._send = send
        self._syncs = 0
        objects.add(communication, 3, Entry(U16, 0, writable=True))

    def begin(self) -> None:
        super().begin()
        self._syncs = 0
        if self.enabled and not self.synchronous:
            self.send()
            self._timer.start(self._timer_ms.value, self.send)

    def end(self) -> None:
        """The node is no longer operational."""
        self._timer.stop()

    def sync(self) -> None:
        """A SYNC has come."""
        if not (self.enabled and self.synchronous and self._type.value):
            return
        self._syncs += 1
        if self._syncs >= self._type.value:
            self._syncs = 0
            self.send()

    def event(self) -> None:
        """Something in it has changed."""
        if self._locked() and self.enabled and not self.synchronous:
            self.send()

    def send(self) -> None:
        self._send(self.identifier, self._layout.pack(*[entry.get() for entry in self._entries]))
