"""What a VESC looks like on a bus that it shares with others: its status messages, and its answer to a ping."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import can

from norton_drivers.codecs import vesc as protocol
from norton_drivers.codecs.vesc import Packet
from norton_drivers.readings import RawFrame
from norton_drivers.recognition import Question, Recognised

_DEVICE = "a VESC"
# CAN_PACKET_STATUS to CAN_PACKET_STATUS_6 (datatypes.h); the sixth has eight bytes, as all have but the fifth of old.
_STATUSES = {Packet.STATUS: 1, 14: 2, 15: 3, Packet.STATUS_4: 4, Packet.STATUS_5: 5, 58: 6}
_COMMANDS = frozenset((0, 1, 2, 3, 4, 10, 11, 12, 13))  # duty, current, brake, speed, position, and relative ones
_PIECES = (Packet.FILL_RX_BUFFER, Packet.FILL_RX_BUFFER_LONG)
_FROM_SENDER = (Packet.PROCESS_RX_BUFFER, Packet.PROCESS_SHORT_BUFFER)


def recognise(message: can.Message, options: Mapping[str, Any]) -> Recognised | None:
    """Status messages and pongs are sure: nobody else has 29-bit identifiers as low as these."""
    packet, node = protocol.split_id(message.arbitration_id)
    if not message.is_extended_id or message.is_remote_frame:
        return None
    if packet in _STATUSES and message.dlc in (6, 8):
        return Recognised(_DEVICE, f"STATUS_{_STATUSES[packet]}", {"node": node})
    if packet in _COMMANDS:
        return Recognised(_DEVICE, "command", {"node": node}, sure=False, from_host=True)
    return _answer(packet, message, node == options.get("host_node", protocol.NODE_MAX))


def _answer(packet: int, message: can.Message, to_us: bool) -> Recognised | None:
    """What is sent to whoever asked; its first byte is the sender, where it is not a mere part of an answer."""
    if packet == Packet.PONG and message.dlc:
        return Recognised(_DEVICE, "pong", {"node": message.data[0]})
    if packet in _FROM_SENDER and message.dlc and to_us:
        return Recognised(_DEVICE, "answers", {"node": message.data[0]}, sure=False)
    return Recognised(_DEVICE, "part of an answer", sure=False) if packet in _PIECES else None


def answers(question: RawFrame, frame: RawFrame) -> bool:
    """A pong comes to whoever sent the ping, from the controller that was pinged."""
    if not (question.extended and frame.extended and question.data and frame.data):
        return False
    (asked, node), (said, host) = protocol.split_id(question.arbitration_id), protocol.split_id(frame.arbitration_id)
    return asked == Packet.PING and said == Packet.PONG and host == question.data[0] and frame.data[0] == node


def probes(options: Mapping[str, Any], _heard: Collection[int]) -> Iterator[Question]:
    """Every controller id is pinged; other makers' devices do not listen to such identifiers."""
    host = options.get("host_node", protocol.NODE_MAX)
    for node in range(protocol.NODE_MAX + 1):
        if node != host:
            yield Question(protocol.arbitration_id(Packet.PING, node), bytes((host,)), extended=True)
