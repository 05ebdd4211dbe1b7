"""Zero torque with preview: the free motion is predicted from the network identified so far, as a segment's reference.

The load then follows the free motion by feed-forward, and feedback of the torque closes what the prediction misses. A
prediction drifts in position: under zero torque only its velocity and acceleration are used. Terms that depend on the
position (cogging, ripple, friction by position) begin at the shaft's true place, and are foreseen as long as the drift
leaves them in phase.
"""

from dataclasses import replace

import numpy as np
from numba import njit

from norton_bench.arrays import FloatArray
from norton_bench.control.calibration import LoadCalibration
from norton_bench.models.network import NortonNetwork
from norton_bench.models.sliding import damping_nm, held_nm, left_of, resistance_nm
from norton_bench.segments import ZERO_TORQUE, LoadMode, Segment

# Predicted while the drives are enabled and wait: coarse steps, for the network is known to a per cent at most.
LONGEST_STEP_S = 5e-4
# Relative standard deviation of a network whose prediction is nearer to the truth than noisy feedback would bring it.
TRUSTED = 0.01
# What moves the shaft once it slides.
MOVES = ("torque_gain", "inertia", "viscous_damping", "coulomb_torque")
_Start = dict[str, float]
# Rates at which feedback may mend what a trusted prediction leaves: from an error that hardly changes within a segment
# to what a delay of a few milliseconds lets through no more.
RATES_RAD_S = np.geomspace(0.1, 300.0, 36)


def with_preview(
    segment: Segment,
    network: NortonNetwork,
    calibration: LoadCalibration,
    command_delay_s: float,
    tick_s: float,
    *,
    position_rad: float = 0.0,
    velocity_rad_s: float = 0.0,
    command: float = 0.0,
) -> Segment:
    """``segment`` with the predicted free motion as its reference, or as it was where it does not impose zero torque.

    ``command_delay_s`` is from sending the actuator's command to its acting, counted as the calibration counts the
    load's; ``position_rad``, ``velocity_rad_s`` and ``command`` are the shaft's position and velocity, as its encoder
    has them, and the command at the start, which the shaft is taken to have settled at. The controller itself looks
    ahead by what the load needs.
    """
    if segment.mode is not LoadMode.ADMITTANCE or segment.admittance != ZERO_TORQUE:
        return segment
    delay_s = command_delay_s - calibration.shift_s
    start = _start(network, tick_s, position_rad, velocity_rad_s, command)
    foreseen = network.free_motion(segment.command, tick_s, longest_step_s=LONGEST_STEP_S, **start)
    kept = in_phase(network, float(np.abs(foreseen[0] - position_rad).max()))
    if kept != network:
        foreseen = kept.free_motion(segment.command, tick_s, longest_step_s=LONGEST_STEP_S, **start)
    position, velocity, acceleration = foreseen
    slows = trusted(network) and not holds(segment.command)
    return replace(
        segment,
        position_rad=delayed(position - position_rad, tick_s, delay_s),
        velocity_rad_s=delayed(velocity, tick_s, delay_s),
        acceleration_rad_s2=delayed(acceleration, tick_s, delay_s),
        preview=True,
        mends_rad_s=_mending(network, calibration, velocity, acceleration, tick_s) if slows else None,
    )


def _start(network: NortonNetwork, tick_s: float, position_rad: float, velocity_rad_s: float, command: float) -> _Start:
    """The state to begin at: friction holds what the motor exerts beyond the damping, as far as it can."""
    of_angle = 0.0 if network.servo is None else network.servo.of_angle
    left = float(left_of(network, command - of_angle * position_rad, velocity_rad_s))
    motor_nm = network.torque_gain * left
    exerted = network.rigid.torque(np.full(3, command), np.full(3, position_rad), tick_s, motor_torque_nm=motor_nm)[0]
    least, most = -held_nm(network, -1.0), held_nm(network, 1.0)
    return {
        "position_rad": position_rad,
        "velocity_rad_s": velocity_rad_s,
        "motor_torque_nm": motor_nm,
        "friction_torque_nm": min(max(float(exerted - damping_nm(network, velocity_rad_s)), least), most),
    }


def in_phase(network: NortonNetwork, travel_rad: float) -> NortonNetwork:
    """The network without the terms that a prediction over ``travel_rad`` has at the wrong places.

    A network that is off by TRUSTED drifts by that share of the travel. A wave of p periods a turn is then foreseen by
    p times as much out of phase; beyond π/3 a sine is better left out, for its difference from itself is greater.
    """
    drift_rad = TRUSTED * travel_rad
    return replace(
        network, terms=tuple(term for term in network.terms if term.periods_per_turn * drift_rad < np.pi / 3.0)
    )


def holds(command: FloatArray) -> bool:
    """Whether a command (ticks,) stands still most of the time.

    Its mean torque over each level is then what counts, to which the noise of quick feedback adds nothing, for the
    integral makes the mean of the readings zero; slow feedback would leave in it what the steps between them left.
    """
    return bool(2 * np.count_nonzero(np.diff(command)) < len(command))


