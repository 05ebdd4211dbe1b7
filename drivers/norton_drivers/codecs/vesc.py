"""VESC on CAN: commands and status messages of one frame, for either end of the wire.

Extended (29-bit) identifiers are ``packet << 8 | controller id``; payloads are big-endian. The firmware casts to
integers, which cuts off what is beyond the last digit: :func:`middle` gives back what is lost on average. Sources:
vedderb/bldc, documentation/comm_can.md (identifiers, scales, the vector of 51 A to controller 23), comm/comm_can.c
(``comm_can_send_status1``, ``4``, ``5``: what is sent and how it is cast) and datatypes.h (``CAN_PACKET_ID``).
"""

from binascii import crc_hqx
from collections.abc import Iterator
from enum import IntEnum
from math import copysign, isfinite
from struct import Struct
from typing import NamedTuple, Self

from norton_drivers.codecs.common import CodecError

NODE_MAX = 0xFE
EVERYBODY = 0xFF

CURRENT_STEP_A = 0.1  # in STATUS
ERPM_STEP = 1.0
POSITION_STEP_DEG = 0.02  # in STATUS_4
TACHOMETER_PER_ELECTRICAL_TURN = 6
TACHOMETER_SPAN = 1 << 32

_COMMAND = Struct(">i")
_STATUS = Struct(">ihh")
_STATUS_4 = Struct(">hhhh")
_STATUS_5 = Struct(">ihxx")
_I32 = (1 << 31) - 1
_I16 = (1 << 15) - 1
_CURRENT_SCALE = 1e3
_DUTY_SCALE = 1e5
_WITH_OFF_DELAY = 6  # bytes


class Packet(IntEnum):
    """What a frame is: bits 8 to 15 of its identifier."""

    SET_DUTY = 0
    SET_CURRENT = 1
    FILL_RX_BUFFER = 5
    FILL_RX_BUFFER_LONG = 6
    PROCESS_RX_BUFFER = 7
    PROCESS_SHORT_BUFFER = 8
    STATUS = 9
    STATUS_4 = 16
    PING = 17
    PONG = 18
    STATUS_5 = 27


def arbitration_id(packet: int, node: int) -> int:
    """The 29-bit identifier. Raises CodecError for a controller id that cannot be."""
    if not 0 <= node <= EVERYBODY:
        raise CodecError(f"controller id {node} is not in 0 to {NODE_MAX}")
    return packet << 8 | node


def split_id(identifier: int) -> tuple[int, int]:
    """``(packet, controller id)``; the packet need not be one that is known here."""
    return identifier >> 8, identifier & 0xFF


def middle(value: float, step: float) -> float:
    """The middle of the numbers that are cut down to ``value``, a multiple of ``step``: towards zero, as C casts."""
    return value + copysign(0.5 * step, value) if value else 0.0


def current_value(current_a: float) -> bytes:
    """The payload of SET_CURRENT, to the nearest milliampere: four bytes.

    Never six: see :func:`current_of`. Raises CodecError for what is no number or does not fit.
    """
    return _command("current", current_a, _CURRENT_SCALE)


def current_of(data: bytes | bytearray) -> float:
    """The current [A] that the firmware reads in the payload of SET_CURRENT.

    Six bytes are meant to be a current with an "off delay" behind it, but the firmware reads the delay from the first
    two and the current from the next four (comm_can.c, ``decode_msg``).
    """
    return _commanded("current", data[2:] if len(data) >= _WITH_OFF_DELAY else data) / _CURRENT_SCALE


def duty_value(duty: float) -> bytes:
    """The payload of SET_DUTY, a share of the supply's voltage from -1 to 1. Raises CodecError, as current_value."""
    return _command("duty cycle", duty, _DUTY_SCALE)


def duty_of(data: bytes | bytearray) -> float:
    """The duty cycle in the payload of SET_DUTY."""
    return _commanded("duty cycle", data) / _DUTY_SCALE


class Status(NamedTuple):
    """Electrical speed, motor current and duty cycle.

    ``drawn_a`` is positive where the motor draws power and negative where it generates, whichever way it turns
    (mcpwm_foc.c, ``mcpwm_foc_get_tot_current_filtered``); ``duty`` has the sign of the voltage, so that
    :attr:`current_a` has the sign of the torque.
    """

    erpm: float
    drawn_a: float
    duty: float

    @property
    def current_a(self) -> float | None:
        """The current with the sign of its torque; None where the voltage is too small to show its sign."""
        if not self.drawn_a:
            return 0.0
        return copysign(1.0, self.duty) * self.drawn_a if self.duty else None

    def encode(self) -> bytes:
        return _STATUS.pack(_cut(self.erpm, _I32), _cut(self.drawn_a * 1e1, _I16), _cut(self.duty * 1e3, _I16))

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        erpm, current, duty = _unpacked(_STATUS, data, "STATUS")
        return cls(float(erpm), current / 10, duty / 1000)


