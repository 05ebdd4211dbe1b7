"""A RobStride motor or a CyberGear, as it behaves on CAN.

Source: RobStride's and the CyberGear's manuals (see the codec): the answers to each communication type, its modes, its
faults, run_mode (not changed while it runs), canTimeout in twentieths of a millisecond; huggingface/lerobot, pull
request 4070 (parameters that are none). No manual says three things, and here they are as they ask most of a host: it
is enabled with the command that it had last; any frame to it feeds its timeout; after the timeout it is in its reset
mode, without a fault. Only the commands of the rig's mode are emulated.
"""

from contextlib import suppress
from typing import cast

import can

from norton_drivers.codecs import robstride as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.ranges import RELEASED
from norton_drivers.codecs.robstride import Feedback, Kind, Mode, Parameter
from norton_drivers.robstride.options import RobStrideOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault, Heating
from norton_sim.firmware.shaft_loop import ShaftLoop
from norton_sim.plant import Machine

LOOK_PERIOD_NS = 1_000_000
VERSION = bytes((0, 0, 3, 22))
SUPPLY_V = 48.0
# Of each fault: its bit in feedback, and in the frame that tells more.
TOO_HOT = protocol.TOO_HOT, protocol.DETAIL_TOO_HOT
FAULTS = {
    DriveFault.FAULT: (protocol.DRIVER_FAULT, protocol.DETAIL_DRIVER),
    DriveFault.UNDERVOLTAGE: (protocol.UNDERVOLTAGE, protocol.DETAIL_UNDERVOLTAGE),
    DriveFault.OVER_TEMPERATURE: TOO_HOT,
}


