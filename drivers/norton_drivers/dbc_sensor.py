"""A torque sensor on CAN whose frame a DBC file describes: which message, which signal, and optionally its counter.

Torque is that which the actuator exerts on the load, times ``direction``.
"""

from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from math import inf, isfinite
from pathlib import Path
from typing import Any

import can
import cantools
from pydantic import Field

from norton_drivers.errors import DeviceTimeoutError, WiringError
from norton_drivers.link import Link, wait_until
from norton_drivers.ports import CanPort
from norton_drivers.readings import DeviceIdentity, Inbox, TorqueReading
from norton_drivers.registry import Recognised
from norton_drivers.wiring import DeviceSettings, TorqueSensorOptions, parse_options

CONNECTION = "can"
OPTION_UNITS = {"range": "N*m", "averaging": "s"}
OPTION_FILES = ("dbc",)  # may stand beside the rig file

SHIPPED = Path(__file__).parent / "dbc"
_NEWTON_METRE = ("", "nm", "n*m", "n.m", "n·m", "n m")


class DbcOptions(TorqueSensorOptions):
    """What a rig file may say of a sensor described by a DBC file."""

    dbc: str = Field("torque-sensor", description="a DBC file, or the name of a shipped one")
    message: str = Field("TorqueReading", description="the message's name in the DBC file")
    signal: str = Field("Torque", description="the torque signal's name in the message")
    scale: float | None = Field(None, description="N*m per unit of the signal", examples=[0.001])
    counter: str | None = Field(None, description="a signal that counts samples")
    status: str | None = Field(None, description="a signal that is 0 when all is well")
    range_nm: float = Field(inf, alias="range", gt=0, description="the torque it can measure", examples=["2 N*m"])


def check_settings(settings: DeviceSettings) -> None:
    """Raises WiringError for a DBC file that cannot be read, or does not have what the options name."""
    load_message(parse_options(DbcOptions, settings), settings.role)


def open_torque_sensor(settings: DeviceSettings, link: Link) -> "DbcSensor":
    """Raises WiringError for a wrong option or DBC file, ConnectionFailedError for the bus."""
    options = parse_options(DbcOptions, settings)
    message = load_message(options, settings.role)
    return DbcSensor(settings, options, message, link.can_port(settings), link)


def recognise(message: can.Message, options: Mapping[str, Any]) -> Recognised | None:
    """Any message of the DBC file that the options name, or of the one that is shipped."""
    name = str(options.get("dbc", "torque-sensor"))
    for known in _messages_in(name):
        if (known.frame_id, known.is_extended_frame) == (message.arbitration_id, message.is_extended_id):
            return Recognised(f"the device that {Path(name).name} describes", known.name, {"message": known.name})
    return None


@lru_cache(maxsize=8)
def _messages_in(name: str) -> tuple[cantools.database.Message, ...]:
    """Those of a DBC file; none where it cannot be read, which whoever opens the sensor is told."""
    with suppress(WiringError, OSError, UnicodeDecodeError, cantools.Error):
        database = cantools.database.load_file(_file(name, "torque_sensor"), database_format="dbc")
        return tuple(getattr(database, "messages", ()))
    return ()


class DbcSensor:
    """``malformed`` counts frames that could not be decoded, ``repeats`` those that repeat the last sample."""

    def __init__(
        self,
        settings: DeviceSettings,
        options: DbcOptions,
        message: cantools.database.Message,
        port: CanPort,
        link: Link,
    ) -> None:
        self.role = settings.role
        self.malformed = 0
        self.repeats = 0
        self._options = options
        self._message = message
        self._port = port
        self._link = link
        self._scale = settings.direction * (1.0 if options.scale is None else options.scale)
        self._last_counter: object = None
        self._readings: Inbox[TorqueReading] = Inbox()
        port.subscribe(self._on_frame)

    @property
    def range_nm(self) -> float:
        return self._options.range_nm

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """Wait for a message: a DBC file describes nothing to ask."""
        before = self._readings.count
        address = f"{self._port.name} {self._message.name} (id 0x{self._message.frame_id:X})"
        if not wait_until(lambda: self._readings.count > before, self._link, timeout_s):
            raise DeviceTimeoutError(
                f"[{self.role}] {address}: no reading in {timeout_s:g} s ({self.malformed} malformed frames, "
                f"{self.repeats} repeats); check power, bus and bitrate"
            )
        return DeviceIdentity(driver="dbc", address=address)

    def take_torque(self) -> list[TorqueReading]:
        return self._readings.take()

    def _on_frame(self, frame: can.Message, arrival_ns: int) -> None:
        if (
            frame.arbitration_id != self._message.frame_id
            or frame.is_extended_id != self._message.is_extended_frame
            or frame.is_remote_frame
        ):
            return
        try:
            self._on_values(self._message.decode(bytes(frame.data), decode_choices=False), arrival_ns)
        except (cantools.database.DecodeError, ValueError, KeyError):
            self.malformed += 1

    def _on_values(self, values: Any, arrival_ns: int) -> None:
        if self._options.counter is not None:
            counter = values[self._options.counter]
            if counter == self._last_counter:
                self.repeats += 1
                return
            self._last_counter = counter
        torque_nm = self._scale * float(values[self._options.signal])
        healthy = self._options.status is None or values[self._options.status] == 0
        reading = TorqueReading(
            self._readings.count, arrival_ns, torque_nm, device_ns=None, valid=healthy and isfinite(torque_nm)
        )
        self._readings.put(reading)


def load_message(options: DbcOptions, role: str) -> cantools.database.Message:
    """The message, known to have the signals asked for. Raises WiringError."""
    path = _file(options.dbc, role)
    try:
        database = cantools.database.load_file(path, database_format="dbc")
    except (OSError, UnicodeDecodeError, cantools.Error) as error:
        raise WiringError(f'[{role}] dbc = "{options.dbc}" is not a DBC file that can be read: {error}') from error
    messages: dict[str, cantools.database.Message] = {each.name: each for each in getattr(database, "messages", ())}
    if options.message not in messages:
        raise WiringError(
            f'[{role}] message = "{options.message}" is not in {path.name}; it has {", ".join(messages) or "none"}'
        )
    message = messages[options.message]
    for key in ("signal", "counter", "status"):
        _check_signal(message, getattr(options, key), f"[{role}] {key}")
    _check_unit(message, options, role)
    return message


def _file(name: str, role: str) -> Path:
    for path in (Path(name).expanduser(), SHIPPED / f"{name}.dbc"):
        if path.is_file():
            return path
    shipped = ", ".join(sorted(path.stem for path in SHIPPED.glob("*.dbc")))
    raise WiringError(f'[{role}] dbc = "{name}" is neither a file nor one of the shipped: {shipped}')


def _check_signal(message: cantools.database.Message, name: str | None, place: str) -> None:
    known = [signal.name for signal in message.signals]
    if name is not None and name not in known:
        raise WiringError(f'{place} = "{name}" is not a signal of {message.name}; it has {", ".join(known)}')


def _check_unit(message: cantools.database.Message, options: DbcOptions, role: str) -> None:
    unit = message.get_signal_by_name(options.signal).unit or ""
    if options.scale is None and unit.lower() not in _NEWTON_METRE:
        raise WiringError(
            f'[{role}] signal "{options.signal}" is in {unit!r}: give its size in N*m, for instance scale = 0.001'
        )
