"""What a VESC says on CAN: its answers to questions, and what shows on a bus with others that it is one.

It tells only when it is asked that it is there, its version, and its fault code. Source: vedderb/bldc, comm/comm_can.c
(``CAN_PACKET_PING``, packets), comm/commands.c (``COMM_FW_VERSION``, ``COMM_GET_VALUES_SELECTIVE``). None of these
counts as a command for the drive's timeout."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import can

from norton_drivers.codecs import vesc as protocol
from norton_drivers.codecs.vesc import Packet
from norton_drivers.ports import CanPort, Clock
from norton_drivers.readings import Inbox, RawFrame
from norton_drivers.registry import Question, Recognised

FAULT_PERIOD_NS = 20_000_000  # a fault lasts half a second at least


class VescQueries:
    """Questions to the drive ``node``, answered to ``host_node``. ``fault`` is the last code told, 0 for none."""

    def __init__(self, node: int, host_node: int, port: CanPort, clock: Clock) -> None:
        self.fault = 0
        self.fault_ns = 0  # arrival of the last answer
        self.faults_told = 0
        self.pongs: Inbox[int] = Inbox()  # hardware types
        self.versions: Inbox[tuple[int, int, str]] = Inbox()
        self._node, self._host_node = node, host_node
        self._port = port
        self._clock = clock
        self._assembler = protocol.Assembler()
        self._asked_ns: int | None = None

    @property
    def malformed(self) -> int:
        """Packets that could not be put together."""
        return self._assembler.malformed

    def ping(self) -> None:
        """Raises ConnectionFailedError."""
        identifier = protocol.arbitration_id(Packet.PING, self._node)
        self._port.send(identifier, bytes((self._host_node,)), extended=True)

    def ask_version(self) -> None:
        """Raises ConnectionFailedError."""
        self._ask(protocol.ask_version())

    def ask_fault_now_and_then(self) -> None:
        """Called before every poll; asks no oftener than is of use. Raises ConnectionFailedError."""
        now_ns = self._clock.now_ns()
        if self._asked_ns is None or now_ns - self._asked_ns >= FAULT_PERIOD_NS:
            self._asked_ns = now_ns
            self._ask(protocol.ask_fault())

    def on_frame(self, identifier: int, data: bytearray, arrival_ns: int) -> bool:
        """Take a frame that is an answer to this computer; True where it brought a fault code. Raises CodecError."""
        packet, receiver = protocol.split_id(identifier)
        if receiver != self._host_node:
            return False
        if packet == Packet.PONG:
            self._on_pong(data)
            return False
        received = self._assembler.feed(packet, data)
        if received is None or received.sender != self._node or received.handling != protocol.Handling.TAKE:
            return False
        return self._on_packet(received.payload, arrival_ns)

    def _on_pong(self, data: bytearray) -> None:
        node, hardware_type = protocol.pong_of(data)
        if node == self._node:
            self.pongs.put(hardware_type)

    def _on_packet(self, payload: bytes, arrival_ns: int) -> bool:
        if payload[0] == protocol.PacketKind.FW_VERSION:
            self.versions.put(protocol.version_of(payload))
        elif payload[0] == protocol.PacketKind.GET_VALUES_SELECTIVE:
            self.fault, self.fault_ns = protocol.fault_of(payload), arrival_ns
            self.faults_told += 1
            return True
        return False

    def _ask(self, payload: bytes) -> None:
        handling = protocol.Handling.ANSWER
        for frame in protocol.frames_of(payload, sender=self._host_node, receiver=self._node, handling=handling):
            self._port.send(frame.arbitration_id, frame.data, extended=True)


_DEVICE = "a VESC"
# CAN_PACKET_STATUS to CAN_PACKET_STATUS_6 (datatypes.h); the sixth has eight bytes, as all have but the fifth of old.
_STATUSES = {Packet.STATUS: 1, 14: 2, 15: 3, Packet.STATUS_4: 4, Packet.STATUS_5: 5, 58: 6}
_COMMANDS = frozenset((0, 1, 2, 3, 4, 10, 11, 12, 13))  # duty, current, brake, speed, position, and relative ones
_PONG_BYTES = 2
_PIECES = (Packet.FILL_RX_BUFFER, Packet.FILL_RX_BUFFER_LONG)
_FROM_SENDER = (Packet.PROCESS_RX_BUFFER, Packet.PROCESS_SHORT_BUFFER)


def recognise(message: can.Message, options: Mapping[str, Any]) -> Recognised | None:
    """Status messages and pongs are sure: nobody else has 29-bit identifiers as low as these, but a RobStride motor
    when it is switched on, in whose greeting 0xFE is where the controller id would be."""
    packet, node = protocol.split_id(message.arbitration_id)
    if not message.is_extended_id or message.is_remote_frame:
        return None
    if packet in _STATUSES and message.dlc in (6, 8):
        return Recognised(_DEVICE, f"STATUS_{_STATUSES[packet]}", {"node": node}, sure=node != protocol.NODE_MAX)
    if packet in _COMMANDS:
        return Recognised(_DEVICE, "command", {"node": node}, sure=False, from_host=True)
    return _answer(packet, message, node == options.get("host_node", protocol.NODE_MAX))


def _answer(packet: int, message: can.Message, to_us: bool) -> Recognised | None:
    """What is sent to whoever asked; its first byte is the sender, where it is not a mere part of an answer."""
    if packet == Packet.PONG and 0 < message.dlc <= _PONG_BYTES:
        return Recognised(_DEVICE, "pong", {"node": message.data[0]})
    if packet in _FROM_SENDER and message.dlc and to_us:
        return Recognised(_DEVICE, "answers", {"node": message.data[0]}, sure=False)
    return Recognised(_DEVICE, "part of an answer", sure=False) if packet in _PIECES else None


def answers(question: RawFrame, frame: RawFrame) -> bool:
    """A pong comes to whoever sent the ping, from the controller that was pinged."""
    if not (question.extended and frame.extended and question.data and frame.data):
        return False
    (asked, node), (message, host) = protocol.split_id(question.arbitration_id), protocol.split_id(frame.arbitration_id)
    return asked == Packet.PING and message == Packet.PONG and host == question.data[0] and frame.data[0] == node


def probes(options: Mapping[str, Any], _heard: Collection[int]) -> Iterator[Question]:
    """Every controller id is pinged; other makers' devices do not listen to such identifiers."""
    host = options.get("host_node", protocol.NODE_MAX)
    for node in range(protocol.NODE_MAX + 1):
        if node != host:
            yield Question(protocol.arbitration_id(Packet.PING, node), bytes((host,)), extended=True)
