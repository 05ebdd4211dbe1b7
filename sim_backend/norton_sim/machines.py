"""What the machines of a simulated bench are made of: a drive, and a body with its friction."""

from pydantic import Field, ValidationInfo, field_validator, model_validator

from norton_bench.models.parameters import DahlMotor
from norton_bench.units import parse_quantity
from norton_sim.tables import Angle, Current, Damping, Device, Inertia, Rate, Sign, Stiffness, Table, Torque


class Cogging(Table):
    """Torque that goes with the rotor's position: amplitude · sin(periods · θ), opposing the motor's torque."""

    amplitude_nm: Torque = Field(alias="amplitude", ge=0, examples=["0.3 mN*m"])
    periods_per_turn: int = Field(ge=1, examples=[42])


class Gravity(Table):
    """An arm that hangs on the shaft: amplitude · sin(θ − zero), opposing the motor's torque (paper, section III).

    The shaft begins at θ = 0: with another ``zero`` the arm falls from there.
    """

    amplitude_nm: Torque = Field(alias="amplitude", ge=0, examples=["50 mN*m"])
    zero_rad: Angle = Field(alias="zero", default=0.0)


class Drive(Table):
    """Amplifier and encoder of a machine."""

    amplifier_bandwidth_rad_s: Rate = Field(alias="amplifier_bandwidth", gt=0, examples=["600 rad/s"])
    counts_per_turn: int = Field(default=131072, ge=1)
    encoder_bandwidth_rad_s: Rate = Field(alias="encoder_bandwidth", default=1000.0, gt=0, lt=8000)
    current_noise_a: Current = Field(alias="current_noise", default=0.0, ge=0)
    mounted: Sign = 1
    device: Device = Field(default_factory=dict)


class Machine(Drive):
    """What the torque motor and the load machine have in common: drive and body, with friction that never ends."""

    inertia_kg_m2: Inertia = Field(alias="inertia", gt=0, examples=["5e-5 kg*m^2"])
    viscous_damping_nm_s_rad: Damping = Field(alias="viscous_damping", gt=0, examples=["1e-3 N*m*s/rad"])
    coulomb_torque_nm: Torque = Field(alias="coulomb_torque", gt=0, examples=["0.02 N*m"])
    presliding_stiffness_nm_rad: Stiffness = Field(alias="presliding_stiffness", gt=0, examples=["10 N*m/rad"])
    presliding_damping_nm_s_rad: Damping = Field(alias="presliding_damping", default=0.0, ge=0)
    cogging: Cogging | None = None
    gravity: Gravity | None = None

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


class Commanded(Table):
    """``amplifier_gain`` is in amperes per unit of the actuator's command, whatever that unit is."""

    amplifier_gain: float = Field(gt=0, examples=["18 A/(N*m)"])

    @field_validator("amplifier_gain", mode="before")
    @classmethod
    def _per_unit_of_command(cls, text: object, info: ValidationInfo) -> float:
        return parse_quantity(text, f"A/({info.context['command_unit']})" if info.context else "A/(N*m)")


class Body(Table):
    """An inertia that turns, with as much friction as is written, by the equations of the motor's (section IV.D)."""

    inertia_kg_m2: Inertia = Field(alias="inertia", gt=0, examples=["5e-5 kg*m^2"])
    viscous_damping_nm_s_rad: Damping = Field(alias="viscous_damping", default=0.0, ge=0)
    coulomb_torque_nm: Torque = Field(alias="coulomb_torque", default=0.0, ge=0)
    presliding_stiffness_nm_rad: Stiffness = Field(alias="presliding_stiffness", default=0.0, ge=0)
    presliding_damping_nm_s_rad: Damping = Field(alias="presliding_damping", default=0.0, ge=0)
    gravity: Gravity | None = None

    @model_validator(mode="after")
    def _slides_from_somewhere(self) -> "Body":
        if (self.coulomb_torque_nm > 0) != (self.presliding_stiffness_nm_rad > 0):
            raise ValueError(
                "coulomb_torque and presliding_stiffness belong together; "
                'add the other, such as presliding_stiffness = "10 N*m/rad", or leave out both'
            )
        return self
