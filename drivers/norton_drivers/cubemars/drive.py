"""CubeMars' AK actuators in servo mode on CAN: currents or torques out, motion and current in.

The actuator sends its state by itself, up to 500 times a second, and takes currents as a VESC does. It has no state
"enabled", and lets go of the motor where no command comes for its timeout, if one is set. Its error is a byte of every
message; one that was seen stays until the next :meth:`CubeMars.enable`. Its angle has steps of a tenth of a degree.
Sources: the codec's; what its firmware does beyond the manual is VESC's, from which it descends.
"""

from collections.abc import Mapping
from math import copysign, inf, nan, pi, radians
from typing import Any, ClassVar, Literal

import can
from pydantic import Field, field_validator

from norton_drivers.codecs import cubemars as protocol
from norton_drivers.codecs import vesc
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.cubemars import Upload
from norton_drivers.codecs.mit import ERRORS_MAX, describe_error
from norton_drivers.errors import DeviceError
from norton_drivers.link import Link, wait_until
from norton_drivers.ports import CanPort
from norton_drivers.readings import CurrentReading, DeviceIdentity, DriveStatus, MotionReading
from norton_drivers.registry import Recognised
from norton_drivers.vesc.current import CurrentDrive
from norton_drivers.vesc.motor import AmpereOptions
from norton_drivers.vesc.shaft import VescShaft
from norton_drivers.wiring import DeviceSettings, parse_options

SILENT_NS = 150_000_000
COUNTED_S = 0.1
_LEAST_PROBE_A = 0.05
AT_END = "the angle is at the end of its range of ±3200 degrees; set its origin nearer"
_DEVICE = "a CubeMars actuator in servo mode"

CONNECTION = "can"
BITRATE = "1 Mbit/s"
OPTION_UNITS = {"torque_constant": "N*m/A", "minimum_current": "A", "watchdog": "s", "watchdog_probe": "A"}


class CubeMarsOptions(AmpereOptions):
    """What a rig file may say of a CubeMars actuator in servo mode."""

    asked: ClassVar = ("mode", "beyond_range")
    command_units: ClassVar = {"A": {"mode": "current"}, "N*m": {"mode": "torque"}}

    node: int = Field(ge=0, le=protocol.NODE_MAX, description="the actuator's CAN id", examples=[104])
    pole_pairs: int = Field(
        ge=1, description="pairs of magnet poles of its motor: it counts electrical turns", examples=[21]
    )
    gear_ratio: float = Field(gt=0, description="turns of its motor for one of its output", examples=[9])
    mode: Literal["current", "torque"] = Field("current", description='what is commanded: "current" [A] or "torque"')
    torque_constant_nm_a: float | None = Field(
        None,
        alias="torque_constant",
        gt=0,
        validate_default=True,
        description='at the output, with mode = "torque": the current for a torque is worked out with it',
        examples=["0.8 N*m/A"],
    )
    beyond_range: Literal["saturates", "wraps"] = Field(
        "saturates", description='what the angle does at 3200 degrees: "saturates", or "wraps" after 16 bits'
    )
    minimum_current_a: float = Field(
        0.05,
        alias="minimum_current",
        ge=0,
        description="the drive's own least current: below it the motor is let go of",
        examples=["0.05 A"],
    )
    watchdog_s: float = Field(
        0.0,
        alias="watchdog",
        ge=0,
        description="the timeout set in the drive; 0 where there is none, or nobody knows",
        examples=["500 ms"],
    )
    watchdog_probe_a: float = Field(
        0.0,
        alias="watchdog_probe",
        ge=0,
        description="current whose end shows the timeout at work; too small to turn the shaft, 0 for none",
        examples=["0.1 A"],
    )

    @property
    def greatest_position_rad(self) -> float:
        return radians(protocol.POSITION_END_DEG) if self.beyond_range == "saturates" else inf

    @property
    def rad_s_per_erpm(self) -> float:
        """At the output."""
        return 2 * pi / 60 / self.pole_pairs / self.gear_ratio

    @field_validator("watchdog_probe_a")
    @classmethod
    def _can_be_seen(cls, probe_a: float) -> float:
        if 0 < probe_a < _LEAST_PROBE_A:
            raise ValueError(f"cannot be told from nothing in steps of 0.01 A; at least {_LEAST_PROBE_A:g} A")
        return probe_a


def open_amplifier(settings: DeviceSettings, link: Link) -> "CubeMars":
    """Raises WiringError for a wrong option, ConnectionFailedError for the bus."""
    return CubeMars(settings, parse_options(CubeMarsOptions, settings), link.can_port(settings), link)


