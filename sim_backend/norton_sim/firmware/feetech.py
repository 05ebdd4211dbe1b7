"""A Feetech servo on a half-duplex line: its memory table, its modes and its answers.

Goals are obeyed at the end of a control period. There is no watchdog. Sources: as for
:mod:`norton_drivers.feetech.table` and :mod:`norton_drivers.codecs.feetech`. Values written to the EPROM while it is
locked act until power-off. In mode 0 the goal moves no faster than Goal Speed, and the position loop is proportional;
where the rig's commands are angles, the plant's amplifier is told of in amperes per radian with the rig's gain. Load
beyond the overload torque for the protection time leaves the protective torque until the torque is switched off.
"""

from functools import partial

from norton_drivers.codecs import feetech as protocol
from norton_drivers.codecs.feetech import Instruction, Packet, signed, with_sign
from norton_drivers.feetech import table
from norton_drivers.feetech.options import FeetechOptions
from norton_drivers.wiring import parse_options
from norton_sim.firmware.context import DeviceContext, DriveFault
from norton_sim.firmware.registers import BusServo, Registers

FIRMWARE = (3, 10)
SUPPLY_V = 7.4
STATUS_LEVEL, MAX_ANGLE, LOAD_SIGN = 8, 11, 10
PROTECTIVE_TORQUE, PROTECTION_TIME, OVERLOAD_TORQUE = 34, 35, 36  # percent, 10 ms, percent
FIRST = {STATUS_LEVEL: 1, table.P_GAIN: 32, table.D_GAIN: 32, table.DEAD_ZONE: 1, table.DEAD_ZONE + 1: 1}
PROTECTION = {PROTECTIVE_TORQUE: 20, PROTECTION_TIME: 200, OVERLOAD_TORQUE: 80}
BITS = {DriveFault.FAULT: 1, DriveFault.UNDERVOLTAGE: 0, DriveFault.OVER_TEMPERATURE: 2}
OVERLOAD_BIT = 5
FASTEST = 0x7FFF  # counts a second that a speed can tell


