"""A host on the simulated bus that speaks to CANopen devices in raw frames."""

from struct import Struct
from typing import Any

import can

from norton_drivers.codecs import canopen as protocol
from norton_drivers.wiring import Wiring
from norton_sim.backend import SimulatedBackend

MS = 1_000_000


class AbortedError(Exception):
    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


class CanopenHost:
    """``role`` names the device that it speaks to, whose node id is ``node``."""

    def __init__(self, backend: SimulatedBackend, wiring: Wiring, role: str, node: int) -> None:
        self.world = backend.world
        self.bus = backend.open_can(wiring.buses[0]).bus
        self.firmware: Any = backend.world.devices[role]
        self.node = node
        self._received: list[can.Message] = []

    def send(self, identifier: int, data: bytes = b"", **kind: bool) -> None:
        self.bus.send(can.Message(arbitration_id=identifier, is_extended_id=False, data=data, **kind))

    def wait(self, duration_ms: float) -> None:
        self.world.advance(self.world.now_ns + round(duration_ms * MS))
        self._received += iter(lambda: self.bus.recv(0), None)

    def frames(self, identifier: int) -> list[bytes]:
        """What has come with an identifier since the last call for it."""
        found = [bytes(frame.data) for frame in self._received if frame.arbitration_id == identifier]
        self._received = [frame for frame in self._received if frame.arbitration_id != identifier]
        return found

    def order(self, command: protocol.NmtCommand, wait_ms: float = 1.0) -> None:
        self.send(protocol.NMT_ID, protocol.NmtOrder(command, self.node).encode())
        self.wait(wait_ms)

    def ask(self, request: bytes) -> protocol.SdoAnswer:
        self.frames(protocol.sdo_answer_id(self.node))
        self.send(protocol.sdo_request_id(self.node), request)
        self.wait(1)
        (answer,) = self.frames(protocol.sdo_answer_id(self.node))
        return protocol.sdo_answer_of(answer)

    def read(self, index: int, subindex: int, layout: str) -> int:
        answer = self.ask(protocol.SdoRead(index, subindex).encode())
        if isinstance(answer, protocol.SdoAbort):
            raise AbortedError(answer.code)
        assert isinstance(answer, protocol.SdoValue)
        return int(Struct(layout).unpack(answer.value)[0])

    def write(self, index: int, subindex: int, layout: str, value: int) -> None:
        answer = self.ask(protocol.SdoWrite(index, subindex, Struct(layout).pack(value)).encode())
        if isinstance(answer, protocol.SdoAbort):
            raise AbortedError(answer.code)
        assert isinstance(answer, protocol.SdoWritten)

    def text(self, index: int) -> str:
        answer = self.ask(protocol.SdoRead(index, 0).encode())
        if isinstance(answer, protocol.SdoValue):
            return answer.value.decode()
        assert isinstance(answer, protocol.SdoLongValue)
        data, toggle, last = b"", False, False
        while not last:
            segment = self.ask(protocol.SdoReadSegment(toggle).encode())
            assert isinstance(segment, protocol.SdoSegment)
            assert segment.toggle is toggle
            data, toggle, last = data + segment.data, not toggle, segment.last
        assert len(data) == answer.size
        return data.decode()

    def map(self, communication: int, words: list[int], transmission: int, timer_ms: int = 0) -> None:
        """A PDO as the standard wants it changed."""
        cob_id = self.read(communication, 1, "<I")
        self.write(communication, 1, "<I", cob_id | protocol.PDO_NOT_VALID)
        self.write(communication, 2, "<B", transmission)
        self.write(communication, 5, "<H", timer_ms)
        self.write(communication + 0x200, 0, "<B", 0)
        for number, word in enumerate(words, start=1):
            self.write(communication + 0x200, number, "<I", word)
        self.write(communication + 0x200, 0, "<B", len(words))
        self.write(communication, 1, "<I", cob_id & ~protocol.PDO_NOT_VALID)
