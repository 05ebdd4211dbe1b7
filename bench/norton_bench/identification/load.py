"""The load drive, fitted as one fits an actuator: the torque sensor is the port of both.

Its command is the load's torque command, its motion the load's, and the torque that it exerts on its side of the port
is the opposite of what the sensor reads. With both encoders the sensor itself is a spring whose twist is measured.
"""

from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.distributions import normal_hazard
from norton_bench.errors import ExperimentError
from norton_bench.identification.cleaning import NOTHING_FOUND, Findings, clean
from norton_bench.identification.counts import resolution_of
from norton_bench.identification.coupling import Coupling
from norton_bench.identification.fit import fit_signals
from norton_bench.identification.kernels import FULL_BAND
from norton_bench.identification.regression import Regression
from norton_bench.identification.results import FitResult
from norton_bench.identification.rows import Rows
from norton_bench.identification.sanity_checks import LEFT_BY_A_GOOD_FIT
from norton_bench.identification.separable import normal_solution
from norton_bench.identification.shape import STILL
from norton_bench.identification.signals import Port, Signals, sent_at_s, signals, travel_times_s
from norton_bench.identification.statistics import sandwich
from norton_bench.records import Measured
from norton_bench.segments import Use

LOAD_COMMAND_UNIT = "N*m"
DELAY_STEPS = 8
# An arm's weight goes with the position, once a turn. It is looked for where a motor leaves more than
# it should, and believed where it leaves less than this share of that.
GRAVITY = 1.0
WORTHWHILE = 0.8


@dataclass(frozen=True)
class LoadFit:
    """The load's network and the torque sensor, as the controller's calibration needs them.

    ``weight_nm`` is the greatest torque of an arm that was found to hang on the load, 0 where there is none. Its weight
    over a few degrees and the sensor's zero look alike: then ``torque_bias_nm`` is not to be relied on.
    """

    result: FitResult
    sensor_stiffness_nm_rad: float
    sensor_stiffness_std_nm_rad: float
    sensor_damping_nms_rad: float
    sensor_damping_std_nms_rad: float
    torque_bias_nm: float
    position_resolution_rad: float
    position_jitter_s: float
    weight_nm: float = 0.0


def fit_load(measured: Measured, tick_s: float, use: Use = Use.CALIBRATE) -> LoadFit:
    """Fit the load to every segment meant for ``use``. Raises ExperimentError where there is nothing to fit."""
    cleaned = clean(measured)
    measured = cleaned.measured
    load, actuator = _of_both(measured, tick_s, use)
    result = fit_machine(load, cleaned.findings)
    spring = _spring(load, actuator, result.motion_delay_s, result.motion_delay_std_s)
    # Of the coarser: a controller must not take the other's steps for a twist.
    both = measured.load_motion, measured.motion
    step_rad = max(resolution_of(table["position_rad"]).width for table in both)
    jitter_s = max(float(np.std(travel_times_s(table))) for table in both)
    return LoadFit(result, *spring, -result.torque_bias_nm, step_rad, jitter_s, weight_of(result))


def _of_both(measured: Measured, tick_s: float, use: Use) -> tuple[tuple[Signals, ...], tuple[Signals, ...]]:
    """The stretches of load and actuator, pair by pair. Raises ExperimentError where they have none in common."""
    load, actuator = (
        {stretch.time_s[0]: stretch for stretch in signals(measured, tick_s, use, port, of_both=True)}
        for port in (Port.LOAD, Port.ACTUATOR)
    )
    common = sorted(load.keys() & actuator.keys())
    if not common:
        raise ExperimentError(
            "the readings of both drives were never there for long at the same time: check both, repeat the calibration"
        )
    return tuple(load[start_s] for start_s in common), tuple(actuator[start_s] for start_s in common)


def coupling_of(measured: Measured, tick_s: float) -> Coupling | None:
    """What the calibration tells of the spring between the two motors; None where it was not measured."""
    if not len(measured.load_motion) or all(segment.use is not Use.CALIBRATE for segment in measured.segments):
        return None
    try:
        fit = fit_load(measured, tick_s)
    except ExperimentError:
        return None
    load, ticks = fit.result.network, measured.ticks
    if not fit.result.converged or min(fit.sensor_stiffness_nm_rad, load.inertia_kgm2) <= 0.0:
        return None
    return Coupling(
        stiffness_nm_rad=fit.sensor_stiffness_nm_rad,
        stiffness_std_nm_rad=fit.sensor_stiffness_std_nm_rad,
        damping_nms_rad=fit.sensor_damping_nms_rad,
        damping_std_nms_rad=fit.sensor_damping_std_nms_rad,
        load_inertia_kgm2=load.inertia_kgm2,
        load_gain=load.torque_gain,
        load_bandwidth_rad_s=load.amplifier_bandwidth_rad_s,
        load_delay_s=fit.result.command_delay_s,
        sent_s=sent_at_s(ticks, int(ticks["tick_ns"][0])),
        command_nm=np.ascontiguousarray(ticks["load_torque_nm"]),
        load_released_at_zero=Port.LOAD.value in measured.chain.released_at_zero,
    )


