"""The law that the load really rendered: mass, damping and stiffness of the port, from torque and motion alone.

    M dv/dt + B v + K (x − x_ref) = τ_port

Nothing that was measured is differentiated: both sides are multiplied by functions that are zero at both ends of a
window, and integrated by parts, so that the derivatives stand at the functions (Shinbrot, "On the analysis of linear
and nonlinear systems", Trans. ASME 79, 1957).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import nan

import numpy as np
import numpy.typing as npt
from scipy.stats import t as student

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.at_ticks import TAUGHT_HZ, in_band, readings_at_ticks
from norton_bench.identification.load import fit_load
from norton_bench.records import Measured, SegmentInfo
from norton_bench.segments import LAW_UNITS, RENDER, Admittance

WALL_UNIT = "rad"
# Windows of so long, which overlap by half, and in each one function for every second multiple of 1 / WINDOW_S: the
# functions of a window, sin⁴ of its phase, are as wide as that.
WINDOW_S = 0.5
# Windows so near share readings, or friction that stood in both: their errors count as dependent (Newey and West 1987).
DEPENDENT_WINDOWS = 2
# Below that there are too few windows to know a deviation by.
LEAST_S = 3.0
UNKNOWN = 4  # mass, damping and stiffness, and the torque's zero with the place of the spring's
Triple = tuple[float, float, float]

Complex = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class Rendered:
    """The law of one step as it was ``asked`` for and as it was measured.

    ``measured`` and ``half`` (3,) are mass [kg m²], damping [N m s/rad] and stiffness [N m/rad], and half their 95 %
    intervals. ``torque_nm`` is the port's torque below TAUGHT_HZ, rms; ``off_nm`` what of it the law asked for does not
    explain, ``left_nm`` what the measured one does not. Where nothing could be measured all are NaN, and
    ``shortcoming`` says why.
    """

    asked: Admittance
    measured: Triple = (nan, nan, nan)
    half: Triple = (nan, nan, nan)
    torque_nm: float = nan
    off_nm: float = nan
    left_nm: float = nan
    shortcoming: str = ""


def name_of(law: Admittance) -> str:
    """What a segment is called in which this law is rendered: mass, damping and stiffness, and the angle of a wall."""
    parts = [f"{value!r} {unit}" for value, unit in zip(law.values, LAW_UNITS.values(), strict=True)]
    return ", ".join(parts if law.wall_rad is None else [*parts, f"{law.wall_rad!r} {WALL_UNIT}"])


def law_of(segment: SegmentInfo) -> Admittance | None:
    """The law by a segment's name; None where it renders none."""
    parts = [part.split(" ") for part in segment.name.split(", ")]
    units, law = [part[-1] for part in parts], list(LAW_UNITS.values())
    if segment.procedure != RENDER or units not in (law, [*law, WALL_UNIT]):
        return None
    values = [float(part[0]) for part in parts]
    return Admittance.of(values[: len(law)], *values[len(law) :])


def rendered(measured: Measured, tick_s: float) -> tuple[Rendered, ...]:
    """The law of each segment in which one was rendered."""
    chosen = [(segment, law) for segment in measured.segments if (law := law_of(segment)) is not None]
    if not chosen:
        return ()
    try:
        # As late as the torque is read after the load's motion: that much late, damping would pass for mass.
        late_s = -fit_load(measured, tick_s).result.motion_delay_s
    except ExperimentError as error:
        return tuple(Rendered(law, shortcoming=f"the calibration tells no delays: {error}") for _, law in chosen)
    return tuple(_of_segment(measured, segment, law, late_s, tick_s) for segment, law in chosen)


def _of_segment(measured: Measured, segment: SegmentInfo, asked: Admittance, late_s: float, tick_s: float) -> Rendered:
    ticks = round((segment.end_ns - segment.start_ns) * 1e-9 / tick_s)
    if ticks * tick_s < LEAST_S:
        return Rendered(asked, shortcoming=f"the law acted for {ticks * tick_s:.1f} s, and {LEAST_S:g} s are needed")
    try:
        readings = readings_at_ticks(measured, segment, ticks, tick_s)
    except ExperimentError as error:
        return Rendered(asked, shortcoming=str(error))
    if readings.torque_nm is None:
        return Rendered(asked, shortcoming="no torque was read")
    turned_rad = readings.load_position_rad - _reference_rad(measured, segment)
    sprung_rad = asked.deflection_rad(turned_rad)
    if asked.stiffness_nm_rad and not sprung_rad.any():
        return Rendered(asked, shortcoming="the shaft did not come to the wall")
    columns, torque = _integrals(turned_rad, sprung_rad, readings.torque_nm, late_s, tick_s)
    values, half = _solved(columns, torque)
    torque_nm = float(np.sqrt(np.mean(in_band(readings.torque_nm - np.mean(readings.torque_nm), tick_s) ** 2)))
    law = _triple(values)
    off_nm, left_nm = (torque_nm * _share_left(columns, torque, each) for each in (asked.values, law))
    return Rendered(asked, law, _triple(half), torque_nm, off_nm, left_nm)


