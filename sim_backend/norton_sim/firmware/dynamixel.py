"""A Dynamixel X servo on a half-duplex line, Protocol 2.0: what it hears, and what it says.

Sources: as for :mod:`norton_drivers.codecs.dynamixel`; e-Manual, "Status Return Level". What is behind its registers is
:mod:`norton_sim.firmware.dynamixel_motor`.
"""

from functools import partial

from norton_drivers.codecs import dynamixel as protocol
from norton_drivers.codecs.dynamixel import Error, Instruction, Packet
from norton_drivers.codecs.half_duplex import Answer
from norton_drivers.dynamixel import table
from norton_sim.firmware.context import DeviceContext
from norton_sim.firmware.dynamixel_motor import FIRMWARE, DynamixelMotor

RESTART_NS = 150_000_000
PING_BYTES = 14


class DynamixelServo(DynamixelMotor):
    """One servo: the rig's actuator or its load."""

    def __init__(self, context: DeviceContext) -> None:
        self._restarts_ns = 0
        self._stream = protocol.PacketStream()
        self._heard = b""  # of an answer that several servos give together
        self._fast = (0, 0, 0)  # how many bytes of it come before its own part, how many give it, how long; 0: none
        super().__init__(context)

    # ---- what it hears ----

    def _receive(self, data: bytes) -> None:
        if self._world.now_ns < self._restarts_ns:
            return
        before, count, _ = self._fast
        if before:
            self._heard += data
            if len(self._heard) >= before:
                self._connector.send(self._fast_part(count))
                self._stream.drop()  # it does not hear the rest of that packet, which is its own
                return
        for packet in self._stream.feed(data):
            if packet.instruction == Instruction.STATUS:
                self._answered(packet.node)
            else:
                self._obey(packet)

    def _obey(self, packet: Packet) -> None:
        self._asked_anew()
        self._fast, self._heard = (0, 0, 0), b""
        self._watchdog.feed()
        body, own = packet.parameters, packet.node == self.node
        address, length = int.from_bytes(body[:2], "little"), int.from_bytes(body[2:4], "little")
        match packet.instruction:
            case Instruction.PING if own or packet.node == protocol.BROADCAST:
                identity = self.registers.read(table.MODEL_NUMBER, 2) + bytes((FIRMWARE,))
                turn_ns = 0 if own else self.node * (self.return_delay_ns + PING_BYTES * 10**10 // self._options.baud)
                self._answer_later(partial(self._status, Error.NONE, identity), turn_ns)
            case Instruction.READ if own and self.registers.get(table.STATUS_RETURN_LEVEL):
                self._answer_later(partial(self._reading, address, length))
            case Instruction.WRITE if own:
                error = self._write(address, body[2:])
                if self.registers.get(table.STATUS_RETURN_LEVEL) == 2:
                    self._answer_later(partial(self._status, error))
            case Instruction.REBOOT if own:
                self._restarts_ns = self._world.now_ns + RESTART_NS
                self._start()
            case Instruction.SYNC_READ if self.node in body[4:]:
                before = body[4 : 4 + body[4:].index(self.node)]
                self._answer_behind(before, partial(self._reading, address, length))
            case Instruction.FAST_SYNC_READ if self.node in body[4:]:
                place, count = body[4:].index(self.node), len(body) - 4
                self._fast = (protocol.fast_bytes(length, place) if place else 0, count, length)
                self._ask_address = address
                if not place:
                    self._answer_later(partial(self._fast_part, count))
            case Instruction.SYNC_WRITE:
                for at in range(4, len(body) - length, 1 + length):
                    if body[at] == self.node:
                        self._write(address, body[at + 1 : at + 1 + length])

    # ---- what it says ----

    def _status(self, error: Error, data: bytes = b"") -> bytes:
        return protocol.status(self.node, error | self._alert, data)

    def _reading(self, address: int, length: int) -> bytes:
        return self._status(Error.NONE, self._shown(address, length))

    def _fast_part(self, count: int) -> bytes:
        before, _, length = self._fast
        self._fast = (0, 0, 0)
        data = self._shown(self._ask_address, length)
        return protocol.fast_block(Answer(self.node, self._alert, data), self._heard[:before], count)
