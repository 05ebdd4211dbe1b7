"""A VESC as it behaves on CAN.

Source: vedderb/bldc: comm/comm_can.c (commands, status messages and their casts), comm/commands.c. Status messages come
as a bench would configure them: 1, 4 and, where the tachometer is wanted, 5 at 1 kHz, else 5 at 10 Hz.
"""

import can

from norton_drivers.codecs import vesc as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.vesc import Packet
from norton_drivers.vesc import VescOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault
from norton_sim.firmware.vesc_motor import SUPPLY_V, VERSION, VescMotor

FAST_PERIOD_NS = 1_000_000
SLOW_PERIOD_NS = 100_000_000


class VescController:
    """One motor."""

    def __init__(self, context: DeviceContext) -> None:
        self._options = options = parse_options(VescOptions, context.settings)
        self.motor = VescMotor(context, options)
        self._assembler = protocol.Assembler()
        self._connector = context.can_connector()
        self._connector.on_frame(self._receive)
        context.cyclic(FAST_PERIOD_NS, self._send_fast)
        context.cyclic(SLOW_PERIOD_NS, self._send_status_5)

    @property
    def armed(self) -> bool:
        return self.motor.amplifier.running

    def break_down(self, fault: DriveFault) -> None:
        self.motor.amplifier.break_down(fault)

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self.motor.freeze()

    # ---- what it says ----

    def _send_fast(self, stamp_ns: int) -> None:
        motor = self.motor
        self._send(Packet.STATUS, protocol.Status(motor.erpm(), motor.drawn_a(), motor.duty()).encode())
        status_4 = protocol.Status4(motor.amplifier.heating.temperature_c, 0.0, motor.supply_a(), motor.angle_deg())
        self._send(Packet.STATUS_4, status_4.encode())
        if self._options.position == "tachometer":
            self._send_status_5(stamp_ns)

    def _send_status_5(self, _stamp_ns: int) -> None:
        self._send(Packet.STATUS_5, protocol.Status5(self.motor.tachometer(), SUPPLY_V).encode())

    def _send(self, packet: Packet, data: bytes) -> None:
        self._connector.send(protocol.arbitration_id(packet, self._options.node), data, extended=True)

    # ---- what it does when told ----

    def _receive(self, message: can.Message) -> None:
        if not message.is_extended_id or message.is_remote_frame:
            return
        packet, node = protocol.split_id(message.arbitration_id)
        if node not in (self._options.node, protocol.EVERYBODY):
            return
        try:
            self._obey(packet, message.data)
        except CodecError:
            return  # cut short

    def _obey(self, packet: int, data: bytearray) -> None:
        match packet:
            case Packet.SET_CURRENT:
                self.motor.set_current(protocol.current_of(data))
            case Packet.SET_DUTY:
                self.motor.set_duty(protocol.duty_of(data))
            case Packet.PING if data:
                identifier = protocol.arbitration_id(Packet.PONG, data[0])
                self._connector.send(identifier, protocol.pong_value(self._options.node), extended=True)
            case _:
                received = self._assembler.feed(packet, data)
                if received is not None and received.handling == protocol.Handling.ANSWER:
                    self._answer(received)

    def _answer(self, received: protocol.Received) -> None:
        if received.payload == protocol.ask_fault():
            answer = protocol.fault_value(self.motor.amplifier.fault)
        elif received.payload == protocol.ask_version():
            answer = protocol.version_value(*VERSION)
        else:
            return
        handling = protocol.Handling.TAKE
        for frame in protocol.frames_of(answer, sender=self._options.node, receiver=received.sender, handling=handling):
            self._connector.send(frame.arbitration_id, frame.data, extended=True)
