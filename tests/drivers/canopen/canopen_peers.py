"""A CANopen device with a scripted far end: parameters, heartbeats and network management, through the codec alone."""

import struct
from typing import ClassVar

import can

from norton_drivers.codecs import canopen as protocol
from norton_drivers.codecs import cia402
from norton_drivers.codecs.canopen import NmtCommand, NmtState
from norton_drivers.codecs.cia402 import Controlword, State

TEXTS = {0x1008: b"a device's long name", 0x100A: b"7.1"}


class ScriptedNode:
    """Answers as the standard says; tests bend it. ``parameters`` are bytes by index and subindex."""

    def __init__(self, world, node: int, device_type: int) -> None:
        self.bus, self.clock, self.node = world.bus, world.clock, node
        self.parameters = {
            (0x1000, 0): struct.pack("<I", device_type),
            (0x1017, 0): bytes(2),
            (0x1018, 1): struct.pack("<I", 0x2B1),
            (0x1018, 2): struct.pack("<I", 0x51),
        }
        self.texts = dict(TEXTS)
        self.deaf = False  # says nothing at all
        self.twin = False  # another device has the same node id
        self.state = NmtState.PRE_OPERATIONAL
        self.orders: list[NmtCommand] = []
        self.written: list[tuple[int, int, int]] = []
        self.aborts: dict[tuple[int, int], int] = {}
        self.stuck: set[tuple[int, int]] = set()  # takes what is written, and keeps what it had
        self.sent: list[can.Message] = []
        self.next_heartbeat_ns = 0
        self.text = b""
        world.bus.peer = self.receive
        world.clock.alarms.append(self.tick)

    # ---- What it does by itself ----

    def say(self, identifier: int, data: bytes) -> None:
        if not self.deaf:
            self.bus.arrive(identifier, data)

    def tick(self, now_ns: int) -> None:
        (period_ms,) = struct.unpack("<H", self.parameters[0x1017, 0])
        if period_ms and now_ns >= self.next_heartbeat_ns:
            self.next_heartbeat_ns = now_ns + period_ms * 1_000_000
            self.heartbeat()

    def heartbeat(self) -> None:
        self.say(protocol.heartbeat_id(self.node), protocol.heartbeat(self.state))

    def boot_up(self) -> None:
        self.state = NmtState.PRE_OPERATIONAL
        self.parameters[0x1017, 0] = bytes(2)
        self.say(protocol.heartbeat_id(self.node), protocol.heartbeat(NmtState.BOOT_UP))

    def emergency(self, code: int) -> None:
        self.say(protocol.emergency_id(self.node), protocol.Emergency(code).encode())

    # ---- What it is told ----

    def receive(self, frame: can.Message) -> None:
        self.sent.append(frame)
        identifier = frame.arbitration_id
        if identifier == protocol.NMT_ID:
            self.obey(protocol.NmtOrder.decode(frame.data))
        elif identifier == protocol.sdo_request_id(self.node):
            for _ in range(2 if self.twin else 1):
                self.answer(protocol.sdo_request_of(frame.data))
        else:
            self.receive_other(identifier, bytes(frame.data))

    def receive_other(self, identifier: int, data: bytes) -> None:
        pass

    def obey(self, order: protocol.NmtOrder) -> None:
        if order.node not in (0, self.node):
            return
        self.orders.append(order.command)
        states = {NmtCommand.START: NmtState.OPERATIONAL, NmtCommand.PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL}
        if order.command is NmtCommand.RESET_COMMUNICATION:
            self.boot_up()
        self.state = states.get(order.command, self.state)

    def answer(self, request: protocol.SdoRequest) -> None:
        match request:
            case protocol.SdoRead(index, subindex):
                self.read(index, subindex)
            case protocol.SdoWrite(index, subindex, value):
                self.write(index, subindex, value)
            case protocol.SdoReadSegment(toggle):
                piece, self.text = self.text[:7], self.text[7:]
                self.reply(protocol.SdoSegment(toggle, piece, last=not self.text))

    def reply(self, answer: protocol.SdoAnswer) -> None:
        self.say(protocol.sdo_answer_id(self.node), answer.encode())

    def read(self, index: int, subindex: int) -> None:
        if index in self.texts:
            self.text = self.texts[index]
            self.reply(protocol.SdoLongValue(index, subindex, len(self.text)))
        elif (index, subindex) in self.parameters:
            self.reply(protocol.SdoValue(index, subindex, self.parameters[index, subindex]))
        else:
            self.reply(protocol.SdoAbort(index, subindex, protocol.ABORT_NO_OBJECT))

    def write(self, index: int, subindex: int, value: bytes) -> None:
        code = self.aborts.get((index, subindex))
        if code is None and (index, subindex) not in self.parameters:
            code = protocol.ABORT_NO_OBJECT
        if code is not None:
            self.reply(protocol.SdoAbort(index, subindex, code))
            return
        self.written.append((index, subindex, int.from_bytes(value, "little")))
        if (index, subindex) not in self.stuck:
            self.parameters[index, subindex] = value
        self.reply(protocol.SdoWritten(index, subindex))


