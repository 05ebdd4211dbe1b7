"""Zero torque, seen coming: the motion source predicted from the network identified so far, as a segment's reference.

The load then follows the free motion by feed-forward, and feedback of the torque closes what the prediction misses. A
prediction drifts in position, which does no harm: under zero torque only its velocity and acceleration are used.
"""

from dataclasses import replace

import numpy as np

from bench.control.calibration import LoadCalibration
from bench.models.network import NortonNetwork
from bench.segments import ZERO_TORQUE, FloatArray, LoadMode, Segment

# Predicted while the drives are enabled and wait: coarse steps, for the network is known to a per cent at most.
LONGEST_STEP_S = 5e-4
# Relative standard deviation of a network whose prediction is nearer to the truth than noisy feedback would bring it.
TRUSTED = 0.01


def with_preview(
    segment: Segment,
    network: NortonNetwork,
    calibration: LoadCalibration,
    command_delay_s: float,
    tick_s: float,
    *,
    velocity_rad_s: float = 0.0,
    command: float = 0.0,
) -> Segment:
    """``segment`` with the predicted free motion as its reference, or as it was where it does not impose zero torque.

    ``command_delay_s`` is from sending the actuator's command to its acting, counted as the calibration counts the
    load's; ``velocity_rad_s`` and ``command`` are the shaft's velocity and the command at the start, which the shaft is
    taken to have settled at. The controller itself looks ahead by what the load needs.
    """
    if segment.mode is not LoadMode.ADMITTANCE or segment.admittance != ZERO_TORQUE:
        return segment
    delay_s = command_delay_s - calibration.shift_s
    motor_nm, coulomb_nm = network.torque_gain * command, network.coulomb_torque_nm
    left_nm = motor_nm - network.viscous_damping_nms_rad * velocity_rad_s
    position, velocity, acceleration = network.free_motion(
        segment.command,
        tick_s,
        velocity_rad_s=velocity_rad_s,
        motor_torque_nm=motor_nm,
        longest_step_s=LONGEST_STEP_S,
        friction_torque_nm=min(max(left_nm, -coulomb_nm), coulomb_nm),
    )
    return replace(
        segment,
        position_rad=delayed(position, tick_s, delay_s),
        velocity_rad_s=delayed(velocity, tick_s, delay_s),
        acceleration_rad_s2=delayed(acceleration, tick_s, delay_s),
        preview=True,
        trusted=trusted(network),
    )


def foreseeing(first: NortonNetwork, live: NortonNetwork | None, *, knows_friction: bool) -> NortonNetwork | None:
    """The network to foresee the free motion by: the calibration's where it is trusted, else the live one, if any.

    Feedback that knows the actuator's friction leaves less than a network that is not trusted.
    """
    network = first if trusted(first) else live
    return None if network is None or (knows_friction and not trusted(network)) else network


def trusted(network: NortonNetwork) -> bool:
    """Whether what moves the shaft is known to TRUSTED, by the network's own deviations."""
    if not network.covariance_names:
        return False
    deviations = dict(zip(network.covariance_names, np.sqrt(np.diag(network.covariance)), strict=True))
    values = {
        "torque_gain": network.torque_gain,
        "inertia": network.inertia_kgm2,
        "viscous_damping": network.viscous_damping_nms_rad,
        "coulomb_torque": network.coulomb_torque_nm,
    }
    return all(name in deviations and deviations[name] <= TRUSTED * abs(value) for name, value in values.items())


def delayed(values: FloatArray, tick_s: float, delay_s: float) -> FloatArray:
    """``values`` (ticks,) as they are ``delay_s`` later; before the first, the first."""
    ticks = np.arange(len(values))
    return np.asarray(np.interp(ticks - delay_s / tick_s, ticks, values), dtype=np.float64)
