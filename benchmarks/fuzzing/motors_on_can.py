"""Motors whose frames have integers scaled to a range, and by hand what is to be made of each: MIT mode and its kin."""

from collections.abc import Callable
from math import copysign, pi, radians, tau
from random import Random
from struct import Struct

import can

from norton_drivers import cubemars, damiao, mit, robstride

from .drivers_on_can import NO_REDUNDANCY, AmplifierListener, frame_of
from .frames import FrameCodec, Values

_MIT_NODE, _NODE, _MASTER, _HOST = 23, 11, 5, 253
_NM_A = 0.1
_RANGES = (12.5, 50.0, 18.0)
_RS02 = (4 * pi, 44.0, 17.0)
_POLE_PAIRS, _GEAR_RATIO = 21, 9


def _middle(code: int, span: float, codes: int) -> float:
    """What is cut off downwards is read as the middle of its step."""
    return (code + 0.5) * 2 * span / (codes - 1) - span


def _code_of(span_rad: float) -> Callable[[float], float]:
    return lambda position_rad: round((position_rad + span_rad) * 65535 / (2 * span_rad) - 0.5) % 65536


class ScaledTruth:
    """Position, velocity and torque codes of a frame; ``codes`` is how many a velocity and a torque have.

    A velocity that leaps by more than half its range has wrapped: that reply's motion is withheld.
    """

    def __init__(self, ranges: tuple[float, float, float], codes: int) -> None:
        self._ranges, self._codes = ranges, codes
        self._last_velocity: int | None = None

    def values(self, position: int, velocity: int, torque: int) -> Values:
        _, velocity_rad_s, torque_nm = self._ranges
        current = _middle(torque, torque_nm, self._codes) / _NM_A
        if self._last_velocity is not None and abs(velocity - self._last_velocity) > self._codes // 2:
            return [(current,)]
        self._last_velocity = velocity
        return [(position, _middle(velocity, velocity_rad_s, self._codes)), (current,)]

    def of_bits(self, data: bytes) -> Values:
        """Of 16, 12 and 12 bits, most significant first."""
        bits = f"{int.from_bytes(data, 'big'):040b}"
        return self.values(int(bits[:16], 2), int(bits[16:28], 2), int(bits[28:], 2))


# ---- MIT mode --------------------------------------------------------------------------------------------------------


class MitTruth(ScaledTruth):
    """motorcontrol, can.c: identifier, position 16, velocity 12 and torque 12 bits, each cut off downwards."""

    def __call__(self, frame: can.Message) -> Values:
        if frame.is_extended_id or frame.is_remote_frame or frame.arbitration_id != _MASTER:
            return []
        data = bytes(frame.data)
        return self.of_bits(data[1:6]) if 6 <= len(data) <= 8 and data[0] == _MIT_NODE else []


def _mit_frame(random: Random) -> can.Message:
    return frame_of(_MASTER, bytes((_MIT_NODE,)) + random.randbytes(random.choice((5, 6, 7))))


def _ranged() -> dict[str, float]:
    names = ("position_range", "velocity_range", "torque_range")
    return {**dict(zip(names, _RANGES, strict=True)), "torque_constant": _NM_A}


def mit_replies() -> FrameCodec:
    options = {**_ranged(), "beyond_range": "wraps", "node": _MIT_NODE, "master": _MASTER}
    listener = AmplifierListener(mit.open_amplifier, "mit", _code_of(_RANGES[0]), **options)
    truth = MitTruth(_RANGES, 4096)
    return FrameCodec("MIT mode", NO_REDUNDANCY, (_MASTER, _MIT_NODE), _mit_frame, listener, truth)


# ---- Damiao ----------------------------------------------------------------------------------------------------------


