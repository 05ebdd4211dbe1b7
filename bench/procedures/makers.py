"""The four kinds of segment that procedures are made of."""

import numpy as np

from bench.procedures.waves import Motion
from bench.rig.rig import Rig
from bench.segments import PRESCRIBED_MOTION, ZERO_TORQUE, FloatArray, LoadMode, Segment, Use

UNENDING = float("inf")


def coasting(
    procedure: str, name: str, use: Use, command: FloatArray, *, stop_at_velocity_rad_s: float = UNENDING
) -> Segment:
    """The load coasts, or there is none."""
    return Segment(procedure, name, use, command, stop_at_velocity_rad_s=stop_at_velocity_rad_s)


def pushed(
    procedure: str,
    name: str,
    use: Use,
    load_torque_nm: FloatArray,
    command: FloatArray | None = None,
    *,
    stop_at_velocity_rad_s: float = UNENDING,
) -> Segment:
    """The load follows a torque, the actuator its command (none: zero)."""
    return Segment(
        procedure,
        name,
        use,
        command if command is not None else np.zeros(len(load_torque_nm)),
        LoadMode.TORQUE,
        load_torque_nm=load_torque_nm,
        stop_at_velocity_rad_s=stop_at_velocity_rad_s,
    )


def zero_torque(
    procedure: str,
    name: str,
    use: Use,
    command: FloatArray,
    rig: Rig,
    *,
    stop_at_velocity_rad_s: float = UNENDING,
) -> Segment:
    """Zero torque at the port: imposed by the load drive, or by there being nothing on the shaft."""
    if rig.wiring.load is None:
        return coasting(procedure, name, use, command, stop_at_velocity_rad_s=stop_at_velocity_rad_s)
    return Segment(
        procedure,
        name,
        use,
        command,
        LoadMode.ADMITTANCE,
        ZERO_TORQUE,
        stop_at_velocity_rad_s=stop_at_velocity_rad_s,
    )


def imposed(procedure: str, name: str, use: Use, command: FloatArray, motion: Motion | None = None) -> Segment:
    """Prescribed motion at the port; None holds it still."""
    still = np.zeros(len(command))
    reference = motion if motion is not None else Motion(still, still, still)
    return Segment(
        procedure,
        name,
        use,
        command,
        LoadMode.ADMITTANCE,
        PRESCRIBED_MOTION,
        reference.position_rad,
        reference.velocity_rad_s,
        reference.acceleration_rad_s2,
    )
