"""The impedance of two joints about where they rest, from both ports moved by periodic sines.

At each frequency the two runs give two independent motions; the exertions follow from them by

    T_i = − Σ_j Z_ij(jω) Θ_j,   Z(s) = M s² + B s + K

with matrices that need not be symmetric. Torque and motion are read with different delays, of which three differences
show. Noise is what differs from period to period; it is on torque and motion alike, so each residual is weighed by how
much it scatters itself (maximum likelihood with a sample variance: Pintelon and Schoukens, System Identification, 2nd
ed. 2012, chapter 12). Two errors are the same in every period: a drift of the torque sensor, which is taken off, and
that of the encoders' counts, whose variance is added.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.optimize import least_squares

from norton_bench.arrays import ComplexArray, FloatArray
from norton_bench.distributions import f_tail, t_quantile
from norton_bench.errors import ExperimentError
from norton_bench.identification.at_ticks import readings_at_ticks
from norton_bench.identification.counts import resolution_of
from norton_bench.joints.arm import JOINTS, ImpedanceSection
from norton_bench.joints.experiment import IMPEDANCE, MOVED, SIGNS, lines
from norton_bench.records import Measured, SegmentInfo

MATRICES = ("inertia", "damping", "stiffness")
UNITS = {"inertia": "kg*m^2", "damping": "N*m*s/rad", "stiffness": "N*m/rad"}
COUNT = len(JOINTS)
PARAMETERS = len(MATRICES) * COUNT**2
DELAYS = 3
LEVEL = 0.975
# A misfit that chance makes more rarely than this is none of chance.
CHANCE = 1e-3
# Rounds of weighing: what a residual scatters by depends on the impedance, which changes little after the first.
ROUNDS = 3
# The variance of one line is told by few periods; so many lines beside each other share theirs.
SHARED_LINES = 5
# Motions of both runs whose matrix is conditioned worse than this: a joint hardly followed, or both did the same.
ALIKE = 1e3


@dataclass(frozen=True)
class Spectra:
    """What one run showed: angles [rad] and torques [N m], each of shape (periods, lines, 2), and where the joints
    stood in the mean (2,).

    ``count_rad`` (2,) is the deviation of the real or imaginary part of a line that the encoders' counts make.
    """

    angle: ComplexArray
    torque: ComplexArray
    place_rad: FloatArray
    count_rad: FloatArray


@dataclass(frozen=True)
class JointImpedance:
    """M, B and K by row the joint that exerts, by column the joint that moves; each of shape (2, 2).

    ``covariance`` (12, 12) is that of their entries, in that order, row by row. ``half`` are half-widths of 95 %
    intervals. ``misfit`` is the rms residual over that of noise; where it is not ``adequate``, something else answers
    than an inertia, a damper and a spring, and the intervals are wider by as much. ``frequency_hz`` and ``measured``
    (lines, 2, 2) are what was seen without any model, delays of reading taken off. ``place_rad`` is where the joints
    stood in the mean, ``swing_rad`` how far they were moved to either side.
    """

    inertia: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    covariance: FloatArray
    freedom: int
    weights_freedom: int
    misfit: float
    delays_s: FloatArray
    frequency_hz: FloatArray
    measured: ComplexArray
    swing_rad: tuple[float, float]
    place_rad: tuple[float, float]

    @property
    def matrices(self) -> dict[str, FloatArray]:
        return {name: getattr(self, name) for name in MATRICES}

    @property
    def half(self) -> dict[str, FloatArray]:
        """Of shape (2, 2) each."""
        deviations = np.sqrt(np.diag(self.covariance)).reshape(len(MATRICES), COUNT, COUNT)
        wide = t_quantile(LEVEL, self.freedom) * deviations
        return dict(zip(MATRICES, wide, strict=True))

    @property
    def adequate(self) -> bool:
        """Whether chance makes as great a misfit: by the F distribution of what the fit leaves and of its weights."""
        return float(f_tail(self.misfit**2, self.freedom, self.weights_freedom)) > CHANCE

    def at(self, s: ComplexArray) -> ComplexArray:
        """Z(s) for s (n,), shape (n, 2, 2)."""
        return impedance_at(np.stack([self.inertia, self.damping, self.stiffness]), s)


def impedance_at(matrices: FloatArray, s: ComplexArray) -> ComplexArray:
    """M s² + B s + K for matrices (3, 2, 2) and s (n,)."""
    powers = np.stack([s**2, s, np.ones_like(s)])
    return np.asarray(np.einsum("kn,kij->nij", powers, matrices))


def spectra(joints: tuple[Measured, ...], section: ImpedanceSection, tick_s: float) -> tuple[Spectra, ...]:
    """Of both runs, from what each joint measured. Raises ExperimentError where a run is not there, or has gaps."""
    return tuple(_spectra(joints, f"{MOVED} {sign:+g}", section, tick_s) for sign in SIGNS)


def _spectra(joints: tuple[Measured, ...], name: str, section: ImpedanceSection, tick_s: float) -> Spectra:
    angles, torques, places, counts = zip(
        *(_values(measured, _segment(measured, name, section), section, tick_s) for measured in joints), strict=True
    )
    return Spectra(np.stack(angles, axis=-1), np.stack(torques, axis=-1), np.array(places), np.array(counts))


def _segment(measured: Measured, name: str, section: ImpedanceSection) -> SegmentInfo:
    chosen = [each for each in measured.segments if each.procedure == IMPEDANCE and each.name == name]
    if not chosen:
        raise ExperimentError(f'"{IMPEDANCE}: {name}" is not in the recording; run the arm again')
    segment = chosen[-1]
    if segment.end_ns - segment.start_ns < (section.periods + 1) * section.period_s * 1e9:
        raise ExperimentError(f'"{IMPEDANCE}: {name}" ended before its end; run the arm again')
    return segment


def _values(
    measured: Measured, segment: SegmentInfo, section: ImpedanceSection, tick_s: float
) -> tuple[ComplexArray, ComplexArray, float, float]:
    """Angle and torque at each line, of each period after the first, shape (periods, lines); the mean angle; and what
    counts make of a line."""
    ticks = round(section.period_s / tick_s)
    result = readings_at_ticks(measured, segment, (section.periods + 1) * ticks, tick_s)
    assert result.torque_nm is not None

    def at_lines(values: FloatArray) -> ComplexArray:
        periods = values[ticks:].reshape(section.periods, ticks)
        means = periods.mean(axis=1)
        drift = (means[-1] - means[0]) / (section.periods - 1) * (np.arange(ticks) / ticks - 0.5)
        return np.asarray(np.fft.rfft(periods - drift, axis=1)[:, lines(section)] * 2 / ticks)

    place_rad = float(np.mean(result.position_rad[ticks:]))
    # Errors of counts are spread evenly over a step, and white where a reading passes a step or more.
    count_rad = resolution_of(measured.motion["position_rad"]).width / sqrt(12.0) * sqrt(2.0 / ticks)
    return at_lines(result.position_rad), at_lines(result.torque_nm), place_rad, count_rad


def fit(runs: tuple[Spectra, ...], section: ImpedanceSection) -> JointImpedance:
    """The matrices that explain both runs. Raises ExperimentError where the motions do not tell them apart."""
    frequency_hz = lines(section) / section.period_s
    s: ComplexArray = np.asarray(2j * np.pi * frequency_hz)
    angle, torque = (np.stack([np.mean(getattr(run, name), axis=0) for run in runs]) for name in ("angle", "torque"))
    response = _response(angle, torque)
    found = np.concatenate([_first_guess(response, s), np.zeros(DELAYS)])
    for _ in range(ROUNDS):
        weight = 1.0 / _deviations(runs, found, s)
        result = least_squares(_whitened, found, x_scale=_scale(found), args=(angle, torque, s, weight))
        found = result.x
    freedom = 2 * torque.size - found.size
    misfit = sqrt(2 * float(result.cost) / freedom)
    slopes: FloatArray = np.asarray(result.jac)
    inverse = np.linalg.inv(slopes.T @ slopes)[:PARAMETERS, :PARAMETERS]
    inertia, damping, stiffness = found[:PARAMETERS].reshape(len(MATRICES), COUNT, COUNT)
    delays_s = found[PARAMETERS:]
    return JointImpedance(
        inertia=inertia,
        damping=damping,
        stiffness=stiffness,
        covariance=np.asarray(inverse * max(misfit, 1.0) ** 2, dtype=np.float64),
        freedom=freedom,
        weights_freedom=2 * len(runs) * (len(runs[0].angle) - 1) * min(SHARED_LINES, len(s)),
        misfit=misfit,
        delays_s=delays_s,
        frequency_hz=frequency_hz,
        measured=response / _delayed(delays_s, s),
        swing_rad=_pair([np.ptp(_in_time(run.angle, section), axis=0) / 2 for run in runs]),
        place_rad=_pair([run.place_rad for run in runs]),
    )


def _pair(of_runs: list[FloatArray]) -> tuple[float, float]:
    shoulder, elbow = np.mean(of_runs, axis=0)
    return float(shoulder), float(elbow)


def _response(angle: ComplexArray, torque: ComplexArray) -> ComplexArray:
    """−T Θ⁻¹ at every line, (lines, 2, 2), from angles and torques (runs, lines, 2)."""
    motion = np.transpose(angle, (1, 2, 0))
    if np.max(np.linalg.cond(motion)) > ALIKE:
        raise ExperimentError("both joints moved alike in both runs, so that their impedances cannot be told apart")
    return np.asarray(-np.transpose(torque, (1, 2, 0)) @ np.linalg.inv(motion))


def _first_guess(response: ComplexArray, s: ComplexArray) -> FloatArray:
    """By linear least squares, without delays: shape (12,)."""
    columns = np.stack([s**2, s, np.ones_like(s)], axis=1)
    both = np.concatenate([columns.real, columns.imag])
    wanted = response.reshape(len(s), -1)
    values, *_ = np.linalg.lstsq(both, np.concatenate([wanted.real, wanted.imag]), rcond=None)
    return np.asarray(values.ravel(), dtype=np.float64)


def _scale(found: FloatArray) -> FloatArray:
    """Of each entry by the greatest of its matrix, and delays by a millisecond."""
    matrices = np.abs(found[:PARAMETERS]).reshape(len(MATRICES), -1)
    return np.concatenate([np.repeat(matrices.max(axis=1), COUNT**2), np.full(DELAYS, 1e-3)])


def _delayed(delays_s: FloatArray, s: ComplexArray) -> ComplexArray:
    """What late readings make of Z_ij, (lines, 2, 2): torque of i after motion of the shoulder, of the elbow after
    that of the shoulder."""
    torque_1, torque_2, motion_2 = delays_s
    late = np.array([[torque_1, torque_1 - motion_2], [torque_2, torque_2 - motion_2]])
    return np.asarray(np.exp(-s[:, None, None] * late))


def _residuals(parameters: FloatArray, angle: ComplexArray, torque: ComplexArray, s: ComplexArray) -> ComplexArray:
    """T + Z Θ, of the shape of ``torque`` (..., lines, 2)."""
    matrices = parameters[:PARAMETERS].reshape(len(MATRICES), COUNT, COUNT)
    impedance = impedance_at(matrices, s) * _delayed(parameters[PARAMETERS:], s)
    return np.asarray(torque + np.einsum("nij,...nj->...ni", impedance, angle))


def _deviations(runs: tuple[Spectra, ...], parameters: FloatArray, s: ComplexArray) -> FloatArray:
    """Of the real and of the imaginary part of each mean residual, (runs, lines, 2), from how it scatters."""
    scatter = []
    for run in runs:
        each = _residuals(parameters, run.angle, run.torque, s)
        scatter.append(np.sum(np.abs(each - each.mean(axis=0)) ** 2, axis=0) / (len(each) - 1) / len(each) / 2)
    pooled = np.mean(scatter, axis=0)
    window = np.ones(min(SHARED_LINES, len(s)))
    share = np.convolve(np.ones(len(s)), window, "same")
    smooth = np.stack([np.convolve(pooled[:, joint], window, "same") / share for joint in range(COUNT)], axis=1)
    impedance = impedance_at(parameters[:PARAMETERS].reshape(len(MATRICES), COUNT, COUNT), s)
    counts = np.stack([np.abs(impedance) ** 2 @ run.count_rad**2 for run in runs])
    return np.asarray(np.sqrt(smooth + counts))


def _whitened(
    parameters: FloatArray, angle: ComplexArray, torque: ComplexArray, s: ComplexArray, weight: FloatArray
) -> FloatArray:
    each = _residuals(parameters, angle, torque, s) * weight
    return np.concatenate([each.real.ravel(), each.imag.ravel()])


def _in_time(angle: ComplexArray, section: ImpedanceSection) -> FloatArray:
    """The motion of a mean period [rad], (ticks, 2)."""
    time_s = np.linspace(0.0, section.period_s, 1000, endpoint=False)
    turns = np.exp(2j * np.pi * np.outer(time_s, lines(section) / section.period_s))
    return np.asarray((turns @ angle.mean(axis=0)).real)