class RobStrideMotor:
    """One motor. ``mode`` and ``faults`` are what its feedback says, ``parameters`` what can be read of it."""

    def __init__(self, context: DeviceContext) -> None:
        self.mode = Mode.RESET
        self.faults = 0
        self.heating = Heating()
        self._options = options = parse_options(RobStrideOptions, context.settings)
        self._ranges = options.ranges
        self.parameters: dict[int, float] = {
            Parameter.RUN_MODE: protocol.OPERATION_MODE,
            Parameter.IQ_REF: 0.0,
            Parameter.LIMIT_TORQUE: protocol.MODELS[options.motor].torque_nm,
            Parameter.VBUS: SUPPLY_V,
        }
        # A CyberGear has one as well, which only its maker's tool sets.
        self._timeout_ticks = 0.0 if options.arms_watchdog else options.watchdog_s * protocol.TIMEOUT_TICKS_PER_S
        self._world = context.world
        self._plant = context.world.plant
        self._machine = cast(Machine, context.settings.role)
        truth = context.truth.driven(self._machine)
        servo = options.servo
        # The plant's amplifier is told of in amperes per unit of the rig's command.
        self._nm_per_unit = 1.0 if servo is None else servo.gain
        constant_nm_a = options.torque_constant_nm_a or truth.torque_constant_nm_a
        in_amperes = options.mode == "current"
        self._amperes_per_nm = 1 / constant_nm_a if in_amperes else truth.amplifier_gain / self._nm_per_unit
        self._goal = RELEASED
        self._zero_rad = 0.0
        self._heard_ns = context.world.now_ns
        self._host = options.host
        self._frozen: tuple[float, float] | None = None
        self._loops = servo is not None  # whether it works out a loop
        self._connector = context.can_connector()
        self._connector.on_frame(self._receive)
        context.cyclic(LOOK_PERIOD_NS, self._look)
        if servo is not None:
            ShaftLoop(context, self._machine, servo, options.loop_period_s, self._hold)

    @property
    def armed(self) -> bool:
        return self.mode == Mode.RUN

    def break_down(self, fault: DriveFault) -> None:
        self._trip(*FAULTS[fault])

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self._frozen = self._motion()

    # ---- what it says ----

    def _send(self, identifier: int, data: bytes) -> None:
        self._connector.send(identifier, data, extended=True)

    def _answer(self) -> None:
        position_rad, velocity_rad_s = self._motion()
        torque_nm = self._plant.current_a(self._machine) / self._amperes_per_nm
        codes = self._ranges.cut(position_rad, velocity_rad_s, torque_nm)
        held = [min(max(code, 0), 0xFFFF) for code in codes]
        position = codes[0] if self._options.beyond_range == "wraps" else held[0]
        tenths_c = int(10 * self.heating.temperature_c)
        told = Feedback(self._options.node, self.mode, self.faults, position, held[1], held[2], tenths_c)
        self._send(*told.encode(self._host))

    def _motion(self) -> tuple[float, float]:
        """Position [rad] from where zero was set, and velocity [rad/s]."""
        if self._frozen is not None:
            return self._frozen
        position_rad = self._plant.encoder_position_rad(self._machine)
        return position_rad - self._zero_rad, self._plant.encoder_velocity_rad_s(self._machine)

    # ---- what it does when told ----

    def _receive(self, message: can.Message) -> None:
        if not message.is_extended_id or message.is_remote_frame:
            return
        kind, extra, node = protocol.split_id(message.arbitration_id)
        if node != self._options.node:
            return
        self._heard_ns = self._world.now_ns
        if kind != Kind.CONTROL:
            self._host = extra & 0xFF
        with suppress(CodecError):  # cut short
            self._obey(kind, extra, message.data)

    def _obey(self, kind: int, extra: int, data: bytearray) -> None:
        match kind:
            case Kind.CONTROL:
                self._goal = protocol.goal_of(extra, data, self._ranges)
                self._answer()
                self._drive()
            case Kind.ENABLE:
                self.mode = Mode.RESET if self.faults else Mode.RUN
                self._drive()
                self._answer()
            case Kind.STOP:
                self._on_stop(data)
            case Kind.ZERO:
                self._zero_rad = self._plant.encoder_position_rad(self._machine)
                self._answer()
            case Kind.READ:
                self._on_question(*protocol.parameter_of(data))
            case Kind.WRITE:
                self._on_write(*protocol.parameter_of(data))
                self._answer()

    def _on_stop(self, data: bytearray) -> None:
        if data[:1] == b"\1":
            self.faults = 0
        self._let_go()
        if data[:2] != protocol.VERSION_QUESTION[:2]:
            self._answer()
            return
        told = Feedback(self._options.node, self.mode, self.faults, 0, 0, 0, 0)
        self._send(told.encode(self._host)[0], protocol.version_value(VERSION))

    def _on_question(self, index: int, _raw: bytes) -> None:
        value = self._motion()[0] if index == Parameter.MECH_POS else self.parameters.get(index)
        raw = None if value is None else protocol.raw_of(index, value)
        self._send(*protocol.answer_value(self._options.node, self._host, index, raw))

    def _on_write(self, index: int, raw: bytes) -> None:
        value = protocol.value_of(index, raw)
        if index == Parameter.CAN_TIMEOUT and self._options.arms_watchdog:
            self._timeout_ticks = value
        elif index in self.parameters and not (index == Parameter.RUN_MODE and self.armed):
            self.parameters[index] = value
            self._drive()

    def _drive(self) -> None:
        if self.armed and not self._loops:
            in_amperes = self.parameters[Parameter.RUN_MODE] == protocol.CURRENT_MODE
            in_rig_unit = self.parameters[Parameter.IQ_REF] if in_amperes else self._goal.torque_nm
            self._plant.command(self._machine, in_rig_unit)

    # ---- what it does by itself ----

    def _hold(self, position_rad: float, velocity_rad_s: float) -> None:
        """One cycle of its loop."""
        if self.armed:
            torque_nm = self._goal.held_nm(position_rad - self._zero_rad, velocity_rad_s)
            self._plant.command(self._machine, torque_nm / self._nm_per_unit)

    def _look(self, stamp_ns: int) -> None:
        self.heating.carry(self._plant.true_current_a(self._machine), LOOK_PERIOD_NS * 1e-9)
        if self.heating.too_hot and not self.faults & protocol.TOO_HOT:
            self._trip(*TOO_HOT)
        silent_ticks = (stamp_ns - self._heard_ns) * 1e-9 * protocol.TIMEOUT_TICKS_PER_S
        if self.armed and 0 < self._timeout_ticks < silent_ticks:
            self._let_go()

    def _trip(self, feedback_bit: int, detail: int) -> None:
        self.faults |= feedback_bit
        self._let_go()
        self._send(*protocol.faults_value(self._options.node, self._host, detail))

    def _let_go(self) -> None:
        self.mode, self._goal = Mode.RESET, RELEASED
        self.parameters[Parameter.IQ_REF] = 0.0
        self._plant.release(self._machine)
