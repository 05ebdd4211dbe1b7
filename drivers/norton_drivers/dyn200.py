"""DYN-200 torque sensors and their like on a serial line: asked by Modbus RTU, or pushing 1000 frames a second.

Torque is that which the actuator exerts on the load, times ``direction``. A sensor that is asked measured somewhere
between question and answer: its readings bear the instant of the question as their own clock, so that whoever aligns
signals finds the constant delay between the two, whatever rhythm the questions have.
"""

from math import inf, isclose
from typing import Literal

from pydantic import Field

from norton_drivers.codecs.dyn200 import (
    BAUD,
    DECIMALS_REGISTER,
    FRAME_LENGTH,
    NUMBER_REGISTERS,
    STATION_MAX,
    TORQUE_REGISTER,
    PushStream,
    number_of,
)
from norton_drivers.codecs.modbus import AnswerStream, ReadRequest, Refusal, describe_exception, silence_s
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import ANSWERS_THAT_TELL, Link, Questions, wait_until
from norton_drivers.ports import SerialPort
from norton_drivers.readings import DeviceIdentity
from norton_drivers.serial_sensor import SerialSensor
from norton_drivers.wiring import DeviceSettings, TorqueSensorOptions, parse_options

CONNECTION = "serial"
OPTION_UNITS = {"torque_per_digit": "N*m", "range": "N*m", "timeout": "s", "silence": "s", "averaging": "s"}

MOST_DECIMALS = 4
DECIMALS_WITHIN_S = 0.2


class Dyn200Options(TorqueSensorOptions):
    """What a rig file may say of a DYN-200."""

    mode: Literal["polled", "push"] = Field(
        description='"polled" asks by Modbus RTU, "push" listens to active upload, mode 0', examples=["push"]
    )
    torque_per_digit_nm: float = Field(
        alias="torque_per_digit", gt=0, description="what one digit of its torque is worth", examples=["1 mN*m"]
    )
    range_nm: float = Field(inf, alias="range", gt=0, description="the torque it can measure", examples=["2 N*m"])
    baud: int = Field(BAUD, gt=0, description="the baud rate set in the sensor", examples=[BAUD])
    station: int = Field(1, ge=1, le=STATION_MAX, description="its Modbus address, 1 to 120; for polled alone")
    timeout_s: float = Field(
        0.03, alias="timeout", gt=0, le=10, description="how long to wait for an answer; for polled alone"
    )
    silence_s: float | None = Field(
        None,
        alias="silence",
        ge=0,
        le=1,
        description="silence between an answer and the next question; for polled alone, and as Modbus asks if left out",
    )
    decimals: int | None = Field(
        None,
        ge=0,
        le=MOST_DECIMALS,
        description="the decimals that its display shows, where its unit is not N*m; for polled alone",
    )

    @property
    def expected_decimals(self) -> int | None:
        """The decimals that go with ``torque_per_digit`` in newton metres, or those written; None where unknown."""
        if self.decimals is not None:
            return self.decimals
        fitting = (n for n in range(MOST_DECIMALS + 1) if isclose(self.torque_per_digit_nm, 10.0**-n, rel_tol=1e-6))
        return next(fitting, None)


def open_torque_sensor(settings: DeviceSettings, link: Link) -> "PolledDyn200 | PushingDyn200":
    """Raises WiringError for a wrong option, ConnectionFailedError for the port."""
    options = parse_options(Dyn200Options, settings)
    sensor = PolledDyn200 if options.mode == "polled" else PushingDyn200
    return sensor(settings, options, link.serial_port(settings, options.baud), link)