class Status4(NamedTuple):
    """Temperatures, current from the supply, and the shaft's angle from 0 to 360 degrees."""

    transistor_c: float
    motor_c: float
    supply_a: float
    position_deg: float

    def encode(self) -> bytes:
        tenths = (_cut(value * 1e1, _I16) for value in self[:3])
        return _STATUS_4.pack(*tenths, _cut(self.position_deg * 50.0, _I16))

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        transistor, motor, supply, position = _unpacked(_STATUS_4, data, "STATUS_4")
        return cls(transistor / 10, motor / 10, supply / 10, position / 50)


class Status5(NamedTuple):
    """Sixths of an electrical turn, counted since the drive was switched on, and the supply's voltage."""

    tachometer: int
    supply_v: float

    def encode(self) -> bytes:
        wrapped = (self.tachometer + _I32 + 1) % TACHOMETER_SPAN - _I32 - 1
        return _STATUS_5.pack(wrapped, _cut(self.supply_v * 1e1, _I16))

    @classmethod
    def decode(cls, data: bytes | bytearray) -> Self:
        # The two reserved bytes at the end need not be there.
        tachometer, supply = _unpacked(_STATUS_5, bytes(data).ljust(8, b"\0") if len(data) >= 6 else data, "STATUS_5")
        return cls(tachometer, supply / 10)


def pong_value(node: int, hardware_type: int = 0) -> bytes:
    """The payload of PONG: who answers, and what it is (0: a motor controller)."""
    return bytes((node, hardware_type))


def pong_of(data: bytes | bytearray) -> tuple[int, int]:
    """Who answers, and what it is; firmware of old leaves the second out."""
    if not data:
        raise CodecError("PONG: empty")
    return data[0], data[1] if len(data) > 1 else 0


def _command(name: str, value: float, scale: float) -> bytes:
    if not isfinite(value):
        raise CodecError(f"{name}: not a finite number")
    if abs(value) * scale > _I32:
        raise CodecError(f"{name}: {value:g} does not fit into the frame")
    return _COMMAND.pack(round(value * scale))


def _commanded(name: str, data: bytes | bytearray) -> int:
    return int(_unpacked(_COMMAND, data, name)[0])


def _unpacked(layout: Struct, data: bytes | bytearray, message: str) -> tuple[int, ...]:
    if len(data) < layout.size:
        raise CodecError(f"{message}: {len(data)} bytes where {layout.size} are needed")
    return layout.unpack_from(data)


def _cut(value: float, largest: int) -> int:
    """An integer as C's cast makes it, held within its type."""
    if not isfinite(value):
        raise CodecError("status: not a finite number")
    return int(min(max(value, -largest - 1), largest))


_FAULTS = (
    "no fault",
    "supply voltage too high: can the supply take back what is braked?",
    "supply voltage too low: is the supply on?",
    "gate driver fault",
    "motor current beyond its absolute limit",
    "transistors too hot",
    "motor too hot",
    "gate driver voltage too high",
    "gate driver voltage too low",
    "processor voltage too low",
    "restarted by its own watchdog",
    "encoder does not answer (SPI)",
    "sin/cos encoder: amplitude too small",
    "sin/cos encoder: amplitude too large",
    "flash memory corrupt",
    "current sensor 1: offset too high",
    "current sensor 2: offset too high",
    "current sensor 3: offset too high",
    "phase currents unbalanced",
    "brake input active",
    "resolver: loss of tracking",
    "resolver: degradation of signal",
    "resolver: loss of signal",
    "flash memory corrupt: app settings",
    "flash memory corrupt: motor settings",
    "encoder: no magnet",
    "encoder: magnet too strong",
    "phase filter fault",
    "encoder fault",
    "low-voltage output fault",
)


def describe_fault(code: int) -> str:
    """A fault code in words; unknown numbers are said as such."""
    return _FAULTS[code] if code < len(_FAULTS) else f"unknown fault code {code}"


LONGEST = 512  # PACKET_MAX_PL_LEN
_SHORT = 6
_LAST_SHORT_OFFSET = 255
_CLOSING = Struct(">BBHH")
_SELECTED = Struct(">BI")


# VESC packets: what does not fit into one CAN frame, cut into frames and put together again.
#
# A packet of up to six bytes goes in one frame, PROCESS_SHORT_BUFFER; longer ones go piece by piece, each with its
# offset, and are closed by PROCESS_RX_BUFFER with length and checksum (CRC-16/XMODEM). Source: vedderb/bldc,
# comm/comm_can.c (``comm_can_send_buffer``, ``decode_msg``), comm/commands.c (``COMM_FW_VERSION``,
# ``COMM_GET_VALUES_SELECTIVE``).
class Handling(IntEnum):
    """What the receiver is to do with a packet."""

    ANSWER = 0
    TAKE = 1  # it is an answer


class PacketKind(IntEnum):
    """A packet's first byte."""

    FW_VERSION = 0
    GET_VALUES_SELECTIVE = 50


