"""A CANopen servo drive, profile CiA 402, in its torque modes.

Source: CiA 402-2 ("State control of the device", 6007h, 603Fh, 605Ah, 605Eh) and CiA 402-3 ("Profile torque mode",
"Cyclic synchronous torque mode"). Torque comes and goes in the units that the rig names, as whole numbers; so do counts
and velocity. At power-on its PDOs are mapped as the standard has them, and its encoder counts from zero. A fault lets
the motor go at once; a quick stop gives it no torque for a moment, and then lets it go.
"""

from collections.abc import Callable, Mapping
from math import tau
from typing import cast

from norton_drivers.canopen.cia402 import Cia402Options
from norton_drivers.codecs.canopen import ABORT_VALUE
from norton_drivers.codecs.cia402 import REMOTE, VOLTAGE_ENABLED, Mode, Object, State, statusword_of
from norton_drivers.wiring import parse_options
from norton_sim.firmware.canopen.node import ERROR_HEARTBEAT_LOST, CanopenNode
from norton_sim.firmware.canopen.objects import I8, I16, I32, U8, U16, U32, AbortError, Entry
from norton_sim.firmware.canopen.process_data import SentPdo, Timer
from norton_sim.firmware.context import DeviceContext, DriveFault, Heating
from norton_sim.plant import Machine

DEVICE_TYPE = 0x00020192  # a servo drive of profile 402
MAX_TORQUE_PER_MILLE = 3000
SLOPE_PER_MILLE_S = 1000  # of a profile torque, until it is set
CONTROL_PERIOD_MS = 0.25  # of the profile's generator
QUICK_STOP_MS = 10.0
WARMING_PERIOD_NS = 10_000_000

ERROR_TOO_HOT = 0x4310
ERROR_CODES: Mapping[DriveFault, int] = {
    DriveFault.FAULT: 0x2310,  # continuous over-current
    DriveFault.UNDERVOLTAGE: 0x3220,
    DriveFault.OVER_TEMPERATURE: ERROR_TOO_HOT,
}
_FOLLOWS_TARGET = 1 << 12  # of the statusword, in cyclic synchronous torque
_FAULT_RESET = 1 << 7  # of the controlword
_FAULT, _DISABLE, _QUICK_STOP = 1, 2, 3  # what 6007h may be, besides 0: nothing
_END, _STAY = 2, 6  # what 605Ah may be: in "Switch on disabled", or in "Quick stop active"
_MODES = (0, Mode.PROFILE_TORQUE, Mode.CYCLIC_SYNCHRONOUS_TORQUE)


