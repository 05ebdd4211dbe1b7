"""A VESC's packets of more than one frame: pieces get lost, doubled, changed, out of order, and mixed with others."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from random import Random

from norton_drivers.codecs.vesc import Assembler, Packet, frames_of

from .damage import damaged
from .outcome import Judged, Outcome

_PIECES = (Packet.FILL_RX_BUFFER, Packet.FILL_RX_BUFFER_LONG, Packet.PROCESS_RX_BUFFER)
_MISSED = 2.0**-16  # of damaged packets, by a checksum of 16 bits; of noise, the length must be right too
_TOLD_MAX = 5

Piece = tuple[int, bytes]  # kind of frame, and its data


@dataclass
class PacketCodec:
    """Short packets are frames as others are, and not among these."""

    name: str = "VESC packets"
    redundancy: str = "CRC-16: one damaged packet in 65536"

    def outcomes(self, count: int, random: Random) -> Iterator[Outcome]:
        yield self._outcome("random", count // 2, lambda: ([_random_piece(random)], None), _MISSED**2)
        yield self._outcome("damaged", count // 2, lambda: _packet(random), _MISSED)

    def _outcome(
        self, fed: str, count: int, make: Callable[[], tuple[list[Piece], bytes | None]], missed: float
    ) -> Outcome:
        assembler, readings, wrong, frames = Assembler(), 0, 0, 0
        exceptions: list[str] = []
        begin_s = time.perf_counter()
        while frames < count:
            pieces, payload = make()
            frames += len(pieces)
            for packet, data in pieces:
                try:
                    received = assembler.feed(packet, data)
                except Exception as error:
                    exceptions = [*exceptions, f"{error!r} upon {packet} {data!r}"][:_TOLD_MAX]
                    continue
                if received is not None:
                    readings += 1
                    wrong += received.payload != payload
        seconds = time.perf_counter() - begin_s
        judged = Judged(readings, wrong, assembler.malformed * missed)
        return Outcome(self.name, fed, frames, "frames", judged, exceptions, self.redundancy, seconds)


def _random_piece(random: Random) -> Piece:
    return random.choice(_PIECES), random.randbytes(random.randint(0, 8))


def _packet(random: Random) -> tuple[list[Piece], bytes]:
    payload = random.randbytes(random.randint(7, 300))
    pieces: list[Piece] = [
        (frame.arbitration_id >> 8, frame.data) for frame in frames_of(payload, sender=23, receiver=9, handling=1)
    ]
    if random.random() < 0.5:
        _spoil(pieces, random)
    return pieces, payload


def _spoil(pieces: list[Piece], random: Random) -> None:
    at = random.randrange(len(pieces))
    packet, data = pieces[at]
    match random.randrange(5):
        case 0:
            del pieces[at]
        case 1:
            pieces[at] = packet, bytes(damaged(data, random)[:8])
        case 2:
            pieces.insert(at, pieces[at])
        case 3:
            pieces.insert(at, _random_piece(random))
        case _:
            other = random.randrange(len(pieces))
            pieces[at], pieces[other] = pieces[other], pieces[at]
