"""What the session knows, as the loop and the guard need it."""

from norton_bench.control.calibration import LoadCalibration
from norton_bench.guard.model import (
    EMPTY_MODEL,
    GuardModel,
    Machine,
    amperes_per_command,
    still_swing_nm,
    torque_readings,
)
from norton_bench.identification.results import FitResult
from norton_bench.loop.bench_loop import Learned
from norton_bench.procedures.calibrate import known_well_enough
from norton_bench.procedures.knowledge import Knowledge
from norton_bench.records import Measured
from norton_bench.segments import Use


def learned(known: Knowledge) -> Learned:
    """What the loop needs to know."""
    tare, calibration = known.tare, known.calibration
    bias_nm = None if tare is None else tare.torque_bias_nm
    if calibration is not None:
        bias_nm = calibration.torque_bias_nm
    return Learned(guard_model_of(known), bias_nm, calibration)


def guard_model_of(known: Knowledge) -> GuardModel:
    """The guard's model of the bench; empty before the tare."""
    tare, calibration = known.tare, known.calibration
    tared, shaken = _record(known, Use.TARE), _record(known, Use.CALIBRATE)
    if tare is None or tared is None:
        return EMPTY_MODEL
    return GuardModel(
        torque=torque_readings(_stretch(tared, "rest"), shaken),
        moving_command=tare.moving_command,
        amperes_per_command=amperes_per_command(tared.ticks, "command", tared.current),
        load_amperes_per_nm=amperes_per_command(tared.ticks, "load_torque_nm", tared.load_current),
        sensor_stiffness_nm_rad=None if calibration is None else calibration.sensor_stiffness_nm_rad,
        still_swing_nm=None if shaken is None else max(still_swing_nm(tared), still_swing_nm(shaken)),
        actuator=_actuator(known.actuator),
        load=None if calibration is None else _load(calibration),
    )


def _record(known: Knowledge, use: Use) -> Measured | None:
    """The last procedure's that measured for ``use``."""
    found = (record for record in reversed(known.records) if any(segment.use is use for segment in record.segments))
    return next(found, None)


def _stretch(record: Measured, name: str) -> Measured:
    segment = next(segment for segment in record.segments if segment.name == name)
    return record.between(segment.start_ns, segment.end_ns)


def _load(calibration: LoadCalibration) -> Machine:
    return Machine(
        calibration.torque_gain,
        calibration.inertia_kgm2,
        calibration.viscous_damping_nms_rad,
        calibration.coulomb_torque_nm,
        calibration.weight_nm,
        _lag_s(calibration.command_delay_s, calibration.motion_delay_s or 0.0, calibration.amplifier_bandwidth_rad_s),
    )


def _actuator(fit: FitResult | None) -> Machine | None:
    """None where the fit does not know the terms of the actuator's torque balance well enough."""
    if fit is None or not known_well_enough(fit):
        return None
    network = fit.network
    return Machine(
        network.torque_gain,
        network.inertia_kgm2,
        network.viscous_damping_nms_rad,
        network.coulomb_torque_nm,
        lag_s=_lag_s(fit.command_delay_s, fit.motion_delay_s, network.amplifier_bandwidth_rad_s),
    )


def _lag_s(command_delay_s: float, motion_delay_s: float, bandwidth_rad_s: float) -> float:
    """From a command to the readings. Delays count from the torque reading; torque and motion are taken half way."""
    return max(command_delay_s + 0.5 * motion_delay_s + 1.0 / bandwidth_rad_s, 0.0)
