"""A driver on a scripted bus, and by hand what it is to make of a frame: ODrive, VESC, moteus, DBC."""

from collections.abc import Callable, Iterator, Sequence
from math import copysign, isfinite, tau
from pathlib import Path
from random import Random
from struct import Struct
from typing import Any

import can
import cantools
import odrive_can

from norton_bench.testing import ScriptedWorld
from norton_drivers import dbc_sensor, moteus, odrive, vesc
from norton_drivers.devices import Amplifier
from norton_drivers.wiring import CanBusSettings, DeviceSettings

from .frames import FrameCodec, Values

NODE = 23
NO_REDUNDANCY = "none: identifier and length"
_POLE_PAIRS, _ANGLE_CODES = 7, 18_000
_COUNTS_PER_TURN = 8192
_ODRIVE_MESSAGES = (0x01, 0x03, 0x04, 0x05, 0x09, 0x0A, 0x14, 0x15, 0x17, 0x1C, 0x1D)


class AmplifierListener:
    """Hears through the driver of an amplifier; ``code_of`` gives a position back as the number that was sent."""

    def __init__(
        self,
        opened: Callable[..., Amplifier],
        name: str,
        code_of: Callable[[float], float],
        *,
        fd: bool = False,
        **options: Any,
    ) -> None:
        self._world = ScriptedWorld(buses=(CanBusSettings("can0", "scripted", "scripted", fd=fd),))
        link = self._world.link()
        settings = DeviceSettings("actuator", name, bus="can0", options=options)
        self._driver = opened(settings, link)
        self._poll = link.can_port(settings).poll
        self._code_of = code_of

    def hear(self, frame: can.Message) -> Values:
        self._world.bus.arriving.append(frame)
        self._poll()
        self._world.bus.sent.clear()
        self._driver.status()
        motion = [(self._code_of(each.position_rad), each.velocity_rad_s) for each in self._driver.take_motion()]
        return [*motion, *((each.current_a,) for each in self._driver.take_current())]

    def close(self) -> None:
        self._world.close()


# ---- ODrive ----------------------------------------------------------------------------------------------------------


class ODriveTruth:
    """By the DBC file that ODrive publishes, which cantools reads."""

    def __init__(self, version: str, *, counts: bool) -> None:
        folder = Path(odrive_can.__file__).parent / "dbc"
        self._database = cantools.database.load_file(folder / f"odrive-cansimple-{version}.dbc")
        self._velocity_rad_s = None if counts else 0.0
        self._counts = counts

    def __call__(self, frame: can.Message) -> Values:
        if frame.is_extended_id or frame.is_remote_frame or frame.arbitration_id >> 5 != NODE or frame.dlc < 8:
            return []
        match frame.arbitration_id & 0x1F:
            case 0x09:
                turns, turns_s = self._numbers("Get_Encoder_Estimates", frame)
                return self._estimates(turns, turns_s) if isfinite(turns) and isfinite(turns_s) else []
            case 0x0A if self._counts and self._velocity_rad_s is not None:
                shadow, _ = self._numbers("Get_Encoder_Count", frame)
                return [(shadow % 2**32, self._velocity_rad_s)]
            case 0x14:
                wanted, measured = self._numbers("Get_Iq", frame)
                return [(measured,)] if isfinite(wanted) and isfinite(measured) else []
        return []

    def _estimates(self, turns: float, turns_s: float) -> Values:
        if self._counts:
            self._velocity_rad_s = tau * turns_s
            return []
        return [(tau * turns, tau * turns_s)]

    def _numbers(self, name: str, frame: can.Message) -> tuple[float, float]:
        message = self._database.get_message_by_name(f"Axis0_{name}")
        first, second = message.decode(bytes(frame.data), decode_choices=False).values()
        return first, second


def _odrive_frame(random: Random) -> can.Message:
    numbers = Struct("<ff").pack(random.uniform(-1e3, 1e3), random.uniform(-100, 100))
    data = numbers if random.random() < 0.7 else random.randbytes(8)
    return frame_of(NODE << 5 | random.choice(_ODRIVE_MESSAGES), data)


