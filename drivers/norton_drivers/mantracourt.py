"""Mantracourt DSC strain gauge converters (and DCell, DSCUSB) on a serial line, asked for their output again and again.

Torque is that which the actuator exerts on the load, times ``direction``. The converter measured somewhere between
question and answer, or, where it measures more slowly than it is asked, before: readings bear the instant of the
question as their own clock.
"""

from math import inf

from pydantic import Field, field_validator

from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.lines import LINE_MAX, LineStream, NumberFormat, Numbers
from norton_drivers.codecs.mantracourt import BAUD, BROADCAST, NOT_UNDERSTOOD, STATION_MAX, question
from norton_drivers.errors import DeviceError, DeviceTimeoutError
from norton_drivers.link import ANSWERS_THAT_TELL, Link, Questions, wait_until
from norton_drivers.ports import SerialPort
from norton_drivers.readings import DeviceIdentity
from norton_drivers.serial_sensor import SerialSensor
from norton_drivers.wiring import AVERAGING_MAX_S, DeviceSettings, TorqueSensorOptions, parse_options

CONNECTION = "serial"
OPTION_UNITS = {"range": "N*m", "timeout": "s", "averaging": "s"}


class MantracourtOptions(TorqueSensorOptions):
    """What a rig file may say of a Mantracourt converter."""

    # It tells its last measurement: on average that is what an average over one period would tell.
    averaging_s: float = Field(
        alias="averaging",
        ge=0,
        le=AVERAGING_MAX_S,
        description="how old its last measurement may be when it is asked: one period of its RATE",
        examples=["2 ms"],
    )
    scale: float = Field(gt=0, description="N*m per unit of its output", examples=[0.001])
    station: int = Field(1, le=STATION_MAX, description="its station number, 1 to 999", examples=[1])
    command: str = Field("SOUT", description="what it is asked for", examples=["SYS"])
    width: int = Field(
        0,
        ge=0,
        le=LINE_MAX,
        description="characters of an answer, DP + DPB + 2 (a lost one is then noticed); 0 where unknown",
    )
    range_nm: float = Field(inf, alias="range", gt=0, description="the torque it can measure", examples=["2 N*m"])
    baud: int = Field(BAUD, gt=0, description="the baud rate set in the converter", examples=[BAUD])
    timeout_s: float = Field(0.03, alias="timeout", gt=0, le=10, description="how long to wait for an answer")

    @field_validator("station")
    @classmethod
    def _answers(cls, station: int) -> int:
        if station == BROADCAST:
            raise ValueError("station 000 is all stations at once, and none of them answers; write the sensor's own")
        if station < 0:
            raise ValueError("a station number is not negative")
        return station

    @field_validator("command")
    @classmethod
    def _can_be_asked(cls, command: str) -> str:
        try:
            question(STATION_MAX, command)
        except CodecError as error:
            raise ValueError("a command is one to four capital letters or digits") from error
        return command


def open_torque_sensor(settings: DeviceSettings, link: Link) -> "MantracourtSensor":
    """Raises WiringError for a wrong option, ConnectionFailedError for the port."""
    options = parse_options(MantracourtOptions, settings)
    return MantracourtSensor(settings, options, link.serial_port(settings, options.baud), link)


class MantracourtSensor(SerialSensor):
    """``numbers`` counts answers that are none, ``refusals`` those that say the question is not understood,
    ``questions`` the ones that got no answer."""

    def __init__(self, settings: DeviceSettings, options: MantracourtOptions, port: SerialPort, link: Link) -> None:
        super().__init__(settings, options, port, link, options.scale)
        self.stream = LineStream(mid_line=False)
        self.numbers = Numbers(NumberFormat(width=options.width, signed=True))
        self.refusals = 0
        self._options = options
        self._question = question(options.station, options.command)
        self.questions = Questions(link, self._ask, options.timeout_s)
        port.subscribe(self._on_bytes)

    @property
    def malformed(self) -> int:
        """Answers that are no number, or no line."""
        return self.numbers.garbled + self.stream.overlong

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Wait for answers that are numbers."""
        refusals, enough = self.refusals, self.questions.answers + ANSWERS_THAT_TELL
        if not wait_until(lambda: self.questions.answers >= enough, self._link, timeout_s):
            raise DeviceTimeoutError(
                f"{self._place}: no answer in {timeout_s:g} s ({self.questions.unanswered} questions, "
                f"{self.malformed} answers that are no number); check power, port, baud {self._options.baud}, station "
                "and width"
            )
        if self.refusals > refusals:
            raise DeviceError(f"{self._place}: does not know the command {self._options.command}; correct command")
        return DeviceIdentity(driver="mantracourt", address=f"{self._port.name} station {self._options.station:03d}")

    @property
    def _place(self) -> str:
        return f"[{self.role}] Mantracourt station {self._options.station:03d} on {self._port.name}"

    def _ask(self) -> None:
        self.stream.drop()  # what came too late is no answer to what is asked now
        self._port.send(self._question)

    def _on_bytes(self, data: bytes, arrival_ns: int) -> None:
        for line in self.stream.feed(data):
            if line.text + b"\r" != self._question:  # a two-wire line hears itself
                self._on_answer(line.text, self._stamps.complete_ns(arrival_ns, line.later_bytes))

    def _on_answer(self, text: bytes, complete_ns: int) -> None:
        if text == NOT_UNDERSTOOD:
            self.refusals += 1
            self.questions.answered(complete_ns)
            return
        number = self.numbers.take(text)
        if number is None:
            return  # the answer may still be on its way behind it
        asked_ns = self.questions.answered(complete_ns)
        if asked_ns is not None and self.numbers.believed:
            self._put(number, complete_ns, asked_ns)