def _reference_rad(measured: Measured, segment: SegmentInfo) -> float:
    """From where the law's spring is stretched."""
    ticks = measured.between(segment.start_ns, segment.end_ns).ticks
    return float(ticks["reference_position_rad"][0])


def _triple(values: FloatArray) -> Triple:
    mass, damping, stiffness = values[:3].tolist()
    return mass, damping, stiffness


def _share_left(columns: FloatArray, torque: FloatArray, law: Triple) -> float:
    """The share of the torque, rms, that a law does not explain, whatever the sensor's zero is."""
    constant, rest = columns[..., -1], torque - columns[..., :-1] @ np.array(law)
    rest = rest - constant * np.sum(constant * rest) / np.sum(constant**2)
    power = float(np.sum(torque**2))
    return float(np.sqrt(np.sum(rest**2) / power)) if power > 0.0 else 0.0


def _integrals(
    turned_rad: FloatArray, sprung_rad: FloatArray, torque_nm: FloatArray, late_s: float, tick_s: float
) -> tuple[FloatArray, FloatArray]:
    """The equation's columns (windows, rows, UNKNOWN) and its right side (windows, rows), real and imaginary parts."""
    length = round(WINDOW_S / tick_s)
    windows = [
        np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2]
        for values in (each - np.mean(each) for each in (turned_rad, sprung_rad, torque_nm))
    ]
    columns, right = [], []
    turned, sprung, torque = windows
    for (function, slope, curvature), (later, *_) in zip(
        _functions(length, 0.0, tick_s), _functions(length, late_s, tick_s), strict=True
    ):
        ones = np.full(len(turned), np.sum(later))
        columns.append(np.stack([turned @ curvature, -(turned @ slope), sprung @ function, ones], axis=-1))
        right.append(torque @ later)
    rows, sides = np.stack(columns, axis=1), np.stack(right, axis=1)
    return np.concatenate([rows.real, rows.imag], axis=1), np.concatenate([sides.real, sides.imag], axis=1)


def _functions(length: int, late_s: float, tick_s: float) -> Iterator[tuple[Complex, Complex, Complex]]:
    """Functions that are zero, with three derivatives, at both ends of a window, ``late_s`` later; with their first two
    derivatives."""
    time_s = tick_s * (np.arange(length) + 0.5) - late_s
    span_s = tick_s * length
    # sin⁴ as its Fourier series
    phase = 2 * np.pi * time_s / span_s
    rate = 2 * np.pi / span_s
    window = (3 - 4 * np.cos(phase) + np.cos(2 * phase)) / 8
    slope = rate * (4 * np.sin(phase) - 2 * np.sin(2 * phase)) / 8
    curvature = rate**2 * (4 * np.cos(phase) - 4 * np.cos(2 * phase)) / 8
    for hertz in np.arange(0.0, TAUGHT_HZ, 2.0 / span_s):
        omega = 2j * np.pi * hertz
        wave = np.exp(omega * time_s)
        yield window * wave, (slope + omega * window) * wave, (curvature + 2 * omega * slope + omega**2 * window) * wave


def _solved(columns: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least squares, and half the 95 % intervals from what is left, window by window."""
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=(0, 1))), 1e-300)
    scaled = columns / scale
    normal = np.einsum("wri,wrj->ij", scaled, scaled)
    values = np.linalg.lstsq(normal, np.einsum("wri,wr->i", scaled, right), rcond=None)[0]
    scores = np.einsum("wri,wr->wi", scaled, right - scaled @ values)
    meat = scores.T @ scores
    for apart in range(1, DEPENDENT_WINDOWS + 1):
        both = scores[apart:].T @ scores[:-apart]
        meat += (1 - apart / (DEPENDENT_WINDOWS + 1)) * (both + both.T)
    inverse = np.linalg.pinv(normal)
    # Neighbours overlap by half: there are as many independent windows as fit beside each other.
    independent = 0.5 * len(scores)
    freedom = max(independent - UNKNOWN, 1.0)
    variance = np.maximum(np.diag(inverse @ meat @ inverse), 0.0) * independent / freedom
    return values / scale, float(student.ppf(0.975, freedom)) * np.sqrt(variance) / scale
