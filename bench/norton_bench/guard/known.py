"""What the bench has measured of itself, as far as the guard leans on it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Machine:
    """One of the two machines at the port, as it was identified. Torques are at the shaft.

    ``weight_nm`` is the greatest torque of an arm that hangs on it, ``lag_s`` how long a command takes to show in the
    readings: on its way, in the amplifier, and back.
    """

    torque_gain: float  # N m per unit of its command
    inertia_kgm2: float
    viscous_damping_nms_rad: float
    coulomb_torque_nm: float
    weight_nm: float = 0.0
    lag_s: float = 0.0


@dataclass(frozen=True)
class TorqueHabits:
    """How the torque sensor's readings come and differ.

    ``longest_repeat`` counts the readings in a row, at rest, that were the same bit for bit (1: no two were); None
    where the noise is less than half a step of the reading, so that they may stay the same for ever.
    ``greatest_step_nm`` is the greatest difference of neighbours while the bench was shaken; None before it was.
    """

    bias_nm: float
    noise_nm: float
    period_s: float
    longest_repeat: int | None
    greatest_step_nm: float | None = None


@dataclass(frozen=True)
class Known:
    """None stands for what nobody has measured yet, or cannot be on this rig.

    ``moving_command`` is the command at which the free actuator began to turn. Amperes are per unit of the command of
    each drive; of either sign. ``still_swing_nm`` is the greatest swing of the port torque under which the actuator's
    encoder stayed where it was.
    """

    torque: TorqueHabits | None = None
    moving_command: float | None = None
    amperes_per_command: float | None = None
    load_amperes_per_nm: float | None = None
    sensor_stiffness_nm_rad: float | None = None
    still_swing_nm: float | None = None
    actuator: Machine | None = None
    load: Machine | None = None


NOTHING_KNOWN = Known()
