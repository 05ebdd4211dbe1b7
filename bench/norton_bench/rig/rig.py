"""A bench as the rest of the program sees it: plain frozen data in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any

from norton_bench.records import Chain
from norton_drivers.servo import Servo
from norton_drivers.wiring import Wiring

NO_MODEL = "none"  # what a rig calls an actuator that is identified by tables alone


@dataclass(frozen=True)
class Command:
    """A drive's command: its unit as written in the rig file, and the greatest magnitude allowed.

    ``lowest`` is the least that procedures choose; ``sent_as`` the unit in which the drive takes the same number.
    """

    unit: str
    limit: float
    lowest: float = -inf
    sent_as: str | None = None

    @property
    def span(self) -> tuple[float, float]:
        """The commands that may be chosen between."""
        return max(self.lowest, -self.limit), self.limit


@dataclass(frozen=True)
class Limits:
    """What the guard holds. ``inf`` stands for unlimited."""

    torque_nm: float
    velocity_rad_s: float
    stale_after_ns: int
    stall_after_ns: int = 50_000_000  # the loop itself standing still
    load_torque_nm: float = inf  # greatest load command
    position_rad: float = inf  # half-width of the window about the shaft's position at the start
    power_w: float = inf
    temperature_c: float = inf
    command_rate_per_s: float = inf
    twist_rad: float = 0.5  # between the two encoders of a coupled shaft


@dataclass(frozen=True)
class Supervision:
    """What the guard does beyond its limits: plausibility checks left out, by name; whether watchdogs are tried."""

    leave_out: tuple[str, ...] = ()
    verify_watchdogs: bool = True


@dataclass(frozen=True)
class Rig:
    """One bench. ``place`` is the file it came from, ``text`` that file's content, for provenance.

    ``modulation`` is the command of the actuator's second drive, which sets its impedance; None where it has none.
    ``candump`` says whether CAN frames go into a log of their own beside the recording.
    """

    name: str
    backend: str
    wiring: Wiring
    command: Command
    limits: Limits
    supervision: Supervision = Supervision()
    modulation: Command | None = None
    model: str = "dahl_motor"  # what the actuator is identified as; "none": tables alone
    candump: bool = True
    simulated: Mapping[str, Any] = field(default_factory=dict)
    place: str = ""
    text: str = ""

    @property
    def modelled(self) -> bool:
        """Whether the actuator is identified as a model, rather than by tables alone."""
        return self.model != NO_MODEL

    @property
    def servo(self) -> Servo | None:
        """The actuator's own loop, where its command is a position or a velocity."""
        return self.wiring.actuator.servo

    @property
    def holds_position(self) -> bool:
        """Whether its command is a position: the source is then a place, and otherwise a velocity."""
        return self.servo is not None and self.servo.holds_position

    @property
    def is_motor(self) -> bool:
        """Whether the actuator is identified as a motor whose command pushes it."""
        return self.modelled and self.servo is None

    @property
    def may_be_a_spring(self) -> bool:
        """Whether the actuator may rest at a place under a command, rather than be turned by it."""
        return not self.modelled or self.holds_position

    @property
    def command_may_be_a_place(self) -> bool:
        """Whether the command may be the place itself: a torque that is taken back pushes no longer, a place jumps."""
        return self.may_be_a_spring and self.command.unit != "N*m"

    @property
    def tick_ns(self) -> int:
        return self.wiring.tick_ns

    @property
    def tick_s(self) -> float:
        return self.wiring.tick_ns * 1e-9

    @property
    def chain(self) -> Chain:
        """What is known of the devices that no single reading tells."""
        sensor = self.wiring.torque_sensor
        return Chain(
            0.0 if sensor is None else float(sensor.options.get("averaging", 0.0)),
            frozenset(device.role for device in self.wiring.devices() if device.released_at_zero),
            self.servo,
            frozenset(device.role for device in self.wiring.devices() if device.answers_commands),
        )
