"""Damiao DM motors on CAN, in their MIT mode: torques or goals out, motion in.

Unlike others in MIT mode, this motor tells whether it is enabled and what is wrong with it, and its registers can be
read: its ranges are compared with the rig file's, so that no torque is scaled wrongly in silence. Its timeout is armed
here (register TIMEOUT, until it is switched off): then it lets go of the motor, says so, and stays so until the fault
is cleared. Every frame to its identifier feeds the timeout; those to 0x7FF do not. Sources: the codec's; and
umeow0716/damiao_firmware, app/src/interrupts.c (answered after it was obeyed, with what was measured before),
app_commands.c (enabled only without a fault; a command is kept for it), safety.c (timeout), position_sensor.c and
motor_control.c (its readings of velocity and torque are filtered).
"""

from math import isclose
from typing import ClassVar

import can

from norton_drivers.codecs import damiao as protocol
from norton_drivers.codecs import mit
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.damiao import Feedback, Operation, Register, RegisterFrame, Special
from norton_drivers.codecs.ranges import GoalCodes, Ranges
from norton_drivers.damiao.options import UNFILTERED_HZ, DamiaoOptions
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.ports import CanPort
from norton_drivers.readings import DeviceIdentity
from norton_drivers.spoken_to.drive import Addressed, Answer, SpokenToDrive
from norton_drivers.wiring import DeviceSettings

_AGREES = 1e-5  # of two numbers, one of them a float32