def _mending(
    network: NortonNetwork,
    calibration: LoadCalibration,
    velocity_rad_s: FloatArray,
    acceleration_rad_s2: FloatArray,
    tick_s: float,
) -> float:
    error_nm = expected_error_nm(network, calibration.network, velocity_rad_s, acceleration_rad_s2)
    return mending_rad_s(error_nm, calibration.torque_noise_nm, tick_s)


def mending_rad_s(error_nm: FloatArray, noise_nm: float, tick_s: float) -> float:
    """How quickly feedback should mend a port torque whose deviation is expected to be ``error_nm`` (ticks,).

    An integral at the rate ω leaves of it what a high-pass at ω leaves, and brings in the sensor's noise σ,
    ``noise_nm`` a reading, by σ² ω T / 2 in the mean square: the rate is the one with the least sum. It is at least so
    great that a standing error, decaying at ω, leaves no more in the mean of the whole segment of length L than the
    noise of its readings, σ √(T / L), would hide.
    """
    noise_nm, lasts_s = max(noise_nm, 1e-9), len(error_nm) * tick_s
    least = float(np.sqrt(np.mean(error_nm**2))) / (noise_nm * np.sqrt(tick_s * lasts_s))
    left = [_left_nm2(error_nm, rate, noise_nm, tick_s) for rate in RATES_RAD_S]
    return float(max(RATES_RAD_S[int(np.argmin(left))], least))


def expected_error_nm(
    actuator: NortonNetwork, load: NortonNetwork, velocity_rad_s: FloatArray, acceleration_rad_s2: FloatArray
) -> FloatArray:
    """Deviation of the port torque (ticks,) that is left where the load is led along this motion, by what is not known
    of either network: the torque that each misses of its own equation. A contact at rest may hold all that it can.

    It is given the sign of the velocity, as friction, the greatest part of it, turns round with that. What is not known
    of the terms is not in it: each is small beside the parameter that it changes.
    """
    side = np.where(velocity_rad_s < 0.0, -1.0, 1.0)
    variance = np.zeros(len(side))
    for network in (actuator, load):
        motion = np.stack([acceleration_rad_s2, velocity_rad_s, side])
        # What moves it freely is what its inertia and its friction take.
        friction = np.where(velocity_rad_s == 0.0, network.coulomb_torque_nm, resistance_nm(network, velocity_rad_s))
        drive = network.rigid.inertia_kgm2 * acceleration_rad_s2 + friction
        columns = np.concatenate([[drive / network.torque_gain], -motion])
        variance += np.einsum("it,ij,jt->t", columns, _covariance(network), columns)
    return np.asarray(side * np.sqrt(np.maximum(variance, 0.0)))


def _covariance(network: NortonNetwork) -> FloatArray:
    """Of MOVES, shape (4, 4); zero where the network does not say."""
    if not set(MOVES) <= set(network.covariance_names):
        return np.zeros((len(MOVES), len(MOVES)))
    places = [network.covariance_names.index(name) for name in MOVES]
    return np.asarray(network.covariance, dtype=np.float64)[np.ix_(places, places)]


def _left_nm2(error_nm: FloatArray, rate_rad_s: float, noise_nm: float, tick_s: float) -> float:
    """The mean square at the port: of the error beyond the integral's reach, and of the noise that it brings in."""
    stays = np.exp(-rate_rad_s * tick_s)
    return float(np.mean(high_passed(error_nm, stays) ** 2)) + 0.5 * noise_nm**2 * rate_rad_s * tick_s


@njit(cache=True, nogil=True)
def high_passed(values: FloatArray, stays: float) -> FloatArray:
    """The changes of ``values`` (ticks,), of which the share ``stays`` is left after every tick."""
    high = np.empty_like(values)
    left = 0.0
    for tick in range(len(values)):
        high[tick] = left + values[tick]
        left = stays * high[tick] - values[tick]
    return high


def foreseeing(first: NortonNetwork, live: NortonNetwork | None, *, knows_friction: bool) -> NortonNetwork | None:
    """The network to foresee the free motion by: the calibration's where it is trusted, else the live one, if any.

    Feedback that knows the actuator's friction leaves less than a network that is not trusted.
    """
    network = first if trusted(first) else live
    return None if network is None or (knows_friction and not trusted(network)) else network.dissipative()


def trusted(network: NortonNetwork) -> bool:
    """Whether what moves the shaft is known to TRUSTED, by the network's own deviations."""
    if not network.covariance_names:
        return False
    deviations = dict(zip(network.covariance_names, np.sqrt(np.diag(network.covariance)), strict=True))
    values = (
        network.torque_gain,
        network.inertia_kgm2,
        network.viscous_damping_nms_rad,
        network.coulomb_torque_nm,
    )
    return all(
        name in deviations and deviations[name] <= TRUSTED * abs(value)
        for name, value in zip(MOVES, values, strict=True)
    )


def delayed(values: FloatArray, tick_s: float, delay_s: float) -> FloatArray:
    """``values`` (ticks,) as they are ``delay_s`` later; before the first, the first."""
    ticks = np.arange(len(values))
    return np.asarray(np.interp(ticks - delay_s / tick_s, ticks, values), dtype=np.float64)