class DamiaoTruth(ScaledTruth):
    """As in MIT mode, but for the status beside the identifier, and always eight bytes."""

    def __call__(self, frame: can.Message) -> Values:
        if frame.is_extended_id or frame.is_remote_frame or frame.arbitration_id != _MASTER:
            return []
        data = bytes(frame.data)
        return self.of_bits(data[1:6]) if len(data) == 8 and data[0] & 0xF == _NODE else []


def _damiao_frame(random: Random) -> can.Message:
    return frame_of(_MASTER, bytes((_NODE | random.randrange(16) << 4,)) + random.randbytes(7))


def damiao_feedback() -> FrameCodec:
    options = {**_ranged(), "node": _NODE, "master": _MASTER}
    listener = AmplifierListener(damiao.open_amplifier, "damiao", _code_of(_RANGES[0]), **options)
    truth = DamiaoTruth(_RANGES, 4096)
    return FrameCodec("Damiao", NO_REDUNDANCY, (_MASTER, 0x7FF), _damiao_frame, listener, truth)


# ---- RobStride -------------------------------------------------------------------------------------------------------


class RobStrideTruth(ScaledTruth):
    """Feedback (type 2, and 24 where it comes by itself): four words, of which the last is a temperature."""

    def __call__(self, frame: can.Message) -> Values:
        identifier, data = frame.arbitration_id, bytes(frame.data)
        if not frame.is_extended_id or frame.is_remote_frame or len(data) != 8:
            return []
        if identifier >> 24 & 0x1F not in (2, 24) or identifier >> 8 & 0xFF != _NODE:
            return []
        return self.values(*Struct(">HHH").unpack(data[:6]))


def _robstride_frame(random: Random) -> can.Message:
    kind = random.choice((2, 2, 2, 24, 17, 21))
    extra = random.randrange(256) << 8 | _NODE
    return frame_of(kind << 24 | extra << 8 | _HOST, random.randbytes(8), extended=True)


def robstride_feedback() -> FrameCodec:
    options = {"node": _NODE, "motor": "rs02", "torque_constant": _NM_A}
    listener = AmplifierListener(robstride.open_amplifier, "robstride", _code_of(_RS02[0]), **options)
    identifiers = tuple(kind << 24 | _NODE << 8 | _HOST for kind in (0, 2, 17, 21, 24))
    truth = RobStrideTruth(_RS02, 65536)
    return FrameCodec("RobStride", NO_REDUNDANCY, identifiers, _robstride_frame, listener, truth)


# ---- CubeMars' servo mode --------------------------------------------------------------------------------------------


def _cubemars_truth(frame: can.Message) -> Values:
    """Manual, section 5.2.1; numbers are cut off towards zero, so that the middle of a step is further out."""
    wrong = not frame.is_extended_id or frame.is_remote_frame or frame.arbitration_id != 0x2900 | _NODE
    if wrong or frame.dlc != 8:
        return []
    position, speed, current = Struct(">hhh").unpack(bytes(frame.data[:6]))
    erpm, hundredths = (value + copysign(0.5, value) if value else 0.0 for value in (speed, current))
    return [(position % 65536, erpm * 10 * tau / 60 / _POLE_PAIRS / _GEAR_RATIO), (hundredths / 100,)]


def _cubemars_frame(random: Random) -> can.Message:
    return frame_of(0x2900 | _NODE, random.randbytes(8), extended=True)


def cubemars_uploads() -> FrameCodec:
    step_rad = radians(0.1)

    def code_of(position_rad: float) -> int:
        return round(position_rad / step_rad - (copysign(0.5, position_rad) if position_rad else 0.0)) % 65536

    options = {"node": _NODE, "pole_pairs": _POLE_PAIRS, "gear_ratio": _GEAR_RATIO, "beyond_range": "wraps"}
    listener = AmplifierListener(cubemars.open_amplifier, "cubemars", code_of, **options)
    identifiers = (0x2900 | _NODE, 1 << 8 | _NODE)
    return FrameCodec("CubeMars servo", NO_REDUNDANCY, identifiers, _cubemars_frame, listener, _cubemars_truth)
