"""The one table of parameters: feeds the identifier, the screen, the report and the files."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from math import isfinite
from typing import Any


@dataclass(frozen=True)
class Parameter:
    """One parameter of the torque motor with Dahl friction (paper, section IV.D).

    ``unit`` may hold ``{command}``, which stands for the unit of the actuator's command.
    """

    name: str
    symbol: str
    unit: str
    meaning: str

    def unit_for(self, command_unit: str) -> str:
        """The unit with the command's own put in: for a command in N*m a torque gain is in N*m/(N*m)."""
        return self.unit.replace("{command}", command_unit)


PARAMETERS = (
    Parameter("torque_gain", "Km·Ka", "N*m/({command})", "shaft torque per unit of command"),
    Parameter("amplifier_bandwidth", "β", "rad/s", "bandwidth of the amplifier's first-order lag"),
    Parameter("inertia", "Im", "kg*m^2", "inertia of everything on the actuator's side of the port"),
    Parameter("viscous_damping", "B", "N*m*s/rad", "torque per velocity"),
    Parameter("coulomb_torque", "τc", "N*m", "friction in steady sliding"),
    Parameter("presliding_stiffness", "σ0", "N*m/rad", "stiffness of the friction contact before it slides"),
    Parameter("presliding_damping", "σ1", "N*m*s/rad", "damping of the friction contact before it slides"),
    Parameter("torque_constant", "Km", "N*m/A", "shaft torque per ampere (only where current is measured)"),
    Parameter("amplifier_gain", "Ka", "A/({command})", "current per unit of command (only where current is measured)"),
    Parameter("torque_limit", "τmax", "N*m", "greatest torque of a servo's motor (only where it was reached)"),
)
# Of the paper's motor, as torque and motion alone tell it.
MOTOR_PARAMETERS = PARAMETERS[:7]
BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}


class Status(Enum):
    """What may be done with an estimate."""

    UNEXCITED = "unexcited"  # the data so far say nothing of it
    LEARNING = "learning"  # they say something, not yet enough
    VALID = "valid"
    AT_BOUND = "at bound"  # pushed against the edge of what was searched: not an estimate
    RATIO_ONLY = "ratio only"  # known only up to a common factor
    NOT_CONVERGED = "not converged"
    INADEQUATE = "inadequate"  # the machine does what the model does not have, and the value depends on it
    DOUBTFUL = "doubtful"  # the data contradict the model, or themselves: not an estimate


# Deviations in half of a normal distribution's 95 % interval: what stands behind every "±" that is shown.
HALF_INTERVAL = 1.96


@dataclass(frozen=True)
class Estimate:
    """One estimated parameter in ``unit``, ``std`` its standard deviation; where ``status`` is valid, value ±
    ``half_interval`` covers 95 %."""

    name: str
    value: float
    std: float
    unit: str
    status: Status

    @property
    def half_interval(self) -> float:
        """Half of the 95 % interval."""
        return HALF_INTERVAL * self.std


NAN = float("nan")
UNITS = {"velocity": "rad/s", "acceleration": "rad/s^2"}


@dataclass(frozen=True)
class PredictionError:
    """How far a network's predictions are off, and where that was seen: it goes with the network's file.

    What the rms error over some seconds of a motion not seen before stays below, in ``level`` of such stretches.

    ``torque_nm`` under a measured motion, ``velocity_rad_s`` of the free motion under a command; NaN where it was
    not seen. Neither the sensors' noise nor their zero is in them. ``ranges`` has, for "velocity" [rad/s],
    "acceleration" [rad/s²] and "command" [its unit], the least and the greatest value that they were seen with:
    they hold within.
    """

    torque_nm: float = NAN
    velocity_rad_s: float = NAN
    level: float = NAN
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def as_json(self, command_unit: str) -> dict[str, Any]:
        """As in a network file; what is not known is null."""
        return {
            "torque": {"value": _known(self.torque_nm), "unit": "N*m"},
            "free_velocity": {"value": _known(self.velocity_rad_s), "unit": "rad/s"},
            "level": _known(self.level),
            "ranges": {
                name: {"from": low, "to": high, "unit": UNITS.get(name, command_unit)}
                for name, (low, high) in self.ranges.items()
            },
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "PredictionError":
        """The reverse. Raises KeyError, TypeError or ValueError for what is none."""
        ranges = {str(name): (float(span["from"]), float(span["to"])) for name, span in content["ranges"].items()}
        torque, velocity = content["torque"]["value"], content["free_velocity"]["value"]
        return cls(_number(torque), _number(velocity), _number(content["level"]), ranges)


def _known(value: float) -> float | None:
    return value if isfinite(value) else None


def _number(value: float | None) -> float:
    return NAN if value is None else float(value)


@dataclass(frozen=True)
class DahlMotor:
    """The torque motor with Dahl friction (paper, section IV.D), in the paper's symbols.

    Ka [A per command] amplifier gain, beta [rad/s] its bandwidth, Km [N m/A] torque constant, Im [kg m²] rotor inertia,
    B [N m s/rad] viscous damping, sigma_0 [N m/rad] presliding stiffness, sigma_1 [N m s/rad] presliding damping,
    tau_c [N m] Coulomb torque.

    The methods take e_c, the command in its unit (the paper's is a voltage), i [A], the motor's current, phi [rad], the
    deflection of the friction contact, omega [rad/s], the shaft's velocity, and tau_act [N m], the torque that the
    actuator exerts at its port.
    """

    Ka: float
    beta: float
    Km: float
    Im: float
    B: float
    sigma_0: float
    sigma_1: float
    tau_c: float

    def dahl_rate(self, omega: float, phi: float) -> float:
        """dφ/dt = ω − (σ0/τc) |ω| φ  [rad/s]."""
        return omega - self.sigma_0 / self.tau_c * abs(omega) * phi

    def dahl_torque(self, omega: float, phi: float) -> float:
        """τ_Dahl = σ0 φ + σ1 dφ/dt  [N m]."""
        return self.sigma_0 * phi + self.sigma_1 * self.dahl_rate(omega, phi)

    def current_rate(self, i: float, e_c: float) -> float:
        """di/dt = Ka β e_c − β i  [A/s]."""
        return self.Ka * self.beta * e_c - self.beta * i

    def acceleration(self, i: float, omega: float, phi: float, tau_act: float) -> float:
        """dω/dt = (Km i − τ_act − τ_Dahl − B ω) / Im  [rad/s²] (admittance form: torque in, motion out)."""
        return (self.Km * i - tau_act - self.dahl_torque(omega, phi) - self.B * omega) / self.Im

    def port_torque(self, i: float, omega: float, phi: float, omega_rate: float) -> float:
        """τ_act = Km i − τ_Dahl − B ω − Im dω/dt  [N m] (impedance form: motion in, torque out)."""
        return self.Km * i - self.dahl_torque(omega, phi) - self.B * omega - self.Im * omega_rate

    def source_velocity(self, e_c: float) -> float:
        """ω_N(e_c): the steady free velocity [rad/s], in three branches; single-valued, though not invertible."""
        torque = self.Km * self.Ka * e_c
        if torque > self.tau_c:
            return (torque - self.tau_c) / self.B
        if torque < -self.tau_c:
            return (torque + self.tau_c) / self.B
        return 0.0
