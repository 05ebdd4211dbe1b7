"""How heavy an actuator without a model is at its port, from the shaking of a calibration."""

from collections.abc import Iterator
from math import sqrt

import numpy as np

from norton_bench.arrays import ComplexArray, FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.at_ticks import readings_at_ticks, sent_at_ticks
from norton_bench.identification.cleaning import clean
from norton_bench.records import Measured, SegmentInfo
from norton_bench.segments import Use

# About where feedback crosses over: what is heavy or light there is so for the loop.
BAND_HZ = 8.0, 40.0
WINDOW_S = 0.5
# An inertia and a spring must explain this share of the impedance's real part: what resonates has no one inertia.
EXPLAINED = 0.8
# The controller allows for 30 %: with a deviation of 15 %, that is two of them.
KNOWN_TO = 0.15
FEWEST_LINES = 5


def apparent_inertia_kgm2(measured: Measured, tick_s: float, torque_late_s: float = 0.0) -> float | None:
    """What torque and acceleration at the port have in common with the load's torque command [kg m²].

    The actuator shakes at the same time, with a command of its own; only what goes with that of the load counts.
    ``torque_late_s`` is how much later the torque is read than the motion. None where the port does not behave like an
    inertia and a spring, and where its inertia shows too little beside the spring.
    """
    cleaned = clean(measured).measured
    size = round(WINDOW_S / tick_s)
    spectra = [
        each
        for segment in cleaned.segments
        if segment.use is Use.CALIBRATE
        for each in _windows(cleaned, segment, size, tick_s)
    ]
    if not spectra:
        return None
    frequency_hz = np.fft.rfftfreq(size, tick_s)
    inside = (frequency_hz >= BAND_HZ[0]) & (frequency_hz <= BAND_HZ[1])
    pushed, angle, torque = (np.stack(each)[:, inside] for each in zip(*spectra, strict=True))
    moved, exerted = (np.sum(np.conj(pushed) * each, axis=0) for each in (angle, torque))
    omega_rad_s: FloatArray = np.asarray(2 * np.pi * frequency_hz[inside], dtype=np.float64)
    return _inertia_kgm2(moved, exerted * np.exp(1j * omega_rad_s * torque_late_s), omega_rad_s)


def _windows(
    measured: Measured, segment: SegmentInfo, size: int, tick_s: float
) -> Iterator[tuple[ComplexArray, ComplexArray, ComplexArray]]:
    """Spectra of the load's command, the angle and the torque, in windows that overlap by half."""
    ticks = round((segment.end_ns - segment.start_ns) * 1e-9 / tick_s)
    try:
        readings = readings_at_ticks(measured, segment, ticks, tick_s)
    except ExperimentError:  # a piece that ended before it began
        return
    if readings.torque_nm is None:
        return
    pushed_nm = sent_at_ticks(measured, segment, "load_torque_nm", ticks, tick_s)
    window = np.hanning(size)
    for first in range(0, ticks - size + 1, size // 2):
        part = slice(first, first + size)
        pushed, angle, torque = (
            np.fft.rfft(window * (values[part] - np.mean(values[part])))
            for values in (pushed_nm, readings.position_rad, readings.torque_nm)
        )
        yield pushed, angle, torque


def _inertia_kgm2(moved: ComplexArray, exerted: ComplexArray, omega_rad_s: FloatArray) -> float | None:
    """By least squares in torque: each frequency counts by how far the port was moved there."""
    weight = np.abs(moved)
    real = -(exerted / moved).real * weight
    if omega_rad_s.size < FEWEST_LINES:
        return None
    columns = np.stack([-(omega_rad_s**2) * weight, weight], axis=1)
    values, *_ = np.linalg.lstsq(columns, real, rcond=None)
    left = float(np.sum((real - columns @ values) ** 2))
    if left > (1.0 - EXPLAINED) * float(np.sum(real**2)):
        return None
    inertia_kgm2 = float(values[0])
    variance = left / (omega_rad_s.size - 2) * float(np.linalg.inv(columns.T @ columns)[0, 0])
    return inertia_kgm2 if sqrt(variance) <= KNOWN_TO * inertia_kgm2 else None
