"""What shows on a bus with others that a motor is a RobStride or a CyberGear: identifiers far above a VESC's."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import can

from norton_drivers.codecs import robstride as protocol
from norton_drivers.codecs.robstride import Feedback, Kind, Mode, Parameter
from norton_drivers.readings import RawFrame
from norton_drivers.registry import Question, Recognised

_DEVICE = "a RobStride motor"
_FROM_MOTOR = (Kind.FEEDBACK, Kind.READ, Kind.FAULTS, Kind.REPORT)
_FROM_HOST = (Kind.CONTROL, Kind.ENABLE, Kind.STOP, Kind.ZERO, Kind.WRITE)
_HOTTEST_TENTHS_C = 2000
_PARAMETERS = range(0x7000, 0x7100)


def recognise(message: can.Message, _options: Mapping[str, Any]) -> Recognised | None:
    """Answers and feedback are sure: they tell more of themselves than J1939's frames, with identifiers as high."""
    if not message.is_extended_id or message.is_remote_frame or message.dlc != 8:
        return None
    kind, extra, target = protocol.split_id(message.arbitration_id)
    if kind in _FROM_HOST and 0 < target <= protocol.NODE_MAX:
        return Recognised(_DEVICE, "command", {"node": target}, sure=False, from_host=True)
    node = extra & 0xFF
    if kind not in _FROM_MOTOR or not 0 < node <= protocol.NODE_MAX:
        return None
    says = Kind(kind).name.lower()
    return Recognised(_DEVICE, says, {"node": node}, sure=_is_sure(kind, extra, message.data))


def _is_sure(kind: int, extra: int, data: bytearray) -> bool:
    """A host's question looks like an answer, from a motor with the host's identifier; motors' are below those."""
    if kind == Kind.READ:
        return extra >> 8 <= 1 and protocol.parameter_of(data)[0] in _PARAMETERS
    return kind == Kind.FEEDBACK and _is_plausible(extra, data)


def _is_plausible(extra: int, data: bytearray) -> bool:
    told = Feedback.decode(extra, data)
    return told.mode in tuple(Mode) and 0 < told.tenths_c < _HOTTEST_TENTHS_C


def answers(question: RawFrame, frame: RawFrame) -> bool:
    """A parameter comes back with its number; a frame that stops, or commands, is answered with feedback."""
    if not (question.extended and frame.extended) or question.remote or frame.remote:
        return False
    (asked, _, node), (told, extra, _) = (protocol.split_id(each.arbitration_id) for each in (question, frame))
    if extra & 0xFF != node:
        return False
    if asked == Kind.READ:
        return told == Kind.READ and frame.data[:2] == question.data[:2]
    # The question for the version is one that stops, too; what comes after it may be the answer to one before.
    ordinary = asked in (Kind.CONTROL, Kind.STOP) and question.data != protocol.VERSION_QUESTION
    return ordinary and told == Kind.FEEDBACK


def probes(options: Mapping[str, Any], _heard: Collection[int]) -> Iterator[Question]:
    """Every motor is asked for its run_mode; other makers' devices do not listen to such identifiers."""
    host = options.get("host", 253)
    for node in range(1, protocol.NODE_MAX + 1):
        if node != host:
            yield Question(*protocol.read_value(node, host, Parameter.RUN_MODE), extended=True)
