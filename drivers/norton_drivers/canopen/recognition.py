"""What a CANopen device looks like on a bus that it shares with others: heartbeats, answers, process data.

Source: CiA 301, predefined connection set. What kind of device it is does not show in a frame.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import can

from norton_drivers.codecs.canopen import NODE_MAX, NmtState, sdo_answer_id, sdo_request_id
from norton_drivers.readings import RawFrame
from norton_drivers.recognition import Question, Recognised, nobodys

_DEVICE = "a CANopen device"
_HEARTBEAT, _ANSWER, _REQUEST, _EMERGENCY = 0x700, 0x580, 0x600, 0x080
_SENT = {0x180: "PDO 1", 0x280: "PDO 2", 0x380: "PDO 3", 0x480: "PDO 4", _EMERGENCY: "emergency"}
_TOLD = (0x200, 0x300, 0x400, 0x500)
_READ_DEVICE_TYPE = bytes.fromhex("4000100000000000")  # SDO: upload 1000h


def recognise(message: can.Message, _options: Mapping[str, Any]) -> Recognised | None:
    """A heartbeat is sure, and so is the answer to the device's type; all else only beside one of them."""
    function, node = message.arbitration_id & ~NODE_MAX, message.arbitration_id & NODE_MAX
    if message.is_extended_id or message.is_remote_frame or not node:
        return None
    options = {"node": node}
    if function == _HEARTBEAT and message.dlc == 1:
        return Recognised(_DEVICE, "heartbeat", options, sure=message.data[0] in set(NmtState))
    if function == _ANSWER and message.dlc == 8:
        return Recognised(_DEVICE, "answers", options, sure=message.data[1:4] == _READ_DEVICE_TYPE[1:4])
    if function in _SENT:
        return Recognised(_DEVICE, _SENT[function], options, sure=False)
    if function == _REQUEST or function in _TOLD:
        return Recognised(_DEVICE, "command", options, sure=False, from_host=True)
    return None


def answers(question: RawFrame, frame: RawFrame) -> bool:
    """An SDO's answer comes from the node that was asked."""
    node = question.arbitration_id - _REQUEST
    return (
        0 < node <= NODE_MAX
        and len(question.data) == 8
        and not (question.extended or frame.extended)
        and frame.arbitration_id == sdo_answer_id(node)
    )


def probes(_options: Mapping[str, Any], heard: Collection[int]) -> Iterator[Question]:
    """Every node is asked what type of device it is."""
    for node in range(1, NODE_MAX + 1):
        if nobodys(sdo_request_id(node), heard):
            yield Question(sdo_request_id(node), _READ_DEVICE_TYPE)
