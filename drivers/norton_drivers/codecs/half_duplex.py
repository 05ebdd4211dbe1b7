"""What codecs of servos on a half-duplex line share: the master asks for registers, and the servo asked answers."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

Packet = TypeVar("Packet")


class Answer(NamedTuple):
    """What one servo said. ``error`` is the error byte; ``later_bytes`` came after it in the same chunk."""

    node: int
    error: int
    data: bytes = b""
    later_bytes: int = 0


class PacketStream(Generic[Packet]):
    """Finds packets in a byte stream; what it finds does not depend on how the stream is cut.

    ``discarded_bytes`` counts those that belong to none, ``bad_checksums`` the packets whose checksum was wrong.
    """

    header: ClassVar[bytes]
    head_bytes: ClassVar[int]  # header and all that tells the length

    def __init__(self) -> None:
        self.discarded_bytes = 0
        self.bad_checksums = 0
        self._buffer = bytearray()

    def _length(self, head: bytearray) -> int | None:
        """Of the packet that begins so; None where none can."""
        raise NotImplementedError

    def _unpacked(self, frame: bytes, later_bytes: int) -> Packet | None:
        """None where the checksum is wrong."""
        raise NotImplementedError

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that ``data`` completes, oldest first. Never raises."""
        self._buffer += data
        packets: list[Packet] = []
        while (length := self._first_length()) <= len(self._buffer):
            packet = self._unpacked(bytes(self._buffer[:length]), len(self._buffer) - length)
            if packet is None:
                self.bad_checksums += 1
                self._discard(1)
            else:
                del self._buffer[:length]
                packets.append(packet)
        return packets

    def drop(self) -> None:
        """Forget the packet that has begun."""
        self._discard(len(self._buffer))

    def _first_length(self) -> int:
        """The length of the packet that the buffer begins with, after what cannot begin one is discarded; more than it
        holds, where that is not known yet."""
        while self._buffer:
            start = self._buffer.find(self.header)
            # Without a header, its first bytes may be at the end.
            begun = range(len(self.header) - 1, 0, -1)
            kept = next((count for count in begun if self._buffer.endswith(self.header[:count])), 0)
            self._discard(start if start >= 0 else len(self._buffer) - kept)
            if start < 0 or len(self._buffer) < self.head_bytes:
                break
            if (length := self._length(self._buffer)) is not None:
                return length
            self._discard(1)
        return len(self._buffer) + 1

    def _discard(self, count: int) -> None:
        self.discarded_bytes += count
        del self._buffer[:count]


class AnswerStream(Generic[Packet]):
    """Finds answers in a byte stream, however it is cut. ``packets`` counts what is none."""

    def __init__(self, packets: PacketStream[Packet]) -> None:
        self.packets = packets

    def _answers_in(self, packet: Packet) -> Iterable[Answer]:
        raise NotImplementedError

    def feed(self, data: bytes) -> list[Answer]:
        """The answers that ``data`` completes, oldest first. Never raises."""
        return [answer for packet in self.packets.feed(data) for answer in self._answers_in(packet)]

    def drop(self) -> None:
        """Forget what has begun: what comes next is the beginning of an answer."""
        self.packets.drop()


class Dialect(Protocol):
    """The questions of one protocol, and how long its answers are."""

    overhead: int  # bytes of an answer beside its data
    reads_together: bool  # whether several servos can be asked at once

    def answers(self) -> AnswerStream[Any]:
        """The one stream of this line."""
        ...

    def ping(self, node: int) -> bytes: ...

    def read(self, node: int, address: int, length: int) -> bytes: ...

    def sync_read(self, address: int, length: int, nodes: Sequence[int]) -> bytes:
        """Each node answers for itself, in this order; one node where the protocol cannot ask several."""
        ...

    def sync_write(self, address: int, values: Mapping[int, bytes]) -> bytes:
        """By node; all values have the same length. Nobody answers."""
        ...
