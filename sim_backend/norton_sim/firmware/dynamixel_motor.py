"""The inside of a Dynamixel X servo: its control table, its states and its loops.

Goals are obeyed at the end of a control period. Sources: as for :mod:`norton_drivers.dynamixel.table`; e-Manual,
"Position PID Gain" (no more than the proportional gain is emulated), "Shutdown" (an error in its mask switches the
torque off until the servo is rebooted), "Operating Mode" (a change resets gains and profile). What "the DYNAMIXEL will
stop" means where the watchdog acts is not said there: here a current or a PWM ends, and an angle is held. Where the
rig's commands are angles, the plant's amplifier is told of in amperes per radian with the rig's gain.
"""

from functools import partial

from norton_drivers.codecs.dynamixel import ALERT, Error
from norton_drivers.dynamixel import table
from norton_drivers.dynamixel.options import OPERATING_MODES, DynamixelOptions
from norton_drivers.dynamixel.table import MODELS, OperatingMode
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault, Watchdog
from norton_sim.firmware.registers import BusServo, Registers

FIRMWARE = 52
SUPPLY_V, CURRENT_LIMIT, FIRST_GAIN = 12.0, 1193, 800
BITS = {DriveFault.FAULT: 4, DriveFault.UNDERVOLTAGE: 0, DriveFault.OVER_TEMPERATURE: 2}
SHUTDOWN, SHUTDOWN_MASK = 63, 53
# Goals that may be written where the watchdog has not acted: their sizes, and the registers that bound them.
GOALS = {
    table.GOAL_PWM: (2, table.PWM_LIMIT),
    table.GOAL_CURRENT: (2, table.CURRENT_LIMIT),
    table.GOAL_VELOCITY: (4, 0),
    table.GOAL_POSITION: (4, 0),
}


