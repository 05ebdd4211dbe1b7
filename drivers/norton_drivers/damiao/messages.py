"""What shows on a bus with others that a motor is a Damiao's.

Its feedback looks like a reply in MIT mode. What tells it from a CubeMars' is the last byte: a rotor's temperature
here, there an error's number, which is small.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import can

from norton_drivers.codecs import damiao as protocol
from norton_drivers.codecs.damiao import Feedback, Operation, Register, RegisterFrame
from norton_drivers.codecs.mit import ERRORS_MAX
from norton_drivers.mit.replies import probes as mit_probes
from norton_drivers.mit.replies import rests
from norton_drivers.readings import RawFrame
from norton_drivers.registry import Question, Recognised

_DEVICE = "a Damiao motor"
_HOTTEST_C = 200


def recognise(message: can.Message, options: Mapping[str, Any]) -> Recognised | None:
    """Its own identifier, read from its register, is sure; feedback is where it comes to the rig's master, or rests."""
    if message.is_extended_id or message.is_remote_frame or message.dlc != 8:
        return None
    master = message.arbitration_id
    if (node := _told_by_register(message.data)) is not None:
        return Recognised(_DEVICE, "register", _reached(node, master))
    told = Feedback.decode(message.data)
    plausible = told.node and ERRORS_MAX < told.rotor_c < _HOTTEST_C and 0 < told.transistor_c < _HOTTEST_C
    status_known = not protocol.describe_status(told.status).startswith("unknown")
    if plausible and status_known and (master == options.get("master", 0) or rests(*told.codes[1:])):
        return Recognised(_DEVICE, "feedback", _reached(told.node, master))
    return None


def _told_by_register(data: bytearray) -> int | None:
    """The node, where this is the answer to a reading of ESC_ID: it says the same twice."""
    if data[2] != Operation.READ or data[3] != Register.ESC_ID:
        return None
    frame = RegisterFrame.decode(data)
    return frame.node if 0 < frame.node == frame.value <= protocol.NODE_MAX else None


def _reached(node: int, master: int) -> dict[str, int]:
    return {"node": node, "master": master}


def answers(question: RawFrame, frame: RawFrame) -> bool:
    """Of questions to 0x7FF: a register comes back with its number, a request for feedback with feedback."""
    if question.extended or question.remote or frame.extended or frame.remote:
        return False
    if question.arbitration_id != protocol.REGISTERS_ID or len(question.data) != 8 or len(frame.data) != 8:
        return False
    if question.data[2] == Operation.REFRESH:
        return frame.data[0] & 0xF == question.data[0] and not _is_of_a_register(frame.data)
    return frame.data[:4] == question.data[:4]


def _is_of_a_register(data: bytes) -> bool:
    return data[1] == 0 and data[2] in (Operation.READ, Operation.WRITE)


def probes(options: Mapping[str, Any], heard: Collection[int]) -> Iterator[Question]:
    """Every motor is asked for its identifier; then all are disabled, which those in plain MIT mode answer, too."""
    for node in range(1, protocol.NODE_MAX + 1):
        yield Question(protocol.REGISTERS_ID, RegisterFrame(node, Operation.READ, Register.ESC_ID).encode())
    yield from mit_probes(options, heard)
