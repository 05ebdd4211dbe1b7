"""What somebody who moves the bench by hand may ask for, and how far."""

from dataclasses import dataclass, replace
from enum import Enum
from math import inf, isfinite

from norton_bench.errors import UsageError
from norton_bench.procedures.imposed import VELOCITY_SHARE
from norton_bench.procedures.tare import greatest_load_torque
from norton_bench.rig.rig import Rig

# Of [limits] velocity, where nothing else is asked for. Between the two a shaft that is let go of has room for what it
# still gains until a command of zero acts.
SPEED_SHARE = 0.5


class LoadDoes(Enum):
    """What the load machine does meanwhile."""

    COAST = "coasts"
    TORQUE = "pushes"
    VELOCITY = "turns"
    ZERO_TORQUE = "zero torque"


# These take the controller, which is tuned from the calibration.
CONTROLLED = (LoadDoes.VELOCITY, LoadDoes.ZERO_TORQUE)


@dataclass(frozen=True)
class Setpoints:
    """``command`` is the actuator's, in its own unit; ``load_value`` a torque [N m] or a velocity [rad/s], else 0."""

    command: float = 0.0
    load: LoadDoes = LoadDoes.COAST
    load_value: float = 0.0

    @property
    def at_zero(self) -> bool:
        return self.command == 0.0 and self.load_value == 0.0

    def zeroed(self) -> "Setpoints":
        """Nothing pushes, and nothing turns; the load does what it did."""
        return Setpoints(0.0, self.load)

    def words(self, command_unit: str) -> str:
        """In a few words, for whoever watches, and the recording."""
        load = {
            LoadDoes.COAST: "load coasts",
            LoadDoes.TORQUE: f"load {self.load_value:+.4g} N*m",
            LoadDoes.VELOCITY: f"load {self.load_value:+.4g} rad/s",
            LoadDoes.ZERO_TORQUE: "zero torque at the port",
        }
        return f"actuator {self.command:+.4g} {command_unit}, {load[self.load]}"


@dataclass(frozen=True)
class Bounds:
    """How far setpoints may go. ``speed_rad_s`` is the shaft's speed at which torques end; an imposed velocity stays
    below it. ``load_torque_nm`` is 0 without a load, and inf where the rig does not limit it."""

    command_unit: str
    command: tuple[float, float]
    load_torque_nm: float
    velocity_rad_s: float
    speed_rad_s: float

    @property
    def greatest_command(self) -> float:
        return max(abs(self.command[0]), self.command[1])

    def greatest_load(self, load: LoadDoes) -> float:
        """The greatest value of what the load does; 0 where there is none to choose."""
        return {LoadDoes.TORQUE: self.load_torque_nm, LoadDoes.VELOCITY: self.velocity_rad_s}.get(load, 0.0)

    def clamped(self, wanted: Setpoints) -> tuple[Setpoints, str]:
        """``wanted`` within bounds, and a sentence about what was cut; empty where nothing was."""
        command = min(max(wanted.command, self.command[0]), self.command[1])
        most = self.greatest_load(wanted.load)
        load_value = min(max(wanted.load_value, -most), most)
        said = []
        if command != wanted.command:
            said.append(f"the actuator stays at {command:+.4g} {self.command_unit}: the rig allows no more")
        if load_value != wanted.load_value:
            said.append(f"the load stays at {self._load_words(wanted.load, load_value)}")
        return replace(wanted, command=command, load_value=load_value), "; ".join(said)

    def _load_words(self, load: LoadDoes, value: float) -> str:
        if load is LoadDoes.VELOCITY:
            return f"{value:+.4g} rad/s: {VELOCITY_SHARE:.0%} of the {self.speed_rad_s:.4g} rad/s at which torques end"
        return f"{value:+.4g} N*m: the rig allows no more"


def bounds_of(rig: Rig, speed_rad_s: float | None = None) -> Bounds:
    """Raises UsageError for a ``speed_rad_s`` that the rig's limit leaves no room for."""
    most_rad_s = VELOCITY_SHARE * rig.limits.velocity_rad_s
    if speed_rad_s is None:
        speed_rad_s = SPEED_SHARE * rig.limits.velocity_rad_s
    if not 0.0 < speed_rad_s <= most_rad_s:
        raise UsageError(
            f"a speed of {speed_rad_s:g} rad/s: must be greater than 0, and at most {most_rad_s:g} rad/s, which is "
            f"{VELOCITY_SHARE:.0%} of [limits] velocity, at which the guard stops"
        )
    low, high = rig.command.span
    torque_nm = greatest_load_torque(rig) if rig.wiring.load is not None else 0.0
    return Bounds(rig.command.unit, (min(low, 0.0), high), torque_nm, VELOCITY_SHARE * speed_rad_s, speed_rad_s)


def unlimited(bounds: Bounds, load: LoadDoes) -> bool:
    """Whether there is no limit of which a step could be a share."""
    return not isfinite(bounds.greatest_load(load)) and bounds.greatest_load(load) == inf
