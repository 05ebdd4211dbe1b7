"""A VESC in FOC mode with an encoder, as it behaves on CAN.

Source: vedderb/bldc: comm/comm_can.c (commands, status messages and their casts), motor/mcpwm_foc.c (the sign of the
current; voltage to duty cycle; the tachometer), comm/commands.c. Status messages come as a bench would configure them:
1, 4 and, where the tachometer is wanted, 5 at 1 kHz, else 5 at 10 Hz.

Only the commands of the rig's mode are emulated, and a current of zero. In duty mode the voltage is over the winding:
the resistance follows from the plant's amplifier gain [A for a duty cycle of 1], the back-EMF from its torque constant
and the velocity, eight times a millisecond, and the amplifier's bandwidth stands for the winding's inductance.
"""

from functools import partial
from math import copysign, degrees, floor, pi, sqrt, tau
from typing import cast

import can

from norton_drivers.codecs import vesc as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.vesc import Packet
from norton_drivers.vesc import VescOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault
from norton_sim.firmware.releasing import ReleasingAmplifier
from norton_sim.plant import Machine

FAST_PERIOD_NS = 1_000_000
SLOW_PERIOD_NS = 100_000_000
DUTY_PERIOD_NS = 125_000

SUPPLY_V = 24.0
WINDING_OHM = 0.1  # where no voltage is commanded, it shows in the duty cycle alone
MOST_DUTY = 0.95
DUTY_PER_SHARE = sqrt(3.0)  # duty cycle 1 is the greatest circle's voltage, supply / √3
AMPLITUDE_PER_TORQUE_CURRENT = 2.0 / 3.0  # flux linkage times pole pairs, for each newton metre per ampere

VERSION = (6, 5, "60")
FAULTS = {DriveFault.FAULT: 3, DriveFault.UNDERVOLTAGE: 2, DriveFault.OVER_TEMPERATURE: 5}


