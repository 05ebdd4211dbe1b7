"""What a VESC tells only when it is asked: that it is there, its version, and its fault code.

Source: vedderb/bldc, comm/comm_can.c (``CAN_PACKET_PING``, packets), comm/commands.c (``COMM_FW_VERSION``,
``COMM_GET_VALUES_SELECTIVE``). None of these counts as a command for the drive's timeout.
"""

from norton_drivers.clock import Clock
from norton_drivers.codecs import vesc as protocol
from norton_drivers.codecs import vesc_packets as packets
from norton_drivers.codecs.vesc import Packet
from norton_drivers.inbox import Inbox
from norton_drivers.ports import CanPort

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
        self._assembler = packets.Assembler()
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
        self._ask(packets.ask_version())

    def ask_fault_now_and_then(self) -> None:
        """Called before every poll; asks no oftener than is of use. Raises ConnectionFailedError."""
        now_ns = self._clock.now_ns()
        if self._asked_ns is None or now_ns - self._asked_ns >= FAULT_PERIOD_NS:
            self._asked_ns = now_ns
            self._ask(packets.ask_fault())

    def on_frame(self, identifier: int, data: bytearray, arrival_ns: int) -> bool:
        """Take a frame that is an answer to this computer; True where it brought a fault code. Raises CodecError."""
        packet, receiver = protocol.split_id(identifier)
        if receiver != self._host_node:
            return False
        if packet == Packet.PONG:
            self._on_pong(data)
            return False
        received = self._assembler.feed(packet, data)
        if received is None or received.sender != self._node or received.handling != packets.Handling.TAKE:
            return False
        return self._on_packet(received.payload, arrival_ns)

    def _on_pong(self, data: bytearray) -> None:
        node, hardware_type = protocol.pong_of(data)
        if node == self._node:
            self.pongs.put(hardware_type)

    def _on_packet(self, payload: bytes, arrival_ns: int) -> bool:
        if payload[0] == packets.Command.FW_VERSION:
            self.versions.put(packets.version_of(payload))
        elif payload[0] == packets.Command.GET_VALUES_SELECTIVE:
            self.fault, self.fault_ns = packets.fault_of(payload), arrival_ns
            self.faults_told += 1
            return True
        return False

    def _ask(self, payload: bytes) -> None:
        handling = packets.Handling.ANSWER
        for frame in packets.frames_of(payload, sender=self._host_node, receiver=self._node, handling=handling):
            self._port.send(frame.arbitration_id, frame.data, extended=True)