class DynamixelMotor(BusServo):
    """All of one servo but what it hears and says."""

    def __init__(self, context: DeviceContext) -> None:
        self._options = options = parse_options(DynamixelOptions, context.settings)
        self._kept = {
            table.OPERATING_MODE: int(OPERATING_MODES[options.mode]),
            table.RETURN_DELAY: round(options.return_delay_s / table.RETURN_DELAY_STEP_S),
            SHUTDOWN: SHUTDOWN_MASK,
        }
        self._watchdog = Watchdog(context.world, self._expire)
        super().__init__(context, options, Registers(1024))
        self._start()
        context.cyclic(round(options.loop_period_s * 1e9), self._control)

    def _start(self) -> None:
        """As it is after power-up: what is not kept has its first value."""
        model, put = MODELS[self._options.model], self.registers.put
        self.registers.write(0, bytes(1024))
        put(table.MODEL_NUMBER, model.number, 2)
        put(table.FIRMWARE_VERSION, FIRMWARE)
        put(table.ID, self.node)
        put(table.PWM_LIMIT, table.FULL_PWM, 2)
        put(table.CURRENT_LIMIT, CURRENT_LIMIT, 2)
        put(table.MAX_POSITION_LIMIT, table.COUNTS_PER_TURN - 1, 4)
        put(table.STATUS_RETURN_LEVEL, 2)
        for k in range(20):
            put(table.INDIRECT_ADDRESS + 2 * k, model.indirect_data[0] + k, 2)
        for address, value in self._kept.items():
            put(address, value)
        self._begin_mode()
        self._watchdog.configure(enabled=False, timeout_ns=0)
        self._plant.release(self._machine)

    def _begin_mode(self) -> None:
        self.registers.write(table.POSITION_D_GAIN, bytes(12))
        self.registers.put(table.POSITION_P_GAIN, FIRST_GAIN, 2)
        self.registers.write(table.PROFILE_ACCELERATION, bytes(8))
        self.registers.put(table.GOAL_PWM, 0 if self._mode == OperatingMode.PWM else table.FULL_PWM, 2)
        self.registers.put(table.GOAL_CURRENT, 0 if self._mode == OperatingMode.CURRENT else CURRENT_LIMIT, 2)

    @property
    def return_delay_ns(self) -> int:  # type: ignore[override]
        return round(self.registers.get(table.RETURN_DELAY) * table.RETURN_DELAY_STEP_S * 1e9)

    @property
    def _mode(self) -> int:
        return self.registers.get(table.OPERATING_MODE)

    @property
    def armed(self) -> bool:
        return self.registers.get(table.TORQUE_ENABLE) == 1

    @property
    def _expired(self) -> bool:
        return self.registers.get(table.BUS_WATCHDOG) == table.WATCHDOG_EXPIRED

    def break_down(self, fault: DriveFault) -> None:
        bit = 1 << BITS[fault]
        self.registers.put(table.HARDWARE_ERROR, self.registers.get(table.HARDWARE_ERROR) | bit)
        if self.registers.get(SHUTDOWN) & bit:
            self._switch(on=False)

    @property
    def _alert(self) -> int:
        return ALERT if self.registers.get(table.HARDWARE_ERROR) else 0

    # ---- its registers ----

    def _write(self, address: int, data: bytes) -> Error:
        if address < table.EEPROM_END and self.armed:
            return Error.ACCESS
        if (address, data) == (table.TORQUE_ENABLE, b"\1") and self.registers.get(table.HARDWARE_ERROR) & SHUTDOWN_MASK:
            return Error.NONE  # taken, and without effect
        if address in GOALS and (refused := self._refused(address, data)):
            return refused
        self.registers.write(address, data)
        match address:
            case table.TORQUE_ENABLE:
                self._switch(on=self.armed)
            case table.BUS_WATCHDOG:
                period_ns = round(data[0] * table.WATCHDOG_STEP_S * 1e9)
                self._watchdog.configure(enabled=0 < data[0] <= table.WATCHDOG_MAX, timeout_ns=period_ns)
            case table.OPERATING_MODE:
                self._begin_mode()
        if address in self._kept:
            self._kept[address] = data[0]
        return Error.NONE

    def _refused(self, address: int, data: bytes) -> Error:
        size, bound = GOALS[address]
        if len(data) != size:
            return Error.DATA_LENGTH
        if self._expired:
            return Error.DATA_RANGE
        value = int.from_bytes(data, "little", signed=True)
        if bound:
            return Error.NONE if abs(value) <= self.registers.get(bound, 2) else Error.DATA_LIMIT
        outside = address == table.GOAL_POSITION and not 0 <= value < table.COUNTS_PER_TURN
        return Error.DATA_LIMIT if outside and self._mode == OperatingMode.POSITION else Error.NONE

    def _shown(self, address: int, length: int) -> bytes:
        """Registers as they are at this instant, those behind indirect addresses too."""
        self._measure()
        first = MODELS[self._options.model].indirect_data[0]
        data = bytearray(self.registers.read(address, length))
        for k in range(max(first - address, 0), min(first + 20 - address, length)):
            target = self.registers.get(table.INDIRECT_ADDRESS + 2 * (address + k - first), 2)
            if target < first:
                data[k] = self.registers.get(target)
        return bytes(data)

    def _measure(self) -> None:
        position_rad, velocity_rad_s = self._motion()
        put = self.registers.put
        current_a = self._plant.current_a(self._machine)
        put(table.PRESENT_CURRENT, round(current_a / self._options.current_unit_a), 2)
        put(table.PRESENT_VELOCITY, round(velocity_rad_s / table.VELOCITY_STEP_RAD_S), 4)
        put(table.PRESENT_POSITION, round(position_rad / table.POSITION_STEP_RAD) + self._options.zero, 4)
        put(table.PRESENT_VOLTAGE, round(SUPPLY_V / table.VOLTAGE_STEP_V), 2)
        put(table.PRESENT_TEMPERATURE, round(self.heating.temperature_c))

    # ---- what it does by itself ----

    def _switch(self, *, on: bool) -> None:
        self.registers.put(table.TORQUE_ENABLE, on)
        if not on:
            self._plant.release(self._machine)
        elif self._mode not in (OperatingMode.CURRENT, OperatingMode.PWM):
            self._measure()  # it holds the place where it is

    def _expire(self) -> None:
        if not self.armed or self._expired:
            return
        self.registers.put(table.BUS_WATCHDOG, table.WATCHDOG_EXPIRED)
        self.registers.write(table.PROFILE_ACCELERATION, bytes(8))
        self._measure()
        held = self.registers.read(table.PRESENT_POSITION, 4)
        goals = {OperatingMode.CURRENT: (table.GOAL_CURRENT, bytes(2)), OperatingMode.PWM: (table.GOAL_PWM, bytes(2))}
        self.registers.write(*goals.get(OperatingMode(self._mode), (table.GOAL_POSITION, held)))

    def _look(self, stamp_ns: int) -> None:
        super()._look(stamp_ns)
        if self.heating.too_hot:
            self.break_down(DriveFault.OVER_TEMPERATURE)

    def _control(self, _stamp_ns: int) -> None:
        """One period of its loop."""
        if not self.armed:
            return
        options, get = self._options, partial(self.registers.get, signed=True)
        if self._mode == OperatingMode.CURRENT:
            goal_a = get(table.GOAL_CURRENT, 2) * options.current_unit_a
            value = goal_a * ((options.torque_constant_nm_a or 1.0) if options.mode == "torque" else 1.0)
        elif self._mode == OperatingMode.PWM:
            value = get(table.GOAL_PWM, 2) / table.FULL_PWM
        else:
            value = self._effort(get(table.GOAL_POSITION, 4))
        self._plant.command(self._machine, value)

    def _effort(self, goal: int) -> float:
        """As an error of position [rad] with the rig's gain."""
        scale = self.registers.get(table.POSITION_P_GAIN, 2) / table.POSITION_P_SCALE
        place = self._plant.encoder_position_rad(self._machine) / table.POSITION_STEP_RAD + self._options.zero
        bound = table.GOAL_CURRENT if self._mode == OperatingMode.CURRENT_BASED_POSITION else table.GOAL_PWM
        most = self.registers.get(bound, 2)
        effort = min(max(scale * (goal - round(place)), -most), most)
        return effort * table.POSITION_STEP_RAD * table.POSITION_P_SCALE / max(self._options.position_gain, 1)