def recognise(message: can.Message, _options: Mapping[str, Any]) -> Recognised | None:
    """What it sends by itself: of VESC's family only a battery monitor has such identifiers, with other last bytes."""
    packet, node = vesc.split_id(message.arbitration_id)
    if not message.is_extended_id or message.is_remote_frame or message.dlc != 8:
        return None
    if packet != protocol.UPLOAD or node > protocol.NODE_MAX or message.data[7] > ERRORS_MAX:
        return None
    return Recognised(_DEVICE, "upload", {"node": node})


class CubeMars(CurrentDrive):
    """One actuator. ``malformed`` counts its messages that could not be decoded."""

    heartbeat_timeout_ns = SILENT_NS
    _kind: ClassVar = "CubeMars actuator"

    def __init__(self, settings: DeviceSettings, options: CubeMarsOptions, port: CanPort, link: Link) -> None:
        super().__init__(settings, options, port, link)
        self.options = options
        self.malformed = 0
        self._told: Upload | None = None
        self._upload_id = vesc.arbitration_id(protocol.UPLOAD, options.node)
        step_rad = radians(protocol.POSITION_STEP_DEG)
        self._shaft = VescShaft(step_rad, protocol.POSITION_SPAN, options.rad_s_per_erpm, protocol.ERPM_STEP)
        port.subscribe(self._on_frame)

    def identify(self, timeout_s: float = 1.0) -> DeviceIdentity:
        """See that it sends, and no oftener than one can: it answers no question."""
        frames = self._frames
        self._wait_for(
            lambda: self._frames > frames,
            timeout_s,
            "sends nothing; is it powered, in servo mode, with node as its CAN id, and its upload switched on?",
        )
        frames, begun_ns = self._frames, self._link.clock.now_ns()
        wait_until(lambda: False, self._link, COUNTED_S)
        rate_hz = (self._frames - frames) * 1e9 / (self._link.clock.now_ns() - begun_ns)
        if rate_hz > 1.3 * protocol.UPLOADS_MAX_HZ:
            raise DeviceError(
                f"{self._place}: sends {rate_hz:.0f} times a second, oftener than one can; do two have this CAN id?"
            )
        return DeviceIdentity(driver="cubemars", address=f"{self._port.name} node {self.options.node}")

    def enable(self, timeout_s: float = 2.0) -> None:
        """See that there is no error, and command zero; there is no state to enter."""
        self._enabled, self._status = False, None
        self._faults.forget()
        self.command(0.0)
        frames = self._frames
        self._wait_for(lambda: self._frames >= frames + 2, timeout_s, "sends nothing")
        if errors := self._faults.words():
            raise DeviceError(f"{self._place}: refuses to drive its motor: {'; '.join(errors)}")
        self._enabled, self._status = True, None

    @property
    def position_resolution_rad(self) -> float:
        return self._shaft.step_rad

    # ---- State ---------------------------------------------------------------------------------------------------

    @property
    def _flowing_a(self) -> float:
        return 0.0 if self._told is None else self._told.current_a

    def _new_status(self) -> DriveStatus:
        return DriveStatus(
            state=self._state(),
            heartbeat_ns=self._frame_ns if self._heard else None,
            errors=self._faults.words(),
            transistor_temperature_c=nan if self._told is None else float(self._told.temperature_c),
        )

    # ---- What arrives --------------------------------------------------------------------------------------------

    def _on_frame(self, message: can.Message, arrival_ns: int) -> None:
        if not message.is_extended_id or message.is_remote_frame or message.arbitration_id != self._upload_id:
            return
        try:
            told = self._told = Upload.decode(message.data)
        except CodecError:
            self.malformed += 1
            return
        self._on_current(arrival_ns)
        self._faults.tell(describe_error(told.error) if told.error else "", kept=self._enabled)
        self._shaft.on_erpm(told.erpm)
        self._on_motion(told, arrival_ns)
        current_a = self._direction * vesc.middle(told.current_a, protocol.CURRENT_STEP_A)
        self._current.put(CurrentReading(self._current.count, arrival_ns, current_a))

    def _on_motion(self, told: Upload, arrival_ns: int) -> None:
        if self.options.beyond_range == "saturates" and abs(told.position) * protocol.POSITION_STEP_DEG >= (
            protocol.POSITION_END_DEG
        ):
            # No reading rather than a wrong one; the guard sees the fault with its next tick.
            self._faults.tell(AT_END, kept=self._enabled)
            return
        position_rad = self._shaft.position_rad(told.position, arrival_ns)
        if position_rad:  # cut off towards zero
            position_rad += copysign(0.5 * self._shaft.step_rad, position_rad)
        velocity_rad_s = self._shaft.velocity_rad_s or 0.0
        sign, motion = self._direction, self._motion
        motion.put(MotionReading(motion.count, arrival_ns, sign * position_rad, sign * velocity_rad_s))
