"""The four kinds of segment that procedures are made of."""

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.procedures.waves import Motion, hold, ramp
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import PRESCRIBED_MOTION, ZERO_TORQUE, LoadMode, Segment, Use

UNENDING = float("inf")
SLOWLY = 3.0  # times as long as the rest that follows


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


def back(procedure: str, name: str, rig: Rig, before: Measured, duration_s: float) -> Segment:
    """Both drives go from where they were to zero, and rest for ``duration_s``.

    At once for a motor, which coasts then; slowly otherwise: an actuator without a model may be a spring, or a
    pendulum, or go where it is told.
    """
    if rig.modelled or not len(before.ticks):
        return coasting(procedure, name, Use.PREPARE, hold(0.0, duration_s, rig.tick_s))
    last = before.ticks[-1]
    still = hold(0.0, duration_s, rig.tick_s)
    load_nm, command = (
        np.concatenate([ramp(float(last[column]), 0.0, SLOWLY * duration_s, rig.tick_s), still])
        for column in ("load_torque_nm", "command")
    )
    if rig.wiring.load is None:
        return coasting(procedure, name, Use.PREPARE, command)
    return pushed(procedure, name, Use.PREPARE, load_nm, command)


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
