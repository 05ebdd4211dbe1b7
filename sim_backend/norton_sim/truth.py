"""The true values of a simulated bench: the rig file's ``[simulated]`` table, which only the simulator reads.

Quantities are written with their units; what is not written takes the default that stands here. Attributes carry
the unit in their name and are written in the file without it (``inertia_kg_m2`` is ``inertia``).
"""

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, Literal, cast

from pydantic import Field, ValidationError, ValidationInfo, create_model, field_validator

from norton_bench.models.parameters import BY_NAME, DahlMotor
from norton_bench.models.terms import TERM_PARAMETERS
from norton_bench.units import parse_quantity
from norton_drivers.errors import WiringError
from norton_sim.departures import Departures
from norton_sim.plants.assembled import Assembled
from norton_sim.plants.motor_behind import GearTrainTruth, SeriesElasticTruth, VariableStiffnessTruth
from norton_sim.plants.muscles import ArmTruth, PneumaticMuscleTruth
from norton_sim.tables import (
    Commanded,
    Current,
    Damping,
    Device,
    Drive,
    Machine,
    Nanoseconds,
    Number,
    Rate,
    Sign,
    Stiffness,
    Table,
    Torque,
    TorqueConstant,
    TorqueDrift,
    Unit,
    complaints,
)

FAULTS = "fault"  # the key of the table's faults, which say what becomes of the truth; norton_sim.faults reads them


class MotorTruth(Machine, Commanded):
    """The device under test: the paper's torque motor with Dahl friction (section IV.D), and how it departs from it.

    Its amplifier gives no more than ``current_limit``.
    """

    model: Literal["dahl_motor"] = "dahl_motor"
    torque_constant_nm_a: TorqueConstant = Field(alias="torque_constant", gt=0, examples=["0.05 N*m/A"])
    current_limit_a: Current | None = Field(alias="current_limit", default=None, gt=0, examples=["8 A"])
    departures: Departures | None = None

    @property
    def motor(self) -> DahlMotor:
        return self._motor(self.torque_constant_nm_a, self.amplifier_gain)


class LoadTruth(Machine):
    """The load machine, commanded in newton metres: ``torque_gain`` is the torque it gives for each."""

    torque_gain: Number = Field(gt=0, examples=[0.95])
    torque_constant_nm_a: TorqueConstant = Field(alias="torque_constant", default=0.05, gt=0)

    @property
    def amplifier_gain(self) -> float:
        """In amperes per newton metre commanded."""
        return self.torque_gain / self.torque_constant_nm_a

    @property
    def motor(self) -> DahlMotor:
        return self._motor(self.torque_constant_nm_a, self.amplifier_gain)


class ModulatorTruth(Drive):
    """The actuator's second drive: ``travel`` is where its motor goes for each unit of its command [rad].

    Its amplifier's current stands for the command, i = amplifier_gain · π once it has settled; the motor follows that
    with a lag of ``bandwidth``.
    """

    amplifier_gain: float = Field(gt=0, examples=["2 A/(N*m/rad)"])
    travel: float = Field(gt=0, examples=["0.25 rad/(N*m/rad)"])
    bandwidth_rad_s: Rate = Field(alias="bandwidth", gt=0, examples=["40 rad/s"])
    torque_constant_nm_a: TorqueConstant = Field(alias="torque_constant", default=0.05, gt=0)

    @field_validator("amplifier_gain", "travel", mode="before")
    @classmethod
    def _per_unit_of_modulation(cls, text: object, info: ValidationInfo) -> float:
        unit = info.context["modulation_unit"] if info.context else "N*m/rad"
        return parse_quantity(text, f"{'A' if info.field_name == 'amplifier_gain' else 'rad'}/({unit})")

    def angle_rad(self, modulation: float) -> float:
        """Where its motor goes, but for its stops."""
        return self.travel * modulation


class TorqueSensorTruth(Table):
    """The torque sensor: a damped spring between actuator and load, and what it reports of its own torque."""

    stiffness_nm_rad: Stiffness = Field(alias="stiffness", default=200.0, gt=0)
    damping_nm_s_rad: Damping = Field(alias="damping", default=0.01, ge=0)
    noise_nm: Torque = Field(alias="noise", default=0.0, ge=0)
    bias_nm: Torque = Field(alias="bias", default=0.0)
    drift_nm_s: TorqueDrift = Field(alias="drift", default=0.0)
    mounted: Sign = 1
    device: Device = Field(default_factory=dict)


