"""A VESC as it behaves on its UART or its USB port.

Source: vedderb/bldc: comm/packet.c (what is no packet is passed over), comm/commands.c (what is answered with what; a
current is the average since it was asked for last), applications/app_uartcomm.c (bytes wait for a thread of low
priority). A drive that is reached through another, over CAN, answers later.
"""

from collections.abc import Mapping
from functools import partial
from random import Random

from norton_drivers.codecs import vesc as protocol
from norton_drivers.codecs import vesc_uart
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.vesc_uart import PacketStream, Say, Value
from norton_drivers.vesc.options import VescUartOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault
from norton_sim.firmware.vesc_motor import SUPPLY_V, VERSION, VescMotor

CURRENT_PERIOD_NS = 250_000  # of the samples that are averaged; the real one has some 20 of them a millisecond
PROCESSING_NS, PROCESSING_JITTER_NS = 60_000, 80_000
FORWARDING_NS = 600_000


class VescSerial:
    """One motor."""

    def __init__(self, context: DeviceContext) -> None:
        self._options = options = parse_options(VescUartOptions, context.settings)
        self.motor = VescMotor(context, options)
        self._world = context.world
        self._random: Random = context.random
        self._stream = PacketStream()
        self._current_as, self._samples = 0.0, 0
        self._free_ns = 0  # one packet is dealt with after the other
        self._connector = context.serial_connector()
        self._connector.on_bytes(self._receive)
        context.cyclic(CURRENT_PERIOD_NS, self._sample)

    @property
    def armed(self) -> bool:
        return self.motor.amplifier.running

    def break_down(self, fault: DriveFault) -> None:
        self.motor.amplifier.break_down(fault)

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self.motor.freeze()

    def _sample(self, _stamp_ns: int) -> None:
        self._current_as += self.motor.current_a()
        self._samples += 1

    def _average_current_a(self) -> float:
        """Since the last time that it was asked for."""
        total, count = self._current_as, self._samples
        self._current_as, self._samples = 0.0, 0
        return total / count if count else self.motor.current_a()

    def _receive(self, data: bytes) -> None:
        for received in self._stream.feed(data):
            node, payload = vesc_uart.unforwarded(received.payload)
            if node != self._options.forward:
                continue  # for another, who is not there
            wait_ns = PROCESSING_NS + self._random.randrange(PROCESSING_JITTER_NS)
            wait_ns += 0 if node is None else FORWARDING_NS
            self._free_ns = max(self._free_ns, self._world.now_ns + wait_ns)
            self._world.at(self._free_ns, partial(self._deal_with, payload))

    def _deal_with(self, payload: bytes, _stamp_ns: int) -> None:
        try:
            answer = self._answer_to(payload)
        except CodecError:
            return  # cut short
        if answer is not None:
            self._connector.send(vesc_uart.packet(answer))

    def _answer_to(self, payload: bytes) -> bytes | None:
        match payload[0]:
            case Say.SET_CURRENT:
                self.motor.set_current(protocol.current_of(payload[1:5]))
            case Say.SET_DUTY:
                self.motor.set_duty(protocol.duty_of(payload[1:5]))
            case Say.ALIVE:
                self.motor.amplifier.heed()
            case Say.FW_VERSION:
                return protocol.version_value(*VERSION)
            case Say.GET_VALUES:
                return vesc_uart.all_values_value(self._values(~0))
            case Say.GET_VALUES_SELECTIVE if (mask := vesc_uart.mask_in(payload)) >= 0:
                return vesc_uart.values_value(self._values(mask), mask)
        return None

    def _values(self, mask: int) -> Mapping[Value, float]:
        motor = self.motor
        values: dict[Value, float] = {
            Value.TRANSISTOR_C: motor.amplifier.heating.temperature_c,
            Value.SUPPLY_A: motor.supply_a(),
            Value.DUTY: motor.duty(),
            Value.ERPM: motor.erpm(),
            Value.SUPPLY_V: SUPPLY_V,
            Value.TACHOMETER: motor.tachometer(),
            Value.FAULT: motor.amplifier.fault,
            Value.POSITION_DEG: motor.angle_deg(),
            Value.STATUS: vesc_uart.TIMED_OUT * motor.amplifier.timed_out,
        }
        if mask >> Value.Q_A & 1:
            values[Value.Q_A] = self._average_current_a()
            values[Value.MOTOR_A] = motor.drawn_a()
        return values