def odrive_06() -> FrameCodec:
    return _odrive("ODrive 0.6", "0.6.10", lambda rad: rad, counts=False, firmware="0.6")


def odrive_05() -> FrameCodec:
    def count_of(position_rad: float) -> int:
        return round(position_rad / tau * _COUNTS_PER_TURN) % 2**32

    counts = {"position": "counts", "counts_per_turn": _COUNTS_PER_TURN}
    return _odrive("ODrive 0.5", "0.5.6", count_of, counts=True, firmware="0.5", **counts)


def _odrive(
    name: str, version: str, code_of: Callable[[float], float], *, counts: bool, **options: object
) -> FrameCodec:
    identifiers = tuple(NODE << 5 | message for message in _ODRIVE_MESSAGES)
    listener = AmplifierListener(odrive.open_amplifier, "odrive", code_of, node=NODE, **options)
    return FrameCodec(name, NO_REDUNDANCY, identifiers, _odrive_frame, listener, ODriveTruth(version, counts=counts))


# ---- VESC ------------------------------------------------------------------------------------------------------------


class VescTruth:
    """comm_can.c: STATUS is i32 eRPM, i16 tenths of an ampere, i16 thousandths of duty; STATUS_4 ends in the angle.

    The firmware cuts off towards zero, so that the middle of a step is half a step further out.
    """

    def __init__(self) -> None:
        self._velocity_rad_s: float | None = None

    def __call__(self, frame: can.Message) -> Values:
        if not frame.is_extended_id or frame.is_remote_frame or frame.dlc < 8:
            return []
        data = bytes(frame.data)
        if frame.arbitration_id == 9 << 8 | NODE:
            return self._status(*Struct(">ihh").unpack(data))
        if frame.arbitration_id == 16 << 8 | NODE and self._velocity_rad_s is not None:
            return [(int.from_bytes(data[6:], "big", signed=True) % _ANGLE_CODES, self._velocity_rad_s)]
        return []

    def _status(self, erpm: int, tenths: int, duty: int) -> Values:
        outwards = (erpm > 0) - (erpm < 0)
        self._velocity_rad_s = (erpm + 0.5 * outwards) / _POLE_PAIRS * tau / 60
        if not tenths:
            return [(0.0,)]
        tenths_forward = tenths if duty > 0 else -tenths
        return [((tenths_forward + copysign(0.5, tenths_forward)) / 10,)] if duty else []


def _vesc_frame(random: Random) -> can.Message:
    packet = random.choice((9, 9, 16, 16, 27, 18, 8))
    to = 254 if packet in (8, 18) else NODE
    return frame_of(packet << 8 | to, random.randbytes(8), extended=True)


def vesc_status() -> FrameCodec:
    def code_of(position_rad: float) -> int:
        return round(position_rad / tau * _ANGLE_CODES) % _ANGLE_CODES

    listener = AmplifierListener(vesc.open_amplifier, "vesc", code_of, node=NODE, pole_pairs=_POLE_PAIRS)
    identifiers = tuple(packet << 8 | node for packet in (5, 6, 7, 8, 9, 16, 18, 27) for node in (NODE, 254))
    return FrameCodec("VESC", NO_REDUNDANCY, identifiers, _vesc_frame, listener, VescTruth())


# ---- moteus ----------------------------------------------------------------------------------------------------------


class MoteusTruth:
    """By can.md: a reply of nothing but whole subframes, with all that is asked for in every tick in finite numbers."""

    REGISTERS = frozenset((0, 1, 2, 3, 4, 13, 14, 15))

    def __call__(self, frame: can.Message) -> Values:
        if frame.arbitration_id != NODE << 8 or frame.is_remote_frame:
            return []
        told: dict[int, float] = {}
        for register, values in _replied(bytes(frame.data)):
            if register < 0:
                return []
            told.update(enumerate(values, register))
        if not told.keys() >= self.REGISTERS or not all(isfinite(told[register]) for register in range(1, 5)):
            return []
        return [(tau * told[1], tau * told[2]), (told[4],)]