def fit_machine(load: tuple[Signals, ...], findings: Findings = NOTHING_FOUND) -> FitResult:
    """As a motor; and as a motor on which an arm hangs, where that explains what is left.

    Raises ExperimentError where neither tells the load's own values.
    """
    try:
        result = fit_signals(load, command_unit=LOAD_COMMAND_UNIT, port=Port.LOAD, findings=findings)
    except ExperimentError:
        hanging = _hanging(load, findings)
        if hanging is None or hanging.torque_relative > LEFT_BY_A_GOOD_FIT:
            raise
        return hanging
    if result.converged and result.torque_relative < LEFT_BY_A_GOOD_FIT:
        return result
    hanging = _hanging(load, findings)
    return hanging if hanging is not None and hanging.torque_rms_nm < WORTHWHILE * result.torque_rms_nm else result


def weight_of(result: FitResult) -> float:
    """What an arm's weight gives at most, in the unit of the fit's torque; 0 where none was found to hang there."""
    return sum(wave.amplitude_nm for wave in result.cogging if wave.periods_per_turn == GRAVITY)


def _hanging(load: tuple[Signals, ...], findings: Findings) -> FitResult | None:
    """As a motor with an arm; None where nothing is left to tell a scale by, or nothing fits."""
    try:
        result = fit_signals(
            load, command_unit=LOAD_COMMAND_UNIT, port=Port.LOAD, findings=findings, cogging=(GRAVITY,)
        )
    except ExperimentError:
        return None
    return result if result.converged else None


def _spring(
    load: tuple[Signals, ...], actuator: tuple[Signals, ...], load_delay_s: float, load_delay_std_s: float
) -> tuple[float, float, float, float]:
    """Stiffness and its deviation, damping and its deviation, from twist against torque.

    The twist is a few counts, so it is the noisy one, and is explained by the torque rather than the other way: it
    follows the torque over the stiffness, later by damping over stiffness (far below the rates at which that is a lag).
    An error of the load's delay looks the same. The actuator's encoder has a delay of its own: by how much its motion
    is to be moved is one more linear unknown, solved for again and again.
    """
    regression = Regression.of(actuator, FULL_BAND)
    torque, time_s = regression.target(), regression.time_s()
    rate = regression.chosen([rows.torque_derivatives((1,))[0] for rows in regression.rows])
    # What the torque's noise adds to the squares of its columns.
    noise = np.array([sum(rows.usable.size * rows.torque_noise(each) for rows in regression.rows) for each in (0, 1)])
    delay_s = load_delay_s
    for _ in range(DELAY_STEPS):
        parts = [_twist(a, b, load_delay_s, delay_s) for a, b in zip(actuator, load, strict=True)]
        twist, velocity = np.concatenate(parts, axis=1)
        # Each stretch counts its twist from its own beginning.
        begins = np.repeat(np.eye(len(parts)), [part.shape[1] for part in parts], axis=1)
        columns = np.stack([torque, -rate, -velocity, *begins])
        solution = normal_solution(columns, columns @ twist, noise)
        compliance, later_rad_s_nm, shift_s = solution[:3]
        delay_s += float(np.clip(shift_s, -5e-4, 5e-4))
    covariance = sandwich(columns.T, twist - solution @ columns, time_s)
    compliance, uncertain = above_zero(float(compliance), float(np.sqrt(covariance[0, 0])))
    stiffness = 1.0 / compliance
    damping = float(later_rad_s_nm) * stiffness**2
    damping_std = np.hypot(np.sqrt(covariance[1, 1]) * stiffness**2, load_delay_std_s * stiffness)
    return stiffness, uncertain * stiffness**2, damping, float(damping_std)


def above_zero(value: float, std: float) -> tuple[float, float]:
    """Mean and deviation of what was found to be ``value`` with ``std``, and is known to be above zero.

    A normal distribution cut off at zero. It changes nothing that is told; where counts are too coarse for the twist of
    a stiff sensor, it is what may be believed of its compliance.
    """
    below = -value / std
    hazard = normal_hazard(below)
    return value + std * hazard, std * float(np.sqrt(max(1.0 + below * hazard - hazard**2, 0.0)))


def _twist(actuator: Signals, load: Signals, load_delay_s: float, actuator_delay_s: float) -> FloatArray:
    """Twist and the actuator's velocity, filtered, where the actuator is usable: shape (2, samples)."""
    first, second = Rows(actuator, FULL_BAND), Rows(load, FULL_BAND)
    a = first.position(replace(STILL, motion_delay_s=actuator_delay_s))
    b = second.position(replace(STILL, motion_delay_s=load_delay_s))
    number = np.round((actuator.time_s - load.time_s[0]) / load.tick_s).astype(np.int64)
    twist = a[0] - b[0, np.clip(number, 0, load.time_s.size - 1)]
    usable = first.usable
    return np.stack([twist - twist[usable][0], a[1]])[:, usable]