class ScriptedDrive(ScriptedNode):
    """A CiA 402 drive that sends its process data at every SYNC, or each millisecond."""

    STEPS: ClassVar = {
        (State.SWITCH_ON_DISABLED, Controlword.SHUTDOWN): State.READY,
        (State.READY, Controlword.SWITCH_ON): State.SWITCHED_ON,
        (State.SWITCHED_ON, Controlword.ENABLE_OPERATION): State.OPERATION_ENABLED,
    }

    def __init__(self, world, node: int) -> None:
        super().__init__(world, node, 0x00020192)
        self.where = State.SWITCH_ON_DISABLED
        self.statusword_bits = cia402.REMOTE | cia402.VOLTAGE_ENABLED
        self.refuses: set[State] = set()
        self.mode: int | None = None  # what it shows where it takes none
        self.commands: list[cia402.TorqueCommand] = []
        self.command_ns: list[int] = []
        self.beats_ns: list[int] = []
        self.position = self.velocity = self.torque = self.current = 0
        self.mute_motion = self.mute_status = False
        self.resets = 0
        self.last_controlword = 0
        for number in range(4):
            for first, identifier in ((0x1400, 0x200), (0x1800, 0x180)):
                self.parameters[first + number, 1] = struct.pack("<I", identifier + 0x100 * number + node)
                self.parameters |= {(first + number, sub): bytes(1 if sub == 2 else 2) for sub in (2, 3, 5)}
                self.parameters[first + 0x200 + number, 0] = bytes(1)
                self.parameters |= {(first + 0x200 + number, sub): bytes(4) for sub in range(1, 9)}
        sizes = {0x6007: 2, 0x603F: 2, 0x6040: 2, 0x6041: 2, 0x6060: 1, 0x6071: 2, 0x6087: 4, 0x6502: 4}
        self.parameters |= {(index, 0): bytes(size) for index, size in sizes.items()}
        self.parameters |= {(0x1016, 1): bytes(4), (0x60C2, 1): b"\1", (0x60C2, 2): b"\xfd"}
        self.parameters[0x6007, 0] = b"\1\0"
        self.parameters[0x6502, 0] = struct.pack("<I", 0x208)

    @property
    def statusword(self) -> int:
        return cia402.statusword_of(self.where) | self.statusword_bits

    def tick(self, now_ns: int) -> None:
        super().tick(now_ns)
        if self.parameters[0x1800, 2] == b"\xff":
            self.report()

    def report(self) -> None:
        if self.state is not NmtState.OPERATIONAL:
            return
        mode = (self.commands[-1].mode if self.commands else 0) if self.mode is None else self.mode
        status = cia402.Status(self.statusword, mode, self.torque, self.current)
        with_current = self.parameters[0x1A00, 0] == b"\4"
        if not self.mute_status:
            self.say(0x180 + self.node, cia402.status_value(status, with_current=with_current))
        if not self.mute_motion:
            self.say(0x280 + self.node, cia402.motion_value(cia402.Motion(self.position, self.velocity)))

    def receive_other(self, identifier: int, data: bytes) -> None:
        if identifier == protocol.SYNC_ID and self.parameters[0x1800, 2] != b"\xff":
            self.report()
        elif identifier == protocol.receive_pdo_id(self.node) and self.state is NmtState.OPERATIONAL:
            self.commands.append(cia402.command_of(data))
            self.command_ns.append(self.clock.ns)
            self.step(self.commands[-1].controlword)
        elif identifier == protocol.heartbeat_id(127):
            assert data == b"\5"
            self.beats_ns.append(self.clock.ns)

    def read(self, index: int, subindex: int) -> None:
        if index == 0x6041:
            self.parameters[0x6041, 0] = struct.pack("<H", self.statusword)
        super().read(index, subindex)

    def write(self, index: int, subindex: int, value: bytes) -> None:
        super().write(index, subindex, value)
        if index == 0x6040:
            self.step(int.from_bytes(value, "little"))

    def step(self, controlword: int) -> None:
        risen, self.last_controlword = controlword & ~self.last_controlword, controlword
        if self.where is State.FAULT:
            if risen & Controlword.FAULT_RESET and State.SWITCH_ON_DISABLED not in self.refuses:
                self.resets += 1
                self.where = State.SWITCH_ON_DISABLED
        elif controlword == Controlword.DISABLE_VOLTAGE:
            self.where = State.SWITCH_ON_DISABLED
        elif (goal := self.STEPS.get((self.where, Controlword(controlword)))) and goal not in self.refuses:
            self.where = goal


class ScriptedSensor(ScriptedNode):
    """A torque sensor that sends when the test says so."""

    def __init__(self, world, node: int) -> None:
        super().__init__(world, node, 0x00020194)
        for number in range(2):
            identifier = 0x180 + 0x100 * number + node
            self.parameters[0x1800 + number, 1] = struct.pack("<I", identifier)
            self.parameters |= {(0x1800 + number, sub): bytes(1 if sub == 2 else 2) for sub in (2, 3, 5)}

    def value(self, digits: int) -> None:
        self.say(0x180 + self.node, struct.pack("<i", digits))

    def status(self, bits: int) -> None:
        self.say(0x280 + self.node, struct.pack("<H", bits))