class PushingDyn200(SerialSensor):
    """The sensor streams by itself. ``stream`` counts what was no frame."""

    def __init__(self, settings: DeviceSettings, options: Dyn200Options, port: SerialPort, link: Link) -> None:
        super().__init__(settings, options, port, link, options.torque_per_digit_nm)
        self.stream = PushStream()
        self._options = options
        port.subscribe(self._on_bytes)

    @property
    def malformed(self) -> int:
        """Frames whose CRC was wrong."""
        return self.stream.crc_errors

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Wait for a frame: nothing can be asked of a sensor that pushes."""
        if not self._comes(timeout_s):
            raise DeviceTimeoutError(
                f"[{self.role}] DYN-200 on {self._port.name}: no frame in {timeout_s:g} s "
                f"({self.stream.discarded_bytes} bytes that are none); check power, port, baud {self._options.baud}, "
                'and that it is set to active upload, mode 0, or set mode = "polled"'
            )
        return DeviceIdentity(driver="dyn200", address=self._port.name)

    def _on_bytes(self, data: bytes, arrival_ns: int) -> None:
        frames = self.stream.feed(data)
        for frame, complete_ns in self._stamps.each(frames, FRAME_LENGTH, arrival_ns, self.stream.pending_bytes):
            self._put(frame.torque_digits, complete_ns)


class PolledDyn200(SerialSensor):
    """The sensor is asked for its torque, again and again.

    ``stream`` counts bytes that are no answer, ``questions`` those that got none, ``refusals`` Modbus exceptions.
    """

    def __init__(self, settings: DeviceSettings, options: Dyn200Options, port: SerialPort, link: Link) -> None:
        super().__init__(settings, options, port, link, options.torque_per_digit_nm)
        self.stream = AnswerStream()
        self.refusals = 0
        self._options = options
        self._torque = ReadRequest(options.station, TORQUE_REGISTER, NUMBER_REGISTERS)
        self._next = self._asked = self._torque
        self._last_refusal: Refusal | None = None
        self._other_answer: int | None = None  # to a question for something else than torque
        silence = silence_s(options.baud) if options.silence_s is None else options.silence_s
        self.questions = Questions(link, self._ask, options.timeout_s, silence)
        port.subscribe(self._on_bytes)

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Wait for answers, and see that the sensor's decimals are those that the rig file goes by."""
        refusals, enough = self.refusals, self.questions.answers + ANSWERS_THAT_TELL
        if not wait_until(lambda: self.questions.answers >= enough, self._link, timeout_s):
            raise DeviceTimeoutError(
                f"{self._place}: no answer in {timeout_s:g} s ({self.questions.unanswered} questions, "
                f"{self.stream.discarded_bytes} bytes that are no answer); check power, port, baud "
                f'{self._options.baud}, station, and that it is set to Modbus RTU, or set mode = "push"'
            )
        if self.refusals > refusals and self._last_refusal is not None:
            raise DeviceError(
                f"{self._place}: refuses to tell its torque ({describe_exception(self._last_refusal.code)}); is it a "
                "DYN-200?"
            )
        return DeviceIdentity("dyn200", f"{self._port.name} station {self._options.station}", self._check_decimals())

    @property
    def _place(self) -> str:
        return f"[{self.role}] DYN-200 station {self._options.station} on {self._port.name}"

    def _check_decimals(self) -> str:
        """What the sensor says of its decimals, in words. Raises DeviceError where the rig goes by others."""
        decimals = self._read_decimals()
        if decimals is None:
            return ""
        expected = self._options.expected_decimals
        if expected is not None and decimals != expected:
            raise DeviceError(
                f"{self._place}: shows torque with {decimals} decimals, but torque_per_digit = "
                f"{self._options.torque_per_digit_nm:g} N*m goes with {expected}; correct torque_per_digit, or, where "
                f"the sensor's unit is not N*m, write decimals = {decimals}"
            )
        return f"{decimals} decimals"

    def _read_decimals(self) -> int | None:
        """None for a sensor of the family that has no such register."""
        self._other_answer, refusals = None, self.refusals
        # A number more than is wanted: no answer to another question can then be taken for this one's.
        self._next = ReadRequest(self._options.station, DECIMALS_REGISTER, 2 * NUMBER_REGISTERS)
        try:
            wait_until(
                lambda: self._other_answer is not None or self.refusals > refusals, self._link, DECIMALS_WITHIN_S
            )
        finally:
            self._next = self._torque
        return self._other_answer

    def _ask(self) -> None:
        self._asked = self._next
        self.stream.expect(self._asked)
        self._port.send(self._asked.encode())

    def _on_bytes(self, data: bytes, arrival_ns: int) -> None:
        answer = self.stream.feed(data)
        if answer is None:
            return
        asked = self._asked
        complete_ns = self._stamps.complete_ns(arrival_ns, self.stream.pending_bytes)
        asked_ns = self.questions.answered(complete_ns)
        if isinstance(answer, Refusal):
            self.refusals += 1
            self._last_refusal = answer
        elif asked is self._torque:
            self._put(number_of(answer.data), complete_ns, asked_ns)
        else:
            self._other_answer = number_of(answer.data[: 2 * NUMBER_REGISTERS])
