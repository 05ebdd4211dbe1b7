"""How the firmwares of an ODrive call what is read and written through the ASCII protocol.

Sources: the API references of firmware 0.5.6 and 0.6 (``axis0``: ``error``, ``motor.error``, ``encoder.error``,
``controller.error``, ``motor.current_control.Iq_measured``; ``active_errors``, ``disarm_reason``,
``motor.foc.Iq_measured``).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from math import isfinite, nan
from typing import Final

from norton_drivers.codecs import odrive_05
from norton_drivers.codecs import odrive_ascii as ascii_protocol
from norton_drivers.codecs.odrive import AxisState
from norton_drivers.codecs.odrive_05 import ERROR_WATCHDOG, describe_errors_05
from norton_drivers.codecs.odrive_06 import describe_axis_state, describe_errors
from norton_drivers.finding import Found, answers_to
from norton_drivers.link import Link
from norton_drivers.ports import SerialPort

STATE, REQUESTED_STATE = "current_state", "requested_state"
CONTROL_MODE, INPUT_MODE = "controller.config.control_mode", "controller.config.input_mode"
WATCHDOG_TIMEOUT, ENABLE_WATCHDOG = "config.watchdog_timeout", "config.enable_watchdog"
TEMPERATURE = "motor.fet_thermistor.temperature"
SUPPLY = "vbus_voltage"  # of the board
VERSION = ("fw_version_major", "fw_version_minor", "fw_version_revision")
HARDWARE = ("hw_version_major", "hw_version_minor", "hw_version_variant")


Words = Callable[[int], tuple[str, ...]]


@dataclass(frozen=True)
class Names:
    """Of an axis' properties that differ: ``errors`` and ``reasons`` by their path, each with what puts its bits into
    words. Reasons say why the loop was left last, whatever became of that since.

    ``harmless`` are the bits of the first error that an idle axis may have without anything being wrong.
    """

    errors: Mapping[str, Words]
    current: str
    reasons: Mapping[str, Words] = field(default_factory=dict)
    harmless: int = 0


def _part(words: Mapping[int, str], name: str) -> Words:
    return partial(describe_errors_05, words=words, part=name)


FIRMWARES: Final[Mapping[str, Names]] = {
    "0.5": Names(
        {
            "error": _part(odrive_05.AXIS_WORDS, "axis"),
            "motor.error": _part(odrive_05.MOTOR_WORDS, "motor"),
            "encoder.error": _part(odrive_05.ENCODER_WORDS, "encoder"),
            "controller.error": _part(odrive_05.CONTROLLER_WORDS, "controller"),
        },
        "motor.current_control.Iq_measured",
        harmless=ERROR_WATCHDOG,  # it minds an idle axis too
    ),
    "0.6": Names({"active_errors": describe_errors}, "motor.foc.Iq_measured", {"disarm_reason": describe_errors}),
}


class AxisValues:
    """What an axis told of its properties last, by their whole path."""

    def __init__(self, firmware: str, axis: int) -> None:
        names = FIRMWARES[firmware]
        self._prefix = f"axis{axis}."
        self._names = names
        self._numbers: dict[str, float] = {}
        self.state, self.current, self.temperature = map(self.path, (STATE, names.current, TEMPERATURE))
        self.errors = tuple(map(self.path, (*names.errors, *names.reasons)))

    def path(self, name: str) -> str:
        return self._prefix + name

    def note(self, path: str, number: float) -> None:
        self._numbers[path] = number

    def get(self, path: str) -> float:
        """NaN where it was not told yet."""
        return self._numbers.get(path, nan)

    def forget_errors(self) -> None:
        """They were cleared."""
        for path in self.errors:
            self._numbers.pop(path, None)

    @property
    def in_closed_loop(self) -> bool:
        return self.get(self.state) == AxisState.CLOSED_LOOP_CONTROL

    @property
    def failed(self) -> bool:
        """Whether an idle axis has an error."""
        return bool(self._words(self._names.errors, self._names.harmless))

    def words(self, *, wanted: bool) -> tuple[str, ...]:
        """What is wrong; ``wanted``: its loop should be closed."""
        if self.in_closed_loop:
            return ()
        if not wanted:
            return self._words(self._names.errors, self._names.harmless)
        result = self._words({**self._names.errors, **self._names.reasons}, 0)
        state = self.get(self.state)
        now = describe_axis_state(int(state)) if isfinite(state) else "unknown"
        return result or (f"left closed loop without an error (now {now})",)

    def _words(self, meanings: Mapping[str, Words], harmless: int) -> tuple[str, ...]:
        result: list[str] = []
        for name, words in meanings.items():
            bits = self._numbers.get(self.path(name), 0.0)
            result += words(int(bits) & ~harmless)
            harmless = 0
        return tuple(dict.fromkeys(result))


def find(port: SerialPort, link: Link) -> Iterator[Found]:
    """An ODrive: it tells its version; or, where something else stood in its buffer, that it does not know that.

    Raises ConnectionFailedError.
    """
    heard = answers_to(b"\n" + ascii_protocol.line(f"r {VERSION[1]}"), port, link)
    numbers = (ascii_protocol.number_in(each.text) for each in ascii_protocol.TextStream().feed(heard))
    if ascii_protocol.UNKNOWN.encode() in heard or any(each is not None for each in numbers):
        yield Found("an ODrive")
