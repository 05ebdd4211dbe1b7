"""What the bench has measured of its own load drive and torque sensor: all that the controller is tuned from."""

from dataclasses import dataclass, fields
from math import floor, isfinite

from norton_bench.errors import ExperimentError
from norton_bench.models.network import NortonNetwork

_POSITIVE = (
    "amplifier_bandwidth_rad_s",
    "inertia_kgm2",
    "coulomb_torque_nm",
    "presliding_stiffness_nm_rad",
    "sensor_stiffness_nm_rad",
)


@dataclass(frozen=True)
class ActuatorFriction:
    """The actuator's own friction as far as the calibration tells it (paper, section IV.D)."""

    viscous_damping_nms_rad: float
    coulomb_torque_nm: float
    presliding_stiffness_nm_rad: float
    presliding_damping_nms_rad: float


@dataclass(frozen=True)
class LoadCalibration:
    """The load drive, in the terms of the paper's torque motor (section IV.D), and the sensor in front of it.

    Only relative delays matter to the controller: where no more is known than the time from a command to its effect on
    the torque reading, that time is ``command_delay_s`` and ``measurement_delay_s`` is 0.
    """

    torque_gain: float  # shaft torque per torque commanded
    amplifier_bandwidth_rad_s: float
    inertia_kgm2: float
    viscous_damping_nms_rad: float
    coulomb_torque_nm: float
    presliding_stiffness_nm_rad: float
    presliding_damping_nms_rad: float
    command_delay_s: float  # from sending a command to the amplifier acting on it
    measurement_delay_s: float  # from the torque at the port to its reading's arrival
    sensor_stiffness_nm_rad: float
    sensor_damping_nms_rad: float  # no more than it surely has
    torque_noise_nm: float  # standard deviation of one reading
    torque_bias_nm: float
    position_resolution_rad: float
    motion_delay_s: float | None = None  # from a position to its reading's arrival; None: as the torque's
    actuator_inertia_kgm2: float | None = None  # a first estimate; None: the controller allows for a wide range
    actuator_friction: ActuatorFriction | None = None  # with its inertia; None where either is not well known
    position_jitter_s: float = 0.0  # standard deviation of how long an encoder's reading travels, the greater one's
    weight_nm: float = 0.0  # the greatest torque of an arm that hangs on the load
    # Of the load's parameters, as in NortonNetwork; empty where it is not known.
    covariance_names: tuple[str, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and not isfinite(value):
                raise ExperimentError(f"load calibration: {field.name} is {value}; calibrate the load again")
        for name in _POSITIVE:
            if getattr(self, name) <= 0:
                raise ExperimentError(
                    f"load calibration: {name} is {getattr(self, name):g}, which cannot be; calibrate the load again"
                )
        if self.torque_gain <= 0:
            raise ExperimentError(
                f"load calibration: torque_gain is {self.torque_gain:g}; turn [load] direction in the rig file round, "
                "or check the load's wiring"
            )

    @property
    def network(self) -> NortonNetwork:
        """The load drive as a network of its own: its command is in N m, its port the torque sensor's other side.

        It is the plain motor: the controller's laws are linear beside one friction contact. What the load's fit found
        of terms, cogging above all, is left to the feedback.
        """
        return NortonNetwork(
            torque_gain=self.torque_gain,
            amplifier_bandwidth_rad_s=self.amplifier_bandwidth_rad_s,
            inertia_kgm2=self.inertia_kgm2,
            viscous_damping_nms_rad=self.viscous_damping_nms_rad,
            coulomb_torque_nm=self.coulomb_torque_nm,
            presliding_stiffness_nm_rad=self.presliding_stiffness_nm_rad,
            presliding_damping_nms_rad=self.presliding_damping_nms_rad,
            command_unit="N*m",
            covariance_names=self.covariance_names,
            covariance=self.covariance,
        )

    @property
    def torque_delay_s(self) -> float:
        """From the torque at the port to its reading's arrival, in the controller's frame of time."""
        return self.measurement_delay_s + self.shift_s

    @property
    def position_delay_s(self) -> float:
        """From a position to its reading's arrival, in the controller's frame of time."""
        motion_s = self.measurement_delay_s if self.motion_delay_s is None else self.motion_delay_s
        return motion_s + self.shift_s

    @property
    def drive_delay_s(self) -> float:
        """From a command to its effect, in the controller's frame of time."""
        return max(self.command_delay_s - self.shift_s, 0.0)

    def arrival(self, tick_s: float) -> tuple[int, float]:
        """When a command takes effect: so many ticks after the one at which it was sent, and so long into that [s]."""
        whole = floor(self.drive_delay_s / tick_s)
        return whole, self.drive_delay_s - whole * tick_s

    @property
    def shift_s(self) -> float:
        """By how much the controller's frame of time is ahead: in it no reading comes before what it reads."""
        motion_s = self.measurement_delay_s if self.motion_delay_s is None else self.motion_delay_s
        return max(0.0, -self.measurement_delay_s, -motion_s)
