"""What shows on a bus with others that a motor is one in MIT mode."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import can

from norton_drivers.codecs.mit import CODES, ERRORS_MAX, Reply, Special
from norton_drivers.readings import RawFrame
from norton_drivers.registry import Question, Recognised, nobodys

_DEVICE = "an actuator in MIT mode"
_REPLY_LENGTHS = (6, 7, 8)
# How far from the middle of their ranges velocity and torque of a motor that stands still may be; both have 12 bits.
_REST_VELOCITY_CODES, _REST_TORQUE_CODES = 16, 64
_PROBED_MAX = 0x7F  # identifiers above are others': SYNC, emergencies, process data


def recognise(message: can.Message, options: Mapping[str, Any]) -> Recognised | None:
    """A reply under the master's identifier, whose first byte is the motor's; or one to another master, at rest."""
    if message.is_extended_id or message.is_remote_frame or message.dlc not in _REPLY_LENGTHS:
        return None
    reply, master = Reply.decode(message.data), message.arbitration_id
    if reply.error is not None and reply.error > ERRORS_MAX:
        return None  # a Damiao's, where a temperature is in its place
    if master == options.get("master", 0):
        return Recognised(_DEVICE, "reply", {"node": reply.node})
    return (
        Recognised(_DEVICE, "reply", {"node": reply.node, "master": master})
        if rests(reply.velocity_code, reply.torque_code)
        else None
    )


def rests(velocity_code: int, torque_code: int) -> bool:
    """As hardly any frame of another device looks by chance."""
    middle = CODES // 2
    velocity, torque = abs(velocity_code - middle), abs(torque_code - middle)
    return velocity <= _REST_VELOCITY_CODES and torque <= _REST_TORQUE_CODES


def answers(question: RawFrame, frame: RawFrame) -> bool:
    """Every frame to a motor is answered with its own identifier in front."""
    return (
        len(question.data) == 8
        and len(frame.data) in _REPLY_LENGTHS
        and not (question.extended or question.remote or frame.extended or frame.remote)
        and frame.data[0] == question.arbitration_id
    )


def probes(options: Mapping[str, Any], heard: Collection[int]) -> Iterator[Question]:
    """Every motor is told to be disabled, which it answers; identifiers near those of others are left alone."""
    others = set(heard) - {options.get("master", 0)}
    for node in range(1, _PROBED_MAX + 1):
        if nobodys(node, others):
            yield Question(node, Special.DISABLE.encode())
