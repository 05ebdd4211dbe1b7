"""A Damiao DM motor in its MIT mode, as it behaves on CAN.

Source: umeow0716/damiao_firmware, recovered from Damiao's DM4310 V5017: app/src/can_protocol.c (answered whatever the
family of the identifier), app_commands.c (enabled only without a fault; what is commanded before is kept), interrupts.c
(frames to 0x7FF do not feed the timeout; a fault lets go of the motor), safety.c (the timeout, while enabled; faults
stay until they are cleared), parameter_protocol.c (registers), motor_control.c and position_sensor.c (velocity and
torque are filtered, once a millisecond; the position loop runs 20 times in that), app_config.c (factory settings).
"""

from contextlib import suppress
from math import pi
from typing import cast

import can

from norton_drivers.codecs import damiao as protocol
from norton_drivers.codecs import mit
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.damiao import Operation, Register, RegisterFrame, Special
from norton_drivers.codecs.ranges import RELEASED, Ranges
from norton_drivers.damiao.options import UNFILTERED_HZ, VELOCITY_PERIOD_S, DamiaoOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault, Heating
from norton_sim.plant import Machine

PERIOD_NS = 1_000_000
FACTORY_RANGES = (12.5, 30.0, 10.0)  # of a DM4310
VERSION = int.from_bytes(b"5017", "little")
WRITABLE = (Register.MST_ID, Register.ESC_ID, Register.TIMEOUT, Register.CTRL_MODE, Register.PMAX, Register.VMAX,
            Register.TMAX, Register.V_BW, Register.CAN_BR)  # fmt: skip
FAULTS = {
    DriveFault.FAULT: protocol.OVER_CURRENT,
    DriveFault.UNDERVOLTAGE: protocol.UNDERVOLTAGE,
    DriveFault.OVER_TEMPERATURE: protocol.TRANSISTORS_TOO_HOT,
}