FAULT_CODE = 1 << 15  # the bit that selects it in GET_VALUES_SELECTIVE


class Frame(NamedTuple):
    """One frame of a packet."""

    arbitration_id: int
    data: bytes


class Received(NamedTuple):
    """A packet put together: who sent it, what is to be done with it, and its bytes."""

    sender: int
    handling: int
    payload: bytes


def frames_of(payload: bytes, *, sender: int, receiver: int, handling: int) -> Iterator[Frame]:
    """The frames that carry a packet. Raises CodecError for one that is empty or too long."""
    if not 0 < len(payload) <= LONGEST:
        raise CodecError(f"packet: {len(payload)} bytes where 1 to {LONGEST} can be sent")
    if len(payload) <= _SHORT:
        identifier = arbitration_id(Packet.PROCESS_SHORT_BUFFER, receiver)
        yield Frame(identifier, bytes((sender, handling)) + payload)
        return
    yield from _pieces(payload, receiver)
    closing = _CLOSING.pack(sender, handling, len(payload), crc_hqx(payload, 0))
    yield Frame(arbitration_id(Packet.PROCESS_RX_BUFFER, receiver), closing)


def _pieces(payload: bytes, receiver: int) -> Iterator[Frame]:
    at = 0
    while at < len(payload) and at <= _LAST_SHORT_OFFSET:
        data = bytes((at,)) + payload[at : at + 7]
        yield Frame(arbitration_id(Packet.FILL_RX_BUFFER, receiver), data)
        at += 7
    while at < len(payload):
        data = at.to_bytes(2, "big") + payload[at : at + 6]
        yield Frame(arbitration_id(Packet.FILL_RX_BUFFER_LONG, receiver), data)
        at += 6


class Assembler:
    """Puts the frames addressed to one receiver together. ``malformed`` counts what could not be."""

    def __init__(self) -> None:
        self.malformed = 0
        self._pieces: dict[int, bytes] = {}

    def feed(self, packet: int, data: bytes | bytearray) -> Received | None:
        """The packet that this frame completes, if it does; other frames than a packet's are passed over."""
        match packet:
            case Packet.FILL_RX_BUFFER if len(data) >= 2:
                self._keep(data[0], data[1:])
            case Packet.FILL_RX_BUFFER_LONG if len(data) >= 3:
                self._keep(int.from_bytes(data[:2], "big"), data[2:])
            case Packet.PROCESS_RX_BUFFER if len(data) >= _CLOSING.size:
                return self._close(*_CLOSING.unpack_from(data))
            case Packet.PROCESS_SHORT_BUFFER if len(data) > 2:
                return Received(data[0], data[1], bytes(data[2:]))
            case (
                Packet.FILL_RX_BUFFER
                | Packet.FILL_RX_BUFFER_LONG
                | Packet.PROCESS_RX_BUFFER
                | Packet.PROCESS_SHORT_BUFFER
            ):
                self.malformed += 1
        return None

    def _keep(self, offset: int, piece: bytes | bytearray) -> None:
        if offset == 0:
            self._pieces.clear()
        if offset + len(piece) <= LONGEST:
            self._pieces[offset] = bytes(piece)

    def _close(self, sender: int, handling: int, length: int, checksum: int) -> Received | None:
        payload = b""
        while (piece := self._pieces.pop(len(payload), b"")) and len(payload) < length:
            payload += piece
        self._pieces.clear()
        if len(payload) != length or not length or crc_hqx(payload, 0) != checksum:
            self.malformed += 1
            return None
        return Received(sender, handling, payload)


def ask_fault() -> bytes:
    """The packet that asks for the fault code alone: it and its answer take one frame each."""
    return _SELECTED.pack(PacketKind.GET_VALUES_SELECTIVE, FAULT_CODE)


def fault_value(code: int) -> bytes:
    """The answer to :func:`ask_fault`."""
    return ask_fault() + bytes((code,))


def fault_of(payload: bytes) -> int:
    """The fault code in an answer. Raises CodecError for another answer."""
    if payload[:-1] != ask_fault():
        raise CodecError("fault code: another packet")
    return payload[-1]


def ask_version() -> bytes:
    """The packet that asks for firmware and hardware."""
    return bytes((PacketKind.FW_VERSION,))


def version_value(major: int, minor: int, hardware: str, uuid: bytes = bytes(12)) -> bytes:
    """The answer to :func:`ask_version`, as firmware 5 and later give it."""
    return bytes((PacketKind.FW_VERSION, major, minor)) + hardware.encode() + b"\0" + uuid + bytes(4)


def version_of(payload: bytes) -> tuple[int, int, str]:
    """Firmware (major, minor) and the hardware's name. Raises CodecError for another answer."""
    if len(payload) < 3 or payload[0] != PacketKind.FW_VERSION:
        raise CodecError("version: another packet")
    return payload[1], payload[2], payload[3:].partition(b"\0")[0].decode("ascii", "replace")
