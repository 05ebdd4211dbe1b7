"""The server of mjlib's multiplex protocol in a device: frames in, registers written and read, replies out.

Sources: mjbots/mjlib, mjlib/multiplex/micro_server.cc (errors, the broadcast identifier; what cannot be understood ends
a frame, what came before it counts); mjbots/moteus, fw/fdcan_micro_server.h (a reply is CAN FD where the question was,
or where it is long).
"""

from abc import ABC, abstractmethod

import can

from norton_drivers.codecs.can_frames import CLASSICAL_LENGTH_MAX
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.moteus import value_of
from norton_drivers.codecs.multiplex import BROADCAST, Address, Kind, Refusal, Resolution, Subframe, frame, subframes
from norton_sim.connectors import CanConnector

UNKNOWN, NOT_WRITABLE, WRONG_VALUE = 1, 2, 3
Parts = list[Subframe | Refusal]


class RegisterServer(ABC):
    """The device with this ``node`` and ``prefix`` on a bus."""

    def __init__(self, connector: CanConnector, node: int, prefix: int) -> None:
        self._node, self._prefix = node, prefix
        self._connector = connector
        connector.on_frame(self._receive)

    @abstractmethod
    def read(self, register: int, resolution: Resolution) -> float | None:
        """As it stands in the reply; None for a register that cannot be read so."""

    @abstractmethod
    def write(self, register: int, value: float) -> int:
        """Why it cannot be written; 0 where it was."""

    @abstractmethod
    def complete(self) -> None:
        """The frame is over, and answered."""

    def _receive(self, message: can.Message) -> None:
        address = Address.of(message.arbitration_id)
        ours = address.prefix == self._prefix and address.destination in (self._node, BROADCAST)
        if not ours or message.is_remote_frame:
            return
        reply = self._done(message.data)
        if address.asks and reply:
            data, back = frame(reply), Address(self._node, address.source, prefix=self._prefix)
            fd = message.is_fd or len(data) > CLASSICAL_LENGTH_MAX
            self._connector.send(back.identifier, data, extended=back.extended, fd=fd)
        self.complete()

    def _done(self, data: bytes | bytearray) -> Parts:
        reply: Parts = []
        try:
            for part in subframes(data):
                if not isinstance(part, Refusal) and not self._take(part, reply):
                    break
        except CodecError:
            pass
        return reply

    def _take(self, part: Subframe, reply: Parts) -> bool:
        """Whether the rest of the frame is looked at."""
        if part.kind is Kind.WRITE:
            for place, raw in enumerate(part.raw):
                register = part.register + place
                if reason := self.write(register, value_of(register, part.resolution, raw)):
                    reply.append(Refusal(True, register, reason))
            return True
        if part.kind is Kind.REPLY:
            return False
        values: list[float] = []
        for register in range(part.register, part.register + part.size):
            value = self.read(register, part.resolution)
            if value is None:
                reply.append(Refusal(False, register, UNKNOWN))
                return False
            values.append(value)
        reply.append(part._replace(kind=Kind.REPLY, raw=tuple(values)))
        return True
