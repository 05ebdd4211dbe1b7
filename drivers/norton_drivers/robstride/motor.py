"""RobStride motors and Xiaomi's CyberGear on CAN: torques, currents or goals out, motion in.

Every frame to the motor is answered with feedback: position, velocity, torque, temperature, its mode and its faults.
Torques and goals go out in its operation mode, currents as its parameter iq_ref. Its torque limit and its position can
be read as plain numbers: they are compared with what the model's integers mean, so that most wrong models are found
before anything moves. The timeout of a RobStride is armed here (parameter canTimeout, until it is switched off): then
the motor goes to its reset mode. That of a CyberGear can be set with its maker's tool alone. Sources: the codec's, and
python-cybergear 0.1.2, ``set_watchdog_timeout`` (a CyberGear takes no such parameter).
"""

from math import remainder
from typing import ClassVar

import can

from norton_drivers.codecs import robstride as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.ranges import POSITION_CODES, GoalCodes
from norton_drivers.codecs.robstride import Feedback, Kind, Mode, Parameter
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import Link
from norton_drivers.ports import CanPort
from norton_drivers.readings import DeviceIdentity
from norton_drivers.robstride.options import RobStrideOptions
from norton_drivers.spoken_to.drive import PROBE_ENDED_NS, Addressed, Answer, SpokenToDrive
from norton_drivers.wiring import DeviceSettings

VERSION_S = 0.1  # older firmware does not tell its version
STANDS_RAD = 0.02  # a shaft that is let go of moves less between two answers
SCALE_SEEN = 2e-3
_STOP, _CLEAR = bytes(8), bytes((1,)) + bytes(7)