class TransportTruth(Table):
    """How long frames and bytes take between a device and the host: a fixed delay and the spread about it."""

    can_delay_ns: Nanoseconds = Field(alias="can_delay", default=250_000, ge=0)
    can_jitter_ns: Nanoseconds = Field(alias="can_jitter", default=0, ge=0)
    serial_delay_ns: Nanoseconds = Field(alias="serial_delay", default=400_000, ge=0)
    serial_jitter_ns: Nanoseconds = Field(alias="serial_jitter", default=0, ge=0)


# By the name of their model; the first is meant where none is named.
ACTUATORS: Mapping[str, type[Table]] = {
    "dahl_motor": MotorTruth,
    "pneumatic_muscle": PneumaticMuscleTruth,
    "series_elastic": SeriesElasticTruth,
    "gear_train": GearTrainTruth,
    "arm": ArmTruth,
    "variable_stiffness": VariableStiffnessTruth,
}


class Truth(Table):
    """Everything a simulated bench is made of.

    ``load`` is None where nothing is coupled to the actuator, ``modulator`` where that has no second drive.
    """

    seed: int = Field(default=0, ge=0)
    actuator: MotorTruth | Assembled
    load: LoadTruth | None = None
    torque_sensor: TorqueSensorTruth = TorqueSensorTruth()
    modulator: ModulatorTruth | None = None
    transport: TransportTruth = TransportTruth()

    def driven(self, role: str) -> MotorTruth | Assembled | LoadTruth | ModulatorTruth:
        """What the drive in that role drives. Raises ValueError where nothing of it is known."""
        machines = {"actuator": self.actuator, "load": self.load, "modulator": self.modulator}
        machine = machines[role]
        if machine is None:
            raise ValueError(f"a {role} drive without a machine")
        return machine


def read_truth(
    simulated: Mapping[str, Any],
    *,
    seed: int | None,
    place: str,
    command_unit: str = "N*m",
    modulation_unit: str = "N*m/rad",
) -> Truth:
    """The true values written in ``simulated``, the rig file's table of that name; ``seed`` overrides its seed.

    Raises WiringError, one sentence for each mistake with its place (``place`` names the rig file) and the remedy.
    """
    written = {key: value for key, value in simulated.items() if key != FAULTS}
    if seed is not None:
        written["seed"] = seed
    table = _table_for(_model(written, place))
    try:
        return table.model_validate(written, context={"command_unit": command_unit, "modulation_unit": modulation_unit})
    except ValidationError as error:
        raise WiringError("\n".join(complaints(error, table, written, place=place, name="simulated"))) from error


def true_parameters(
    truth: Truth, command_unit: str = "N*m", modulation_unit: str = "N*m/rad"
) -> dict[str, tuple[float, str]]:
    """The actuator's true parameters, ``{name: (value, unit)}``: for the motor under the identifier's names."""
    if not isinstance(truth.actuator, MotorTruth):
        gain = ("amplifier_gain", (truth.actuator.amplifier_gain, f"A/({command_unit})"))
        identified = _named(_of_motor_behind(truth.actuator), command_unit)
        own = dict([*_quantities(truth.actuator), gain, *_of_modulator(truth.modulator, modulation_unit)])
        return {**own, **identified}
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
    if truth.actuator.current_limit_a is not None:
        values["torque_limit"] = motor.Km * truth.actuator.current_limit_a
    values |= _of_departures(truth.actuator, values)
    return {**_named(values, command_unit), **_hanging(truth)}


def _named(values: Mapping[str, float], command_unit: str) -> dict[str, tuple[float, str]]:
    """With the units of the identifier's own tables."""
    table = BY_NAME | TERM_PARAMETERS
    return {name: (value, table[name].unit_for(command_unit)) for name, value in values.items()}


