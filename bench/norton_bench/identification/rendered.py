"""The law that the load really rendered: mass, damping and stiffness of the port, from torque and motion alone.

    M dv/dt + B v + K (x − x_ref) = τ_port

Nothing that was measured is differentiated: both sides are multiplied by functions that are zero at both ends of a
window, and integrated by parts, so that the derivatives stand at the functions (Shinbrot, "On the analysis of linear
and nonlinear systems", Trans. ASME 79, 1957).
"""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.statistics import NORMAL_95
from norton_bench.identification.trials import TAUGHT_HZ, in_band, seen
from norton_bench.records import LAW, Measured, SegmentInfo
from norton_bench.segments import Admittance

RENDER, RENDERED = "render", "rendered"
# Windows of so long, which overlap by half, and in each one function for every second multiple of 1 / WINDOW_S: the
# functions of a window, sin⁴ of its phase, are as wide as that.
WINDOW_S = 0.5
# Windows so near share readings, or friction that stood in both: their errors count as dependent (Newey and West 1987).
DEPENDENT_WINDOWS = 2
MASS, DAMPING, STIFFNESS = range(3)
UNKNOWN = 4  # beside them, the torque's zero with the place of the spring's

Complex = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class Rendered:
    """The law of one step as it was ``asked`` for and as it was measured.

    ``measured`` and ``half`` (3,) are mass [kg m²], damping [N m s/rad] and stiffness [N m/rad], and half their 95 %
    intervals. ``torque_nm`` is the port's torque below TAUGHT_HZ, rms; ``off_nm`` what of it the law asked for does not
    explain, ``left_nm`` what the measured one does not.
    """

    asked: Admittance
    measured: tuple[float, float, float]
    half: tuple[float, float, float]
    torque_nm: float
    off_nm: float
    left_nm: float

    @property
    def wanted(self) -> tuple[float, float, float]:
        """The law asked for, in the order of ``measured``."""
        return self.asked.mass_kgm2, self.asked.damping_nms_rad, self.asked.stiffness_nm_rad


def law_text(law: Admittance, late_s: float) -> str:
    """The law as the recording holds it, and by how much torque is read later than the load's motion, as the
    calibration has it: that much late, damping would pass for mass."""
    return json.dumps({"law": asdict(law), "late_s": late_s})


def rendered(measured: Measured, tick_s: float) -> tuple[Rendered, ...]:
    """What each step that rendered a law to its end came to. Raises ExperimentError where a stream has gaps."""
    segments = [each for each in measured.segments if each.procedure == RENDER and each.name == RENDERED]
    results = []
    for event in measured.events:
        before = [each for each in segments if each.end_ns <= event.stamp_ns]
        if event.kind == LAW and before:  # said when the step has ended
            asked = json.loads(event.text)
            results.append(_of_segment(measured, before[-1], Admittance(**asked["law"]), asked["late_s"], tick_s))
    return tuple(results)


def _of_segment(measured: Measured, segment: SegmentInfo, asked: Admittance, late_s: float, tick_s: float) -> Rendered:
    ticks = round((segment.end_ns - segment.start_ns) * 1e-9 / tick_s)
    if ticks * tick_s < 2 * WINDOW_S:
        raise ExperimentError(f"{RENDER}: the law acted for less than a second, which shows nothing of it; repeat it")
    readings = seen(measured, segment, ticks, tick_s)
    if readings.torque_nm is None:
        raise ExperimentError(f"{RENDER}: no torque was read")
    columns, torque = _integrals(readings.load_position_rad, readings.torque_nm, late_s, tick_s)
    values, std = _solved(columns, torque)
    power = float(np.sum(torque**2))
    torque_nm = float(np.sqrt(np.mean(in_band(readings.torque_nm - np.mean(readings.torque_nm), tick_s) ** 2)))

    def left_nm(law: FloatArray) -> float:
        """What the law leaves, whatever the sensor's zero is."""
        constant, rest = columns[..., -1], torque - columns[..., : law.size] @ law
        rest = rest - constant * np.sum(constant * rest) / np.sum(constant**2)
        return torque_nm * float(np.sqrt(np.sum(rest**2) / power)) if power > 0.0 else 0.0

    law, half = values[:3], NORMAL_95 * std[:3]
    wanted = np.array([asked.mass_kgm2, asked.damping_nms_rad, asked.stiffness_nm_rad])
    return Rendered(
        asked,
        (float(law[MASS]), float(law[DAMPING]), float(law[STIFFNESS])),
        (float(half[MASS]), float(half[DAMPING]), float(half[STIFFNESS])),
        torque_nm,
        left_nm(wanted) if wanted.any() else torque_nm,
        left_nm(law),
    )


def _integrals(
    position_rad: FloatArray, torque_nm: FloatArray, late_s: float, tick_s: float
) -> tuple[FloatArray, FloatArray]:
    """The equation's columns (windows, rows, UNKNOWN) and its right side (windows, rows), real and imaginary parts."""
    length = round(WINDOW_S / tick_s)
    windows = [
        np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2]
        for values in (position_rad - np.mean(position_rad), torque_nm - np.mean(torque_nm))
    ]
    columns, right = [], []
    turned, torque = windows
    for (function, slope, curvature), (later, *_) in zip(
        _functions(length, 0.0, tick_s), _functions(length, late_s, tick_s), strict=True
    ):
        ones = np.full(len(turned), np.sum(later))
        columns.append(np.stack([turned @ curvature, -(turned @ slope), turned @ function, ones], axis=-1))
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
    """Least squares, and standard deviations from what is left, window by window."""
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
    few = len(scores) / max(len(scores) - UNKNOWN, 1)
    variance = np.maximum(np.diag(inverse @ meat @ inverse) * few, 0.0)
    return values / scale, np.sqrt(variance) / scale