class RobStride(SpokenToDrive):
    """One motor."""

    _kind: ClassVar = "RobStride motor"
    _extended: ClassVar = True

    def __init__(self, settings: DeviceSettings, options: RobStrideOptions, port: CanPort, link: Link) -> None:
        super().__init__(settings, options, port, link)
        self.options = options
        self._awaited: Parameter | None = None
        self._answered: float | None = None
        self._unknown = False  # whether the answer was that there is no such parameter
        self._awaits_version = False
        self._version = ""
        self._compared = False
        self._know(options.ranges)
        port.subscribe(self._on_frame)

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Stop the motor, which it answers, and see whether it is the model that the rig file says."""
        self._hear(timeout_s, "is it powered, in its own protocol (not MIT or CANopen), and is node what is set in it?")
        self._compare(timeout_s)
        self._awaits_version = True
        question = self._to_motor(Kind.STOP), protocol.VERSION_QUESTION
        self._inquire(question, lambda: not self._awaits_version, VERSION_S)
        self._awaits_version = False
        return DeviceIdentity(
            driver="robstride", address=self._address, hardware=self.options.motor, firmware=self._version
        )

    # ---- Parameters ----------------------------------------------------------------------------------------------

    def _read(self, parameter: Parameter, timeout_s: float) -> float:
        """Raises DeviceTimeoutError where no answer comes, DeviceError where it has no such parameter."""
        self._awaited, self._answered, self._unknown = parameter, None, False
        question = protocol.read_value(self.options.node, self.options.host, parameter)
        self._inquire(question, lambda: self._answered is not None or self._unknown, timeout_s)
        answered: float | None = self._answered
        self._awaited = None
        if answered is None:
            wording = f"{self._place}: answers, but not when {parameter.name.lower()} (0x{parameter:X}) is read"
            if self._unknown:
                raise DeviceError(f"{wording}; update its firmware")
            raise DeviceTimeoutError(f"{wording} ({timeout_s:g} s waited); update its firmware")
        return answered

    def _compare(self, timeout_s: float) -> None:
        """Raises DeviceError where the motor is not the model that the rig file says."""
        limit_nm = self._read(Parameter.LIMIT_TORQUE, timeout_s)
        others = protocol.models_limited_to(limit_nm)
        motor, given = self.options.motor, self.options.torque_range_nm is not None
        if limit_nm > self.options.ranges.torque_nm * (1 + SCALE_SEEN) or (
            others and motor not in others and not given
        ):
            raise DeviceError(
                f"{self._place}: its limit_torque (0x{Parameter.LIMIT_TORQUE:X}) is {limit_nm:g} N*m, "
                f"{'as of ' + ' or '.join(others) if others else 'which none has'}, but the rig file says "
                f'motor = "{motor}" ({self.options.ranges.torque_nm:g} N*m); correct motor, or write torque_range'
            )
        self._compare_position(timeout_s)
        self._compared = True

    def _compare_position(self, timeout_s: float) -> None:
        """The position of an answer with the one that can be read, as far as its range goes: at rest near zero nothing
        shows. Raises DeviceError."""
        ranges, told_rad = self.options.ranges, self._position_rad
        read_rad = self._read(Parameter.MECH_POS, timeout_s)
        # Its answers may have wrapped, and be followed over any number of turns.
        apart_rad = abs(remainder(told_rad - read_rad, POSITION_CODES * ranges.position_step_rad))
        if apart_rad > STANDS_RAD + SCALE_SEEN * abs(read_rad):
            raise DeviceError(
                f"{self._place}: its answers say {told_rad:.4g} rad where mech_pos (0x{Parameter.MECH_POS:X}) is "
                f"{read_rad:.4g} rad; is position_range (now {ranges.position_rad:.5g} rad) its own?"
            )

    # ---- What is sent --------------------------------------------------------------------------------------------

    def _prepare(self, timeout_s: float) -> None:
        """Clear its faults, choose what is commanded, and arm its timeout."""
        if not self._compared:
            self._await_answers(1, timeout_s)
            self._compare(timeout_s)
        self._send(self._to_motor(Kind.STOP), _CLEAR)
        mode = protocol.CURRENT_MODE if self.options.mode == "current" else protocol.OPERATION_MODE
        self._write(Parameter.RUN_MODE, mode)
        if self.options.arms_watchdog and self.options.watchdog_s:
            self._write(Parameter.CAN_TIMEOUT, self.options.watchdog_s * protocol.TIMEOUT_TICKS_PER_S)
        if (told := round(self._read(Parameter.RUN_MODE, timeout_s))) != mode:
            raise DeviceError(f"{self._place}: does not take run_mode {mode}, but stays in {told}; update its firmware")

    def _write(self, parameter: Parameter, value: float) -> None:
        self._send(*protocol.write_value(self.options.node, self.options.host, parameter, value))

    def _to_motor(self, kind: Kind) -> int:
        return protocol.identifier(kind, self.options.host, self.options.node)

    def _plain_frame(self, value: float) -> tuple[Addressed, float]:
        if self.options.mode != "current":
            return super()._plain_frame(value)
        raw = protocol.raw_of(Parameter.IQ_REF, value)
        frame = protocol.write_value(self.options.node, self.options.host, Parameter.IQ_REF, value)
        return frame, protocol.value_of(Parameter.IQ_REF, raw)

    def _pack_torque(self, code: int) -> Addressed:
        return protocol.torque_value(self.options.node, code)

    def _pack_goal(self, codes: GoalCodes) -> Addressed:
        return protocol.goal_value(self.options.node, codes)

    def _send_enable(self) -> None:
        self._send(self._to_motor(Kind.ENABLE), bytes(8))

    def _send_disable(self) -> None:
        self._send(self._to_motor(Kind.STOP), _STOP)

    def _ask_provoked(self, silent_ns: int) -> None:
        """Any frame may feed its timeout: the answer to one of no torque tells what mode it found."""
        if silent_ns >= self.options.watchdog_s * 1e9 + PROBE_ENDED_NS:
            self._send(*self._plain_frame(0.0)[0])

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _on_frame(self, message: can.Message, arrival_ns: int) -> None:
        if not message.is_extended_id or message.is_remote_frame:
            return
        kind, extra, target = protocol.split_id(message.arbitration_id)
        node = extra & 0xFF
        if node != self.options.node:
            if kind == Kind.FEEDBACK and node:
                self._note_stranger(f"node {node}")
            return
        try:
            match kind:
                case Kind.FEEDBACK | Kind.REPORT:
                    self._on_feedback(extra, message.data, arrival_ns)
                case Kind.READ if target == self.options.host:
                    self._on_parameter(extra, message.data)
                case Kind.FAULTS:
                    for words in protocol.describe_faults(message.data):
                        self._note_fault(words)
                    self._status = None
        except CodecError:
            self.malformed += 1

    def _on_feedback(self, extra: int, data: bytearray, arrival_ns: int) -> None:
        if self._awaits_version and (version := protocol.version_of(data)) is not None:
            self._version, self._awaits_version = version, False
            return
        told = Feedback.decode(extra, data)
        error = protocol.describe_feedback(told.faults)
        self._on_answer(Answer(*told.codes, told.mode == Mode.RUN, error, told.tenths_c / 10), arrival_ns)

    def _on_parameter(self, extra: int, data: bytearray) -> None:
        index, raw = protocol.parameter_of(data)
        if index == self._awaited:
            self._unknown = extra >> 8 != 0
            self._answered = None if self._unknown else protocol.value_of(index, raw)