class VescController:
    """One motor."""

    def __init__(self, context: DeviceContext) -> None:
        self._options = options = parse_options(VescOptions, context.settings)
        self._world = context.world
        self._plant = context.world.plant
        self._machine = cast(Machine, context.settings.role)
        truth = context.truth.driven(self._machine)
        self._amplifier_gain = truth.amplifier_gain
        self._volt_s_rad = AMPLITUDE_PER_TORQUE_CURRENT * truth.torque_constant_nm_a
        in_duty = options.mode == "duty"
        self.amplifier = ReleasingAmplifier(
            context,
            self._machine,
            FAULTS,
            minimum_current_a=options.minimum_current_a,
            timeout_s=options.watchdog_s,
            per_ampere=1 / self._amplifier_gain if in_duty else options.per_ampere,
        )
        self.amplifier.on_release = self._end_duty
        self.heating = self.amplifier.heating
        self._duty: float | None = None  # where the voltage is what is commanded
        self._frozen: tuple[float, float] | None = None
        self._assembler = protocol.Assembler()
        self._connector = context.can_connector()
        self._connector.on_frame(self._receive)
        context.cyclic(FAST_PERIOD_NS, self._send_fast)
        context.cyclic(SLOW_PERIOD_NS, partial(self._send_status_5))
        if in_duty:
            context.cyclic(DUTY_PERIOD_NS, self._press)

    @property
    def armed(self) -> bool:
        return self.amplifier.running

    @property
    def fault(self) -> int:
        """Its fault code."""
        return self.amplifier.fault

    def break_down(self, fault: DriveFault) -> None:
        self.amplifier.break_down(fault)

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self._frozen = self._motion()

    # ---- what it says ----

    def _send_fast(self, stamp_ns: int) -> None:
        position_rad, velocity_rad_s = self._motion()
        erpm = velocity_rad_s * self._options.pole_pairs * 60 / tau
        status = protocol.Status(erpm, self._drawn_a(), self._duty_now())
        self._send(Packet.STATUS, status.encode())
        supply_a = self._winding_ohm * self._plant.true_current_a(self._machine) ** 2 / SUPPLY_V
        angle_deg = degrees(position_rad) % 360.0
        self._send(Packet.STATUS_4, protocol.Status4(self.heating.temperature_c, 0.0, supply_a, angle_deg).encode())
        if self._options.position == "tachometer":
            self._send_status_5(stamp_ns)

    def _send_status_5(self, _stamp_ns: int) -> None:
        sixths_per_rad = protocol.TACHOMETER_PER_ELECTRICAL_TURN * self._options.pole_pairs / (2 * pi)
        tachometer = floor(self._motion()[0] * sixths_per_rad)
        self._send(Packet.STATUS_5, protocol.Status5(tachometer, SUPPLY_V).encode())

    def _send(self, packet: Packet, data: bytes) -> None:
        self._connector.send(protocol.arbitration_id(packet, self._options.node), data, extended=True)

    def _motion(self) -> tuple[float, float]:
        """Position [rad] and velocity [rad/s]."""
        if self._frozen is not None:
            return self._frozen
        plant, machine = self._plant, self._machine
        return plant.encoder_position_rad(machine), plant.encoder_velocity_rad_s(machine)

    @property
    def _winding_ohm(self) -> float:
        if self._options.mode == "duty":
            return SUPPLY_V / (DUTY_PER_SHARE * self._amplifier_gain)
        return WINDING_OHM

    def _voltage_v(self) -> float:
        """Along the q axis; a motor that is let go of shows its back-EMF."""
        back_emf_v = self._volt_s_rad * self._plant.encoder_velocity_rad_s(self._machine)
        return back_emf_v + self._winding_ohm * self._plant.true_current_a(self._machine)

    def _duty_now(self) -> float:
        return min(max(DUTY_PER_SHARE * self._voltage_v() / SUPPLY_V, -1.0), 1.0)

    def _drawn_a(self) -> float:
        """Positive where the motor draws power, negative where it generates."""
        if not self.armed:
            return 0.0
        current_a = self._plant.current_a(self._machine)
        return copysign(1.0, self._voltage_v()) * current_a

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
                self._set_current(protocol.current_of(data))
            case Packet.SET_DUTY if self._options.mode == "duty":
                self._set_duty(protocol.duty_of(data))
            case Packet.PING if data:
                identifier = protocol.arbitration_id(Packet.PONG, data[0])
                self._connector.send(identifier, protocol.pong_value(self._options.node), extended=True)
            case _:
                received = self._assembler.feed(packet, data)
                if received is not None and received.handling == protocol.Handling.ANSWER:
                    self._answer(received)

    def _set_current(self, current_a: float) -> None:
        if self.amplifier.set_current(current_a):
            self._end_duty()

    def _set_duty(self, duty: float) -> None:
        if self.amplifier.heed():
            self.amplifier.running, self._duty = True, min(max(duty, -MOST_DUTY), MOST_DUTY)
            self._press(self._world.now_ns)

    def _end_duty(self) -> None:
        self._duty = None

    def _answer(self, received: protocol.Received) -> None:
        if received.payload == protocol.ask_fault():
            answer = protocol.fault_value(self.fault)
        elif received.payload == protocol.ask_version():
            answer = protocol.version_value(*VERSION)
        else:
            return
        handling = protocol.Handling.TAKE
        for frame in protocol.frames_of(answer, sender=self._options.node, receiver=received.sender, handling=handling):
            self._connector.send(frame.arbitration_id, frame.data, extended=True)

    # ---- what it does by itself ----

    def _press(self, _stamp_ns: int) -> None:
        """Voltage over the winding: what the back-EMF leaves of it drives the current."""
        if self._duty is not None:
            back_emf_v = self._volt_s_rad * self._plant.encoder_velocity_rad_s(self._machine)
            self._plant.command(self._machine, self._duty - DUTY_PER_SHARE * back_emf_v / SUPPLY_V)
