"""What one half-duplex line can carry: the time of a cycle, worked out from baud, packets and delays.

In each cycle the master writes the goals of all servos, asks for their readings, and is answered. A character is ten
bits; each servo waits for its return delay before it answers; the adapter takes its time, there and back.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby

from norton_drivers.codecs.half_duplex import Dialect
from norton_drivers.errors import WiringError
from norton_drivers.serial_timing import BITS_PER_BYTE
from norton_drivers.wiring import DeviceSettings


@dataclass(frozen=True)
class Registers:
    """Some of a servo's registers: where they begin, and how many bytes they are."""

    address: int
    length: int


@dataclass(frozen=True)
class Share:
    """One servo's part of a cycle: the registers of its goal, and those that are read; how long it waits with its
    answer."""

    node: int
    goal: Registers
    reading: Registers
    return_delay_s: float


@dataclass(frozen=True)
class LineTiming:
    """How fast the line is, and how long its adapter takes, there and back."""

    baud: int
    latency_s: float

    def wire_s(self, count: int) -> float:
        """How long so many bytes take."""
        return count * BITS_PER_BYTE / self.baud

    def cycle_s(self, dialect: Dialect, shares: Sequence[Share]) -> float:
        """How long one cycle of these servos takes."""
        sent = sum(len(goals_packet(dialect, part)) for part in together(shares, lambda share: share.goal))
        parts = read_together(dialect, shares)
        asked = sum(len(dialect.sync_read(0, part[0].reading.length, [share.node for share in part])) for part in parts)
        answered = sum(dialect.overhead + share.reading.length for share in shares)
        waited_s = sum(share.return_delay_s for share in shares)
        return self.wire_s(sent + asked + answered) + waited_s + len(parts) * self.latency_s


def goals_packet(dialect: Dialect, part: Sequence[Share]) -> bytes:
    """A packet as long as that which carries the goals of servos that have them in the same registers."""
    goal = part[0].goal
    return dialect.sync_write(goal.address, {share.node: bytes(goal.length) for share in part})


def together(shares: Sequence[Share], key: Callable[[Share], Registers]) -> list[list[Share]]:
    """Those that one packet can reach together, in the order of their ids."""
    by_place = sorted(shares, key=lambda share: (key(share).address, key(share).length, share.node))
    return [list(part) for _, part in groupby(by_place, key)]


def read_together(dialect: Dialect, shares: Sequence[Share]) -> list[list[Share]]:
    """Those whose readings one question asks for."""
    parts = together(shares, lambda share: share.reading)
    return parts if dialect.reads_together else [[share] for part in parts for share in part]


def check_line(
    dialect: Dialect, timing: LineTiming, shares: Sequence[Share], settings: Sequence[DeviceSettings], tick_ns: int
) -> None:
    """Whether the line carries a cycle in every tick. Raises WiringError, with what it does carry and the remedies."""
    cycle_s, tick_s = timing.cycle_s(dialect, shares), tick_ns * 1e-9
    if cycle_s <= tick_s:
        return
    who = " and ".join(f"[{each.role}]" for each in settings)
    own_s = cycle_s - timing.latency_s * len(read_together(dialect, shares))
    slower_hz = int(1 / cycle_s / 10) * 10
    raise WiringError(
        f"{who} port {settings[0].port}: at {timing.baud} baud one cycle of goals and readings takes "
        f"{own_s * 1e3:.2g} ms on the line and {(cycle_s - own_s) * 1e3:.2g} ms in the adapter: "
        f'{1 / cycle_s:.0f} Hz at most, not {1 / tick_s:g} Hz; write rate = "{slower_hz} Hz", or raise '
        "baud or shorten return_delay or latency, in the devices and here"
    )
