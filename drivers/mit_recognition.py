"""What an actuator in MIT mode looks like: it speaks only when spoken to, and all of them under one identifier."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import can

from drivers.codecs.mit import Special
from drivers.readings import RawFrame
from drivers.recognition import Question, Recognised, nobodys

_REPLY_LENGTHS = (6, 7, 8)
_PROBED_MAX = 0x7F  # identifiers above are others': SYNC, emergencies, process data


def recognise(message: can.Message, options: Mapping[str, Any]) -> Recognised | None:
    """A reply under the master's identifier, whose first byte is the motor's."""
    master = options.get("master", 0)
    if message.is_extended_id or message.is_remote_frame or message.arbitration_id != master:
        return None
    if message.dlc not in _REPLY_LENGTHS:
        return None
    return Recognised("an actuator in MIT mode", "reply", {"node": message.data[0]})


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