class Cia402Drive:
    """The drive, and the machine it drives, by its role. ``error`` is its error code (603Fh)."""

    def __init__(self, context: DeviceContext) -> None:
        self.options = parse_options(Cia402Options, context.settings)
        self.state = State.SWITCH_ON_DISABLED
        self.error = 0
        self.heating = Heating()
        self.node = CanopenNode(context, self.options.node, DEVICE_TYPE, "simulated servo drive")
        self._plant = context.world.plant
        self._machine = cast(Machine, context.settings.role)
        self._units_per_a = 1 / (_amperes_per_nm(context) * self.options.torque_per_unit_nm)
        self._controlword = 0
        self._demand = 0.0  # the torque that is given, in units
        self._zero_counts = 0
        self._frozen: tuple[int, int] | None = None
        self._ramp = Timer(context.world, context.clock_ppm)
        self._goal = 0
        self._quick_stop = Timer(context.world, context.clock_ppm)
        self._add_settings()
        self._add_command()
        self._add_feedback()
        self._status_pdo = self._add_process_data()
        self.node.on_host_lost = self._lose_host
        self.node.on_stopped = self._leave_operation
        self.node.on_power_on = self._power_on
        context.cyclic(WARMING_PERIOD_NS, self._warm)

    @property
    def armed(self) -> bool:
        return self.state in (State.OPERATION_ENABLED, State.QUICK_STOP)

    def break_down(self, fault: DriveFault) -> None:
        self.fail(ERROR_CODES[fault])

    def freeze(self) -> None:
        """From now on report the position and velocity of this instant."""
        self._frozen = (self._position(), self._velocity())

    def fail(self, error: int) -> None:
        """Detect an error: let the motor go, report it, and stay so until the fault is reset."""
        self.node.emergency(error)
        self._enter_fault(error)

    # ---- Its object dictionary -----------------------------------------------------------------------------------

    def _add(self, index: int, entry: Entry, subindex: int = 0) -> Entry:
        return self.node.objects.add(index, subindex, entry)

    def _add_settings(self) -> None:
        per_mille_nm, options = 1e3 * self.options.torque_per_unit_nm, self.options
        rated_current_ma = round(1e6 * (options.current_per_unit_a or 1e-3))
        settable = self._settable
        self._host_lost_option = settable(Object.ABORT_CONNECTION_OPTION, (0, _FAULT, _DISABLE, _QUICK_STOP), _FAULT)
        self._quick_stop_option = settable(Object.QUICK_STOP_OPTION, (_END, _STAY), _END)
        settable(Object.FAULT_REACTION_OPTION, (0,), 0)
        self._max_torque = self._add(Object.MAX_TORQUE, Entry(U16, MAX_TORQUE_PER_MILLE, writable=True, mappable=True))
        self._slope = self._add(Object.TORQUE_SLOPE, Entry(U32, SLOPE_PER_MILLE_S, writable=True, mappable=True))
        self._add(Object.RATED_CURRENT, Entry(U32, rated_current_ma))
        self._add(Object.RATED_TORQUE, Entry(U32, round(1e3 * per_mille_nm)))
        self._add(Object.INTERPOLATION_PERIOD, Entry(U8, 2))
        self._add(Object.INTERPOLATION_PERIOD, Entry(U8, 1, writable=True), 1)
        self._add(Object.INTERPOLATION_PERIOD, Entry(I8, -3, writable=True, written=_one_of(-3)), 2)
        supported = Mode.PROFILE_TORQUE.supported_bit | Mode.CYCLIC_SYNCHRONOUS_TORQUE.supported_bit
        self._add(Object.SUPPORTED_MODES, Entry(U32, supported))

    def _settable(self, index: int, values: tuple[int, ...], value: int) -> Entry:
        return self._add(index, Entry(I16, value, writable=True, written=_one_of(*values)))

    def _add_command(self) -> None:
        self._add(Object.CONTROLWORD, Entry(U16, writable=True, mappable=True, written=self._obey))
        self._mode = self._add(Object.MODE, Entry(I8, writable=True, mappable=True, written=_one_of(*_MODES)))
        self._target = self._add(Object.TARGET_TORQUE, Entry(I16, writable=True, mappable=True, written=self._aim))

    def _add_feedback(self) -> None:
        plant, machine = self._plant, self._machine

        def torque() -> int:
            return _clipped(plant.current_a(machine) * self._units_per_a, I16.size)

        def current() -> int:
            return _clipped(plant.current_a(machine) / (self.options.current_per_unit_a or 1.0), I16.size)

        self._add(Object.ERROR_CODE, Entry(U16, mappable=True, read=lambda: self.error))
        self._add(Object.STATUSWORD, Entry(U16, mappable=True, read=self._statusword))
        self._add(Object.MODE_SHOWN, Entry(I8, mappable=True, read=lambda: self._mode.value))
        self._add(Object.POSITION, Entry(I32, mappable=True, read=self._position))
        self._add(Object.VELOCITY, Entry(I32, mappable=True, read=self._velocity))
        self._add(Object.TORQUE, Entry(I16, mappable=True, read=torque))
        self._add(Object.CURRENT, Entry(I16, mappable=True, read=current))

    def _add_process_data(self) -> SentPdo:
        """As CiA 402 maps them at power-on. Returns the one with the statusword."""
        control, mode, status = 0x60400010, 0x60600008, 0x60410010
        for number, mapped in enumerate(((control,), (control, mode), (control, 0x60710010), ()), start=1):
            self.node.add_received(number, mapped)
        status_pdo = self.node.add_sent(1, (status,))
        for number, mapped in enumerate(((status, 0x60640020), (status, 0x606C0020), (status, 0x60770010)), start=2):
            self.node.add_sent(number, mapped)
        return status_pdo

    # ---- What it says --------------------------------------------------------------------------------------------

    def _statusword(self) -> int:
        follows = self.state is State.OPERATION_ENABLED and self._mode.value == Mode.CYCLIC_SYNCHRONOUS_TORQUE
        return statusword_of(self.state) | VOLTAGE_ENABLED | REMOTE | (_FOLLOWS_TARGET if follows else 0)

    def _position(self) -> int:
        if self._frozen is not None:
            return self._frozen[0]
        counts = self._counts() - self._zero_counts
        return (counts + (1 << 31)) % (1 << 32) - (1 << 31)

    def _counts(self) -> int:
        return round(self._plant.encoder_position_rad(self._machine) * self.options.counts_per_turn / tau)

    def _velocity(self) -> int:
        if self._frozen is not None:
            return self._frozen[1]
        velocity_rad_s = self._plant.encoder_velocity_rad_s(self._machine)
        return _clipped(velocity_rad_s / self.options.velocity_per_unit_rad_s, I32.size)

    # ---- Its states ----------------------------------------------------------------------------------------------

    def _obey(self, controlword: int) -> None:
        """The transitions of the standard's figure, by the bits that count in each command."""
        risen = controlword & ~self._controlword
        self._controlword = controlword
        state = self.state
        if state is State.FAULT:
            if risen & _FAULT_RESET:
                self._reset_fault()
        elif state is State.SWITCH_ON_DISABLED:
            if controlword & 0x87 == 0x06:
                self._enter(State.READY)
        elif not controlword & 0x02:
            self._enter(State.SWITCH_ON_DISABLED)
        elif not controlword & 0x04:
            self._stop_quickly()
        elif controlword & 0x87 == 0x06 and state is not State.QUICK_STOP:
            self._enter(State.READY)
        elif controlword & 0x8F == 0x07 and state is not State.QUICK_STOP:
            self._enter(State.SWITCHED_ON)
        elif controlword & 0x8F == 0x0F and self._may_be_enabled():
            self._enter(State.OPERATION_ENABLED)

    def _may_be_enabled(self) -> bool:
        stays = self._quick_stop_option.value == _STAY
        return self.state is State.SWITCHED_ON or (self.state is State.QUICK_STOP and stays)

    def _enter(self, state: State) -> None:
        if state is self.state:
            return
        self.state = state
        self._quick_stop.stop()
        self._ramp.stop()
        self._demand = 0.0
        if state is State.OPERATION_ENABLED:
            self._aim(self._target.value)
        elif state is State.QUICK_STOP:
            self._plant.command(self._machine, 0.0)
        else:
            self._plant.release(self._machine)
        self._status_pdo.event()

    def _stop_quickly(self) -> None:
        if self.state in (State.READY, State.SWITCHED_ON):
            self._enter(State.SWITCH_ON_DISABLED)
        elif self.state is State.OPERATION_ENABLED:
            self._enter(State.QUICK_STOP)
            if self._quick_stop_option.value == _END:
                self._quick_stop.start(QUICK_STOP_MS, lambda: self._enter(State.SWITCH_ON_DISABLED))

    def _enter_fault(self, error: int) -> None:
        self.error = error
        self._enter(State.FAULT)

    def _reset_fault(self) -> None:
        if self.node.bus_lost or self.heating.too_hot:
            return  # what is still wrong cannot be reset
        self.error = 0
        self.node.emergency(0)
        self._enter(State.SWITCH_ON_DISABLED)

    def _lose_host(self) -> None:
        option = self._host_lost_option.value
        if option == _FAULT:
            self._enter_fault(ERROR_HEARTBEAT_LOST)
        elif option == _DISABLE and self.state is not State.FAULT:
            self._enter(State.SWITCH_ON_DISABLED)
        elif option == _QUICK_STOP:
            self._stop_quickly()

    def _leave_operation(self) -> None:
        """Told to stop communicating while it drives: as if the host were lost."""
        if self.armed:
            self._lose_host()

    def _power_on(self) -> None:
        self._enter(State.SWITCH_ON_DISABLED)
        self.error = self._controlword = self._mode.value = self._target.value = 0
        self._zero_counts = self._counts()

    def _warm(self, _stamp_ns: int) -> None:
        self.heating.carry(self._plant.true_current_a(self._machine), WARMING_PERIOD_NS * 1e-9)
        if self.heating.too_hot and self.state is not State.FAULT:
            self.fail(ERROR_TOO_HOT)

    # ---- Its torque ----------------------------------------------------------------------------------------------

    def _aim(self, target: int) -> None:
        if self.state is not State.OPERATION_ENABLED:
            return
        limit = self._max_torque.value
        goal = min(max(target, -limit), limit)
        if self._mode.value == Mode.CYCLIC_SYNCHRONOUS_TORQUE:
            self._give(goal)
        elif self._mode.value == Mode.PROFILE_TORQUE:
            self._goal = goal
            if not self._ramp.running:  # it keeps its own time, however often it is told a new goal
                self._ramp.start(CONTROL_PERIOD_MS, self._approach)

    def _approach(self) -> None:
        """One period of a profile torque."""
        goal = self._goal
        step = self._slope.value * CONTROL_PERIOD_MS * 1e-3
        self._give(min(max(goal, self._demand - step), self._demand + step))
        if self._demand == goal:
            self._ramp.stop()

    def _give(self, units: float) -> None:
        self._demand = units
        self._plant.command(self._machine, units * self.options.torque_per_unit_nm)


def _one_of(*values: int) -> Callable[[int], None]:
    def check(value: int) -> None:
        if value not in values:
            raise AbortError(ABORT_VALUE)

    return check


def _clipped(value: float, size: int) -> int:
    """A whole number of ``size`` bytes."""
    most = (1 << 8 * size - 1) - 1
    return min(max(round(value), -most), most)


def _amperes_per_nm(context: DeviceContext) -> float:
    """The drive's own idea of its motor: the current that it sets for each newton metre of its target."""
    return context.truth.driven(context.settings.role).amplifier_gain