class DamiaoMotor:
    """One motor. ``status`` is what its feedback says, ``registers`` what can be read of it."""

    def __init__(self, context: DeviceContext) -> None:
        self.status = protocol.DISABLED
        self.heating = Heating()
        options = parse_options(DamiaoOptions, context.settings)
        given = options.position_range_rad, options.velocity_range_rad_s, options.torque_range_nm
        ranges = [there or factory for there, factory in zip(given, FACTORY_RANGES, strict=True)]
        self.registers: dict[int, float] = {
            Register.KT_VALUE: 0.0,
            Register.MST_ID: options.master,
            Register.ESC_ID: options.node,
            Register.TIMEOUT: 0,
            Register.CTRL_MODE: protocol.MIT_MODE,
            Register.SW_VER: VERSION,
            Register.GR: 1.0,
            **dict(zip((Register.PMAX, Register.VMAX, Register.TMAX), ranges, strict=True)),
            Register.V_BW: options.velocity_bandwidth_hz,
            Register.CAN_BR: 4,
            Register.SUB_VER: 4,
        }
        self._world = context.world
        self._plant = context.world.plant
        self._machine = cast(Machine, context.settings.role)
        # The plant's amplifier is told of in amperes per unit of the rig's command: with a servo, one of error.
        self._nm_per_unit = 1.0 if options.servo is None else options.servo.gain
        self._amperes_per_nm = context.truth.driven(self._machine).amplifier_gain / self._nm_per_unit
        self._goal = RELEASED
        self._zero_rad = 0.0
        self._velocity_rad_s = self._torque_nm = 0.0  # filtered
        self._position_rad = self._plant.encoder_position_rad(self._machine)
        self._heard_ns = context.world.now_ns
        self._frozen: tuple[float, float] | None = None
        self._loops = options.servo is not None
        self._connector = context.can_connector()
        self._connector.on_frame(self._receive)
        context.cyclic(PERIOD_NS, self._observe)
        if self._loops:
            context.cyclic(round(options.loop_period_s * 1e9), self._hold)

    @property
    def armed(self) -> bool:
        return self.status == protocol.ENABLED

    def break_down(self, fault: DriveFault) -> None:
        self._let_go(FAULTS[fault])

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self._frozen = self._motion()

    @property
    def _node(self) -> int:
        return int(self.registers[Register.ESC_ID])

    @property
    def _ranges(self) -> Ranges:
        position_rad, velocity_rad_s, torque_nm = (
            self.registers[each] for each in (Register.PMAX, Register.VMAX, Register.TMAX)
        )
        return Ranges(position_rad, velocity_rad_s, torque_nm)

    # ---- what it says ----

    def _send(self, data: bytes) -> None:
        self._connector.send(int(self.registers[Register.MST_ID]), data)

    def _answer(self) -> None:
        warmth_c = self.heating.temperature_c
        motion = *self._motion(), self._torque_nm
        told = protocol.feedback_of(self._node, self.status, motion, (warmth_c, warmth_c), self._ranges)
        self._send(told.encode())

    def _motion(self) -> tuple[float, float]:
        """Position [rad] from where zero was set, and velocity [rad/s]."""
        if self._frozen is not None:
            return self._frozen
        return self._plant.encoder_position_rad(self._machine) - self._zero_rad, self._velocity_rad_s

    # ---- what it does when told ----

    def _receive(self, message: can.Message) -> None:
        if message.is_extended_id or message.is_remote_frame:
            return
        if message.arbitration_id == protocol.REGISTERS_ID:
            with suppress(CodecError):  # cut short
                self._on_register(RegisterFrame.decode(message.data))
        elif message.arbitration_id & 0xFF == self._node & 0xFF:
            self._heard_ns = self._world.now_ns
            with suppress(CodecError):
                self._obey(message.arbitration_id >> 8, message.data)
            self._answer()

    def _obey(self, family: int, data: bytearray) -> None:
        match protocol.special_of(data):
            case Special.ENABLE if self.status == protocol.DISABLED:
                self.status = protocol.ENABLED
                self._push(self._goal.torque_nm)
            case Special.ENABLE:
                return
            case Special.DISABLE if self.armed:
                self._let_go(protocol.DISABLED)
            case Special.CLEAR:
                self._let_go(protocol.DISABLED)
            case Special.ZERO:
                self._zero_rad = self._plant.encoder_position_rad(self._machine)
            case None if family == 0 and self.registers[Register.CTRL_MODE] == protocol.MIT_MODE:
                self._goal = mit.goal_of(data, self._ranges)
                if self.armed and not self._loops:
                    self._push(self._goal.torque_nm)

    def _on_register(self, asked: RegisterFrame) -> None:
        if asked.node != self._node:
            return
        register = asked.register
        match asked.operation:
            case Operation.REFRESH:
                self._answer()
            case Operation.READ if register in self.registers:
                self._send(asked._replace(raw=protocol.raw_of(register, self.registers[register])).encode())
            case Operation.WRITE if register in WRITABLE:
                self.registers[register] = asked.value
                self._send(asked.encode())
            case Operation.SAVE if not self.armed:
                self._send(asked.encode())

    def _push(self, torque_nm: float) -> None:
        self._plant.command(self._machine, torque_nm / self._nm_per_unit)

    # ---- what it does by itself ----

    def _observe(self, stamp_ns: int) -> None:
        """Once a millisecond: filter, and look at what may be wrong."""
        bandwidth_hz = self.registers[Register.V_BW]
        kept = 0.0 if bandwidth_hz >= UNFILTERED_HZ else 1 / (1 + 2 * pi * bandwidth_hz * VELOCITY_PERIOD_S)
        position_rad = self._plant.encoder_position_rad(self._machine)
        velocity_rad_s = (position_rad - self._position_rad) / VELOCITY_PERIOD_S
        self._position_rad = position_rad
        torque_nm = self._plant.current_a(self._machine) / self._amperes_per_nm
        self._velocity_rad_s += (1 - kept) * (velocity_rad_s - self._velocity_rad_s)
        self._torque_nm += (1 - kept) * (torque_nm - self._torque_nm)
        self.heating.carry(self._plant.true_current_a(self._machine), PERIOD_NS * 1e-9)
        if self.heating.too_hot:
            self._let_go(protocol.TRANSISTORS_TOO_HOT)
        timeout_ns = self.registers[Register.TIMEOUT] * 1e9 / protocol.TIMEOUT_TICKS_PER_S
        if self.armed and 0 < timeout_ns < stamp_ns - self._heard_ns:
            self._let_go(protocol.COMMUNICATION_LOST)

    def _hold(self, _stamp_ns: int) -> None:
        """One cycle of its loop, from the filtered velocity."""
        if self.armed:
            angle_rad = self._plant.encoder_position_rad(self._machine) - self._zero_rad
            self._push(self._goal.held_nm(angle_rad, self._velocity_rad_s))

    def _let_go(self, status: int) -> None:
        self.status, self._goal = status, RELEASED
        self._plant.release(self._machine)
