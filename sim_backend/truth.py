"""The true values of a simulated bench: the rig file's ``[simulated]`` table, which only the simulator reads.

Quantities are written with their units; what is not written takes the default that stands here. Attributes carry
the unit in their name and are written in the file without it (``inertia_kg_m2`` is ``inertia``).
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, ValidationInfo, field_validator

from bench.models.dahl_motor import DahlMotor
from bench.models.parameters import BY_NAME
from bench.units import parse_quantity
from drivers.errors import WiringError
from sim_backend.tables import complaints


def _in(unit: str) -> BeforeValidator:
    return BeforeValidator(lambda text: parse_quantity(text, unit))


def _nanoseconds(text: object) -> int:
    return round(parse_quantity(text, "s") * 1e9)


Number = Annotated[float, _in("dimensionless")]
Rate = Annotated[float, _in("rad/s")]
Torque = Annotated[float, _in("N*m")]
Inertia = Annotated[float, _in("kg*m^2")]
Stiffness = Annotated[float, _in("N*m/rad")]
Damping = Annotated[float, _in("N*m*s/rad")]
TorqueConstant = Annotated[float, _in("N*m/A")]
Current = Annotated[float, _in("A")]
Nanoseconds = Annotated[int, BeforeValidator(_nanoseconds)]
Sign = Literal[1, -1]
Device = dict[str, Any]  # how it is really set up, where that is not what the rig says; sim_backend.hookup reads it

FAULTS = "fault"  # the key of the table's faults, which say what becomes of the truth; sim_backend.faults reads them


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Cogging(_Table):
    """Torque that goes with the rotor's position: amplitude · sin(periods · θ), opposing the motor's torque."""

    amplitude_nm: Torque = Field(alias="amplitude", ge=0, examples=["0.3 mN*m"])
    periods_per_turn: int = Field(ge=1, examples=[42])


class _Machine(_Table):
    """What the actuator and the load machine have in common."""

    amplifier_bandwidth_rad_s: Rate = Field(alias="amplifier_bandwidth", gt=0, examples=["600 rad/s"])
    inertia_kg_m2: Inertia = Field(alias="inertia", gt=0, examples=["5e-5 kg*m^2"])
    viscous_damping_nm_s_rad: Damping = Field(alias="viscous_damping", gt=0, examples=["1e-3 N*m*s/rad"])
    coulomb_torque_nm: Torque = Field(alias="coulomb_torque", gt=0, examples=["0.02 N*m"])
    presliding_stiffness_nm_rad: Stiffness = Field(alias="presliding_stiffness", gt=0, examples=["10 N*m/rad"])
    presliding_damping_nm_s_rad: Damping = Field(alias="presliding_damping", default=0.0, ge=0)
    cogging: Cogging | None = None
    counts_per_turn: int = Field(default=131072, ge=1)
    encoder_bandwidth_rad_s: Rate = Field(alias="encoder_bandwidth", default=1000.0, gt=0, lt=8000)
    current_noise_a: Current = Field(alias="current_noise", default=0.0, ge=0)
    mounted: Sign = 1
    device: Device = Field(default_factory=dict)

    def _motor(self, torque_constant_nm_a: float, amplifier_gain: float) -> DahlMotor:
        return DahlMotor(
            Ka=amplifier_gain,
            beta=self.amplifier_bandwidth_rad_s,
            Km=torque_constant_nm_a,
            Im=self.inertia_kg_m2,
            B=self.viscous_damping_nm_s_rad,
            sigma_0=self.presliding_stiffness_nm_rad,
            sigma_1=self.presliding_damping_nm_s_rad,
            tau_c=self.coulomb_torque_nm,
        )


class ActuatorTruth(_Machine):
    """The device under test: the paper's torque motor with Dahl friction (section IV.D).

    ``amplifier_gain`` is in amperes per unit of the actuator's command, whatever that unit is.
    """

    model: Literal["dahl_motor"] = "dahl_motor"
    torque_constant_nm_a: TorqueConstant = Field(alias="torque_constant", gt=0, examples=["0.05 N*m/A"])
    amplifier_gain: float = Field(gt=0, examples=["18 A/(N*m)"])

    @field_validator("amplifier_gain", mode="before")
    @classmethod
    def _per_unit_of_command(cls, text: object, info: ValidationInfo) -> float:
        return parse_quantity(text, f"A/({info.context['command_unit']})" if info.context else "A/(N*m)")

    @property
    def motor(self) -> DahlMotor:
        return self._motor(self.torque_constant_nm_a, self.amplifier_gain)


class LoadTruth(_Machine):
    """The load machine, commanded in newton metres: ``torque_gain`` is the torque it gives for each."""

    torque_gain: Number = Field(gt=0, examples=[0.95])
    torque_constant_nm_a: TorqueConstant = Field(alias="torque_constant", default=0.05, gt=0)

    @property
    def motor(self) -> DahlMotor:
        return self._motor(self.torque_constant_nm_a, self.torque_gain / self.torque_constant_nm_a)


class TorqueSensorTruth(_Table):
    """The torque sensor: a damped spring between actuator and load, and what it reports of its own torque."""

    stiffness_nm_rad: Stiffness = Field(alias="stiffness", default=200.0, gt=0)
    damping_nm_s_rad: Damping = Field(alias="damping", default=0.01, ge=0)
    noise_nm: Torque = Field(alias="noise", default=0.0, ge=0)
    bias_nm: Torque = Field(alias="bias", default=0.0)
    drift_nm_s: Annotated[float, _in("N*m/s")] = Field(alias="drift", default=0.0)
    mounted: Sign = 1
    device: Device = Field(default_factory=dict)


class TransportTruth(_Table):
    """How long frames and bytes take between a device and the host: a fixed delay and the spread about it."""

    can_delay_ns: Nanoseconds = Field(alias="can_delay", default=250_000, ge=0)
    can_jitter_ns: Nanoseconds = Field(alias="can_jitter", default=0, ge=0)
    serial_delay_ns: Nanoseconds = Field(alias="serial_delay", default=400_000, ge=0)
    serial_jitter_ns: Nanoseconds = Field(alias="serial_jitter", default=0, ge=0)


class Truth(_Table):
    """Everything a simulated bench is made of. ``load`` is None where nothing is coupled to the actuator."""

    seed: int = Field(default=0, ge=0)
    actuator: ActuatorTruth
    load: LoadTruth | None = None
    torque_sensor: TorqueSensorTruth = TorqueSensorTruth()
    transport: TransportTruth = TransportTruth()


def read_truth(simulated: Mapping[str, Any], *, seed: int | None, place: str, command_unit: str = "N*m") -> Truth:
    """The true values written in ``simulated``, the rig file's table of that name; ``seed`` overrides its seed.

    Raises WiringError, one sentence for each mistake with its place (``place`` names the rig file) and the mend.
    """
    written = {key: value for key, value in simulated.items() if key != FAULTS}
    if seed is not None:
        written["seed"] = seed
    try:
        return Truth.model_validate(written, context={"command_unit": command_unit})
    except ValidationError as error:
        raise WiringError("\n".join(complaints(error, Truth, written, place=place, name="simulated"))) from error


def true_parameters(truth: Truth, command_unit: str = "N*m") -> dict[str, tuple[float, str]]:
    """The actuator's true parameters, ``{name: (value, unit)}``, under the names the identifier uses."""
    motor = truth.actuator.motor
    values = {
        "torque_gain": motor.Km * motor.Ka,
        "amplifier_bandwidth": motor.beta,
        "inertia": motor.Im,
        "viscous_damping": motor.B,
        "coulomb_torque": motor.tau_c,
        "presliding_stiffness": motor.sigma_0,
        "presliding_damping": motor.sigma_1,
        "torque_constant": motor.Km,
        "amplifier_gain": motor.Ka,
    }
    return {name: (value, BY_NAME[name].unit_for(command_unit)) for name, value in values.items()}