class Damiao(SpokenToDrive):
    """One motor."""

    _kind: ClassVar = "Damiao motor"

    def __init__(self, settings: DeviceSettings, options: DamiaoOptions, port: CanPort, link: Link) -> None:
        super().__init__(settings, options, port, link)
        self.options = options
        self._awaited: tuple[Operation, Register] | None = None
        self._answered: RegisterFrame | None = None
        self._known = False  # whether its registers have been compared with the rig file
        if options.ranges is not None:
            self._know(options.ranges)
        port.subscribe(self._on_frame)

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Disable the motor, which it answers, and compare its registers with the rig file."""
        self._hear(
            timeout_s,
            f"is it powered, and are node (ESC_ID) and master (MST_ID, 0x{self.options.master:X}) what is set in it?",
        )
        self._compare(timeout_s)
        version = protocol.version_of(self._read(Register.SW_VER, timeout_s).raw)
        return DeviceIdentity(driver="damiao", address=self._address, firmware=version)

    # ---- Registers -----------------------------------------------------------------------------------------------

    def _read(self, register: Register, timeout_s: float) -> RegisterFrame:
        return self._ask(Operation.READ, register, bytes(4), timeout_s)

    def _ask(self, operation: Operation, register: Register, raw: bytes, timeout_s: float) -> RegisterFrame:
        """Raises DeviceTimeoutError where no answer comes."""
        self._awaited, self._answered = (operation, register), None
        question = protocol.REGISTERS_ID, RegisterFrame(self.options.node, operation, register, raw).encode()
        arrived = self._inquire(question, lambda: self._answered is not None, timeout_s)
        answered: RegisterFrame | None = self._answered
        self._awaited = None
        if not arrived or answered is None:
            raise DeviceTimeoutError(
                f"{self._place}: answers, but not when register {register.name} ({register:d}) is "
                f"{'read' if operation is Operation.READ else 'written'} ({timeout_s:g} s waited); update its "
                'firmware; a motor in plain MIT mode has driver = "mit"'
            )
        return answered

    def _compare(self, timeout_s: float) -> None:
        """Raises DeviceError where the motor is not set as the rig file says, with what to write."""
        if (mode := round(self._read(Register.CTRL_MODE, timeout_s).value)) != protocol.MIT_MODE:
            raise DeviceError(
                f"{self._place}: is in {protocol.MODES.get(mode, 'an unknown')} mode (CTRL_MODE, register 10, is "
                f"{mode}); set it to MIT, 1, with the maker's tool"
            )
        options = self.options
        position = self._agreed(Register.PMAX, "position_range", options.position_range_rad, "rad", timeout_s)
        velocity = self._agreed(Register.VMAX, "velocity_range", options.velocity_range_rad_s, "rad/s", timeout_s)
        torque = self._agreed(Register.TMAX, "torque_range", options.torque_range_nm, "N*m", timeout_s)
        bandwidth_hz = self._read(Register.V_BW, timeout_s).value
        if min(bandwidth_hz, UNFILTERED_HZ) != min(options.velocity_bandwidth_hz, UNFILTERED_HZ):
            self._refuse(Register.V_BW, bandwidth_hz, "velocity_bandwidth", options.velocity_bandwidth_hz, "Hz")
        self._know(Ranges(position, velocity, torque))
        self._known = True

    def _agreed(self, register: Register, option: str, given: float | None, unit: str, timeout_s: float) -> float:
        told = self._read(register, timeout_s).value
        if given is None:
            return told
        if not isclose(told, given, rel_tol=_AGREES):
            self._refuse(register, told, option, given, unit)
        return given

    def _refuse(self, register: Register, told: float, option: str, given: float, unit: str) -> None:
        raise DeviceError(
            f"{self._place}: its {register.name} (register {register:d}) is {told:g} {unit}, but the rig file says "
            f'{option} = "{given:g} {unit}"; write {option} = "{told:g} {unit}", or set {given:g} in the motor'
        )

    # ---- What is sent --------------------------------------------------------------------------------------------

    def _prepare(self, timeout_s: float) -> None:
        """Clear its fault, and arm its timeout."""
        if not self._known:
            self._compare(timeout_s)
        self._send(self.options.node, Special.CLEAR.encode())
        if self.options.watchdog_s:
            ticks = protocol.raw_of(Register.TIMEOUT, self.options.watchdog_s * protocol.TIMEOUT_TICKS_PER_S)
            answered = self._ask(Operation.WRITE, Register.TIMEOUT, ticks, timeout_s)
            if answered.raw != ticks:
                raise DeviceError(f"{self._place}: does not take a timeout of {self.options.watchdog_s:g} s")

    def _pack_torque(self, code: int) -> Addressed:
        return self.options.node, mit.command_value(code)

    def _pack_goal(self, codes: GoalCodes) -> Addressed:
        return self.options.node, mit.goal_value(codes)

    def _send_enable(self) -> None:
        self._send(self.options.node, Special.ENABLE.encode())

    def _send_disable(self) -> None:
        self._send(self.options.node, Special.DISABLE.encode())

    def _ask_resting(self) -> None:
        if self._told is not None and not self._told.enabled:
            self._refresh()
        else:
            self._send_disable()

    def _ask_provoked(self, silent_ns: int) -> None:
        self._refresh()

    def _refresh(self) -> None:
        """Ask for its feedback, which does not feed its timeout."""
        self._send(protocol.REGISTERS_ID, RegisterFrame(self.options.node, Operation.REFRESH, 0).encode())

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _on_frame(self, message: can.Message, arrival_ns: int) -> None:
        if message.is_extended_id or message.is_remote_frame or not message.data:
            return
        data, node = message.data, message.data[0] & 0xF
        if message.arbitration_id != self.options.master or node != self.options.node:
            self._note_stranger(f"node {node} with id 0x{message.arbitration_id:X}")
            return
        try:
            if not self._is_awaited(data):
                told = Feedback.decode(data)
                error = protocol.describe_status(told.status)
                enabled = told.status == protocol.ENABLED
                temperatures = float(told.rotor_c), float(told.transistor_c)
                self._on_answer(Answer(*told.codes, enabled, error, *temperatures), arrival_ns)
        except CodecError:
            self.malformed += 1

    def _is_awaited(self, data: bytearray) -> bool:
        """Take an answer of the register that was asked for: nothing else tells it from feedback."""
        if self._awaited is None or len(data) != 8 or (data[2], data[3]) != self._awaited:
            return False
        frame = RegisterFrame.decode(data)
        if frame.node != self.options.node:
            return False
        self._answered = frame
        return True