def _of_motor_behind(actuator: Assembled) -> dict[str, float]:
    """Under the identifier's names, a torque motor behind a joint: what its network is with that term. Nothing of an
    actuator whose command is an angle, or whose joint is no spring of the table of terms."""
    if not isinstance(actuator, (GearTrainTruth, SeriesElasticTruth)) or actuator.servo is not None:
        return {}
    motor, joint = actuator.motor, actuator.connection
    values = {
        "torque_gain": motor.torque_constant_nm_a * actuator.amplifier_gain,
        "inertia": motor.inertia_kg_m2,
        "viscous_damping": motor.viscous_damping_nm_s_rad,
        "coulomb_torque": motor.coulomb_torque_nm,
        "presliding_stiffness": motor.presliding_stiffness_nm_rad,
        "presliding_damping": motor.presliding_damping_nm_s_rad,
        "torque_constant": motor.torque_constant_nm_a,
        "joint_stiffness": joint.stiffness_nm_rad,
        "joint_damping": joint.damping_nm_s_rad,
        "output_inertia": actuator.output.inertia_kg_m2,
    }
    if isinstance(actuator, GearTrainTruth):
        values |= {"backlash_width": actuator.backlash.width_rad}
        values |= {"load_friction": actuator.load_friction} if actuator.load_friction else {}
    return values


def _of_departures(actuator: MotorTruth, motor: Mapping[str, float]) -> dict[str, float]:
    """The parameters of the network's terms that its departures are, and those of the ``motor`` that they change.

    What changes with time has the values that it begins with, and no parameters here.
    """
    departures, values = actuator.departures, dict[str, float]()
    if departures is None:
        return values
    if departures.stribeck is not None:
        drop = departures.stribeck.drop * motor["coulomb_torque"]
        values |= {"coulomb_torque": motor["coulomb_torque"] - drop, "stribeck_torque": drop}
        values["stribeck_velocity"] = departures.stribeck.velocity_rad_s
    for name, wave in (("friction", departures.friction_by_position), ("ripple", departures.ripple)):
        if wave is not None:
            values |= {f"{name}_cosine": wave.share, f"{name}_sine": 0.0}
    if departures.saturation is not None:
        share = departures.saturation.share / (1.0 - departures.saturation.share)
        values["gain_saturation"] = share * (motor["amplifier_gain"] / departures.saturation.current_a) ** 2
    for name, value in (
        ("coulomb_asymmetry", departures.asymmetry),
        ("load_friction", departures.load_friction),
        ("quadratic_drag", departures.quadratic_drag_nm_s2_rad2),
    ):
        values |= {name: value} if value else {}
    return values


def _of_modulator(modulator: ModulatorTruth | None, unit: str) -> Iterator[tuple[str, tuple[float, str]]]:
    if modulator is not None:
        yield from _quantities(modulator, "modulator_")
        yield "modulator_amplifier_gain", (modulator.amplifier_gain, f"A/({unit})")
        yield "modulator_travel", (modulator.travel, f"rad/({unit})")


def _hanging(truth: Truth) -> dict[str, tuple[float, str]]:
    """What hangs on either side of the port: m g l of each, where there is any."""
    sides = {"gravity": truth.actuator.gravity if isinstance(truth.actuator, MotorTruth) else None}
    sides["load_gravity"] = truth.load.gravity if truth.load is not None else None
    return {name: (hung.amplitude_nm, "N*m") for name, hung in sides.items() if hung is not None}


def _model(written: Mapping[str, Any], place: str) -> str:
    """The model that the actuator's table names. Raises WiringError for one that is not known."""
    table = written.get("actuator")
    named = table.get("model", "dahl_motor") if isinstance(table, dict) else "dahl_motor"
    if named not in ACTUATORS:
        known = ", ".join(f'"{name}"' for name in ACTUATORS)
        raise WiringError(f"{place}: [simulated.actuator] model = {named!r} is not known; write one of {known}")
    return cast(str, named)


@cache
def _table_for(model: str) -> type[Truth]:
    """The table of a bench with this kind of actuator, so that mistakes are told in its terms."""
    return create_model("Truth", __base__=Truth, actuator=(ACTUATORS[model], ...))


def _quantities(table: Table, before: str = "") -> Iterator[tuple[str, tuple[float, str]]]:
    """Every quantity of a table and of those within it, by the keys they are written under."""
    for name, field in type(table).model_fields.items():
        value, key = getattr(table, name), before + (field.alias or name)
        unit = next((each.text for each in field.metadata if isinstance(each, Unit)), None)
        if isinstance(value, Table):
            yield from _quantities(value, f"{key}_")
        elif unit is not None:
            yield key, (value, unit)