def _replied(data: bytes) -> Iterator[tuple[int, Sequence[float]]]:
    """The first register of each row, and its values; -1 for what is cut short or unknown, where a frame ends."""
    at = 0
    while at < len(data):
        first = data[at]
        at += 1
        if first == 0x50:
            continue
        read = [] if first >= 0x30 or not first & 3 else [first & 3]
        while len(read) < 2 and first <= 0x31:
            end = next((place for place in range(at, min(at + 5, len(data))) if data[place] < 0x80), None)
            if end is None:
                break
            read.append(sum((byte & 0x7F) << 7 * place for place, byte in enumerate(data[at : end + 1])))
            at = end + 1
        if len(read) < 2:
            yield -1, ()
            return
        if first >= 0x30 or first & 0xF0 == 0x10:
            continue
        size, register = read
        end = at + size * (1, 2, 4, 4)[first >> 2 & 3]
        if end > len(data):
            yield -1, ()
            return
        if first >= 0x20:
            yield register, Struct(f"<{size}{'bhif'[first >> 2 & 3]}").unpack(data[at:end])
        at = end


def _moteus_frame(random: Random) -> can.Message:
    values = [random.uniform(-1e3, 1e3) for _ in range(4)]
    head = random.choice((b"", b"\x30\x2b\x01", b"\x50")) + bytes((0x21, 0, random.randrange(16)))
    tail = b"\x27\x0d" + Struct("<3h").pack(random.randrange(600), random.randrange(900), random.choice((0, 0, 33, 99)))
    data = head + b"\x2c\x04\x01" + Struct("<4f").pack(*values) + tail
    return can.Message(arbitration_id=NODE << 8, data=data.ljust(32, b"\x50"), is_fd=True)


def moteus_replies() -> FrameCodec:
    listener = AmplifierListener(moteus.open_amplifier, "moteus", lambda rad: rad, fd=True, node=NODE)
    return FrameCodec("moteus", NO_REDUNDANCY, (NODE << 8, NODE), _moteus_frame, listener, MoteusTruth(), fd=True)


# ---- A sensor that a DBC file describes ------------------------------------------------------------------------------


class DbcListener:
    """Torque, and whether it is valid."""

    def __init__(self) -> None:
        self._world = ScriptedWorld()
        link = self._world.link()
        options = {"counter": "Counter", "status": "Status"}
        settings = DeviceSettings("torque_sensor", "dbc", bus="can0", options=options)
        self._driver = dbc_sensor.open_torque_sensor(settings, link)
        self._poll = link.can_port(settings).poll

    def hear(self, frame: can.Message) -> Values:
        self._world.bus.arriving.append(frame)
        self._poll()
        return [(each.torque_nm, each.valid) for each in self._driver.take_torque()]

    def close(self) -> None:
        self._world.close()


class DbcTruth:
    """The shipped file by hand: i32 micronewton metres, u16 counter, u8 status, one byte to spare."""

    IDENTIFIER = 801

    def __init__(self) -> None:
        self._last_counter: int | None = None

    def __call__(self, frame: can.Message) -> Values:
        right = frame.arbitration_id == self.IDENTIFIER and frame.dlc == 8
        if not right or frame.is_extended_id or frame.is_remote_frame:
            return []
        torque, counter, status = Struct("<iHBx").unpack(bytes(frame.data))
        if counter == self._last_counter:
            return []
        self._last_counter = counter
        return [(torque * 1e-6, status == 0)]


def _dbc_frame(random: Random) -> can.Message:
    return frame_of(DbcTruth.IDENTIFIER, random.randbytes(4) + bytes((random.randrange(4), 0, random.randrange(2), 0)))


def dbc() -> FrameCodec:
    redundancy = "counter and status, where the file has them"
    return FrameCodec("DBC frame", redundancy, (DbcTruth.IDENTIFIER,), _dbc_frame, DbcListener(), DbcTruth())


def frame_of(identifier: int, data: bytes, *, extended: bool = False) -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=extended)