class FeetechServo(BusServo):
    """One servo: the rig's actuator or its load."""

    def __init__(self, context: DeviceContext) -> None:
        self._options = options = parse_options(FeetechOptions, context.settings)
        self._model = options.kind
        self._stream = protocol.PacketStream()
        self._place = 0.0  # counts: where its goal has got to
        self._loaded_s = 0.0  # how long beyond the overload torque
        self._period_s = options.loop_period_s
        super().__init__(context, options, Registers(128, self._model.order))
        put = self.registers.put
        for address, value in {**FIRST, **(PROTECTION if self._model.together else {})}.items():
            put(address, value)
        put(table.IDENTITY, FIRMWARE[0])
        put(table.IDENTITY + 1, FIRMWARE[1])
        put(table.IDENTITY + 3, self._model.number, 2)
        put(table.ID, options.node)
        put(table.RETURN_DELAY, round(options.return_delay_s / table.RETURN_DELAY_STEP_S))
        put(table.PHASE, table.SLOW_UNIT_BIT)
        put(MAX_ANGLE, self._model.counts - 1, 2)
        put(table.MIN_START_FORCE, 16, 2)
        if self._model.together:
            put(table.TORQUE_LIMIT, table.FULL_PWM, 2)
        self._plant.release(self._machine)
        context.cyclic(round(options.loop_period_s * 1e9), self._control)

    @property
    def return_delay_ns(self) -> int:  # type: ignore[override]
        return round(self.registers.get(table.RETURN_DELAY) * table.RETURN_DELAY_STEP_S * 1e9)

    @property
    def armed(self) -> bool:
        return self.registers.get(table.TORQUE_ENABLE) == 1

    def break_down(self, fault: DriveFault) -> None:
        self._raise(BITS[fault])
        self._switch(on=False)

    def _raise(self, bit: int) -> None:
        self.registers.put(table.STATUS, self.registers.get(table.STATUS) | 1 << bit)

    # ---- what it hears and says ----

    def _receive(self, data: bytes) -> None:
        for packet in self._stream.feed(data):
            # Another servo's answer looks like a question, but to nobody here.
            if packet.node in (protocol.BROADCAST, self.node):
                self._obey(packet)
            else:
                self._answered(packet.node)

    def _obey(self, packet: Packet) -> None:
        self._asked_anew()
        body, own = packet.parameters, packet.node == self.node
        match packet.code:
            case Instruction.PING if own:
                self._answer_later(partial(self._status, b""))
            case Instruction.READ if own and len(body) == 2:
                self._answer_later(partial(self._reading, *body))
            case Instruction.WRITE if own and len(body) > 1:
                self._write(body[0], body[1:])
                if self.registers.get(STATUS_LEVEL):
                    self._answer_later(partial(self._status, b""))
            case Instruction.SYNC_READ if self._model.together and self.node in body[2:]:
                before = body[2 : 2 + body[2:].index(self.node)]
                self._answer_behind(before, partial(self._reading, *body[:2]))
            case Instruction.SYNC_WRITE if len(body) > 2:
                size = body[1]
                for at in range(2, len(body) - size, 1 + size):
                    if body[at] == self.node:
                        self._write(body[0], body[at + 1 : at + 1 + size])

    def _write(self, address: int, data: bytes) -> None:
        if table.PRESENT_POSITION <= address <= table.PRESENT_CURRENT + 1:
            return
        self.registers.write(address, data)
        if address == table.TORQUE_ENABLE:
            self._switch(on=self.armed)

    def _status(self, data: bytes) -> bytes:
        return Packet(self.node, self.registers.get(table.STATUS), data).encode()

    def _reading(self, address: int, length: int) -> bytes:
        self._measure()
        return self._status(self.registers.read(address, length))

    def _measure(self) -> None:
        position_rad, velocity_rad_s = self._motion()
        put, step_rad = self.registers.put, self._model.step_rad
        count, counts = round(position_rad / step_rad) + self._options.zero, self._model.counts
        put(table.PRESENT_POSITION, count % counts if self._model.turns else min(max(count, 0), counts - 1), 2)
        speed = min(max(round(velocity_rad_s / step_rad), -FASTEST), FASTEST)
        put(table.PRESENT_SPEED, with_sign(speed, table.POSITION_SIGN), 2)
        put(table.PRESENT_VOLTAGE, round(SUPPLY_V / table.VOLTAGE_STEP_V))
        put(table.PRESENT_TEMPERATURE, round(self.heating.temperature_c))
        if self._model.currents:
            current = round(self._plant.current_a(self._machine) / table.CURRENT_STEP_A)
            put(table.PRESENT_CURRENT, with_sign(current, table.CURRENT_SIGN), 2)

    # ---- what it does by itself ----

    def _switch(self, *, on: bool) -> None:
        self.registers.put(table.TORQUE_ENABLE, on)
        self._loaded_s = 0.0
        self._place = self._counts()
        if not on:
            self._plant.release(self._machine)
            self.registers.put(table.STATUS, self.registers.get(table.STATUS) & ~(1 << OVERLOAD_BIT))

    def _counts(self) -> float:
        return self._plant.encoder_position_rad(self._machine) / self._model.step_rad + self._options.zero

    def _look(self, stamp_ns: int) -> None:
        super()._look(stamp_ns)
        if self.heating.too_hot:
            self.break_down(DriveFault.OVER_TEMPERATURE)

    @property
    def _holds(self) -> bool:
        """Whether it is a servo, and no motor."""
        if self._model.together:
            return self.registers.get(table.MODE) == table.MODE_POSITION
        return self.registers.get(table.MIN_ANGLE, 2) != self.registers.get(MAX_ANGLE, 2)

    def _control(self, _stamp_ns: int) -> None:
        """One period of its loop."""
        if not self.armed:
            return
        duty = self._position_duty() if self._holds else self._goal_duty()
        duty = min(max(duty, -1.0), 1.0)
        if self._model.together:
            duty = self._protected(duty)
        self.registers.put(table.PRESENT_LOAD, with_sign(round(duty * table.FULL_PWM), LOAD_SIGN), 2)
        self._plant.command(self._machine, duty * self._value_per_duty)

    @property
    def _value_per_duty(self) -> float:
        """What full PWM is in the unit of the rig's command."""
        options = self._options
        if options.mode == "pwm":
            return 1.0
        if options.mode == "torque":
            return options.stall_torque_nm or 1.0
        return 1.0 / (options.position_gain * table.DUTY_PER_RAD)

    def _goal_duty(self) -> float:
        return signed(self.registers.get(table.GOAL_PWM, 2), table.PWM_SIGN) / table.FULL_PWM

    def _position_duty(self) -> float:
        get = self.registers.get
        goal, most = get(table.GOAL_POSITION, 2), get(table.GOAL_SPEED, 2) * self._period_s
        self._place += min(max(goal - self._place, -most), most)
        error = round(self._place) - round(self._counts())
        if abs(error) <= get(table.DEAD_ZONE):
            return 0.0
        least = get(table.MIN_START_FORCE, 2) / table.FULL_PWM
        duty = error * self._model.step_rad * get(table.P_GAIN) * table.DUTY_PER_RAD
        return duty if abs(duty) > least else (least if duty > 0 else -least)

    def _protected(self, duty: float) -> float:
        get = self.registers.get
        beyond = abs(duty) * 100 > get(OVERLOAD_TORQUE)
        self._loaded_s = self._loaded_s + self._period_s if beyond else max(self._loaded_s - self._period_s, 0.0)
        if self._loaded_s > 0.01 * get(PROTECTION_TIME):
            self._raise(OVERLOAD_BIT)
        if not get(table.STATUS) >> OVERLOAD_BIT & 1:
            return duty
        most = get(PROTECTIVE_TORQUE) / 100
        return min(max(duty, -most), most)
