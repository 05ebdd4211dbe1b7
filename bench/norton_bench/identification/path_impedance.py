"""The impedance of an actuator about a repeated movement, from how trials of it differ (paper, sections V and VI.E).

With the same command in each trial, and x₀ the motion source,

    τ_k = M (ẍ₀ − ẍ_k) + B (ẋ₀ − ẋ_k) + K (x₀ − x_k)

Differences from the mean of all trials contain no source: what is left is linear in M, B and K. Trials differ because
the load was driven differently. Motions are differentiated in a band, by their transforms, so that no noise is added.
It is the impedance at the load's encoder, the coupling included.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control.preview import delayed
from norton_bench.identification.assembly import Machine, Trial
from norton_bench.identification.at_ticks import in_band
from norton_bench.models.parameters import HALF_INTERVAL

# Everything below, nothing above twice that: there the differences of motions are far above an encoder's counts.
HIGHEST_HZ = 10.0
# Left out at both ends, where a band begins and ends.
EDGE_S = 0.15
# With less of the differences explained, something else than an inertia, a damper and a spring answers.
LINEAR = 0.9
# Without each of them in turn, for the deviations (jackknife): longer than what is left goes with itself.
PIECES = 16
REST_S = 0.2


@dataclass(frozen=True)
class PathImpedance:
    """About the path: ``values`` and ``half`` (95 % intervals) are of the inertia [kg m²], the damping [N m s/rad] and
    the stiffness [N m/rad], in newton metres of the load drive.

    ``explained`` is the share of the torque's differences that they explain (1: all of them). A stiffness that changes
    during the movement, or friction, lowers it.
    """

    values: tuple[float, float, float]
    half: tuple[float, float, float]
    explained: float

    @property
    def linear(self) -> bool:
        """Whether this is what the actuator answers with, as far as it was seen."""
        return self.explained >= LINEAR


def motions_rad(load: Machine, trials: Sequence[Trial], tick_s: float) -> FloatArray:
    """The load's motions from where it rested, (trials, ticks), at the instants of :func:`exerted_nm`."""
    return np.stack([_from_rest(each, load, tick_s) for each in trials])


def exerted_nm(trials: Sequence[Trial], tick_s: float) -> FloatArray:
    """The actuator's torques in the taught band, (trials, ticks)."""
    return np.stack([in_band(each.torque_nm, tick_s) for each in trials])


def path_impedance(load: Machine, trials: Sequence[Trial], tick_s: float) -> PathImpedance | None:
    """By all ``trials`` of a movement; None where there are not two of them, or where they do not differ.

    Deviations hold what a part of the movement would tell otherwise, and what the load's values leave open.
    """
    if len(trials) < 2:
        return None
    motions, exerted = motions_rad(load, trials, tick_s), exerted_nm(trials, tick_s)
    if not (np.any(np.ptp(motions, axis=0)) and np.any(np.ptp(exerted, axis=0))):
        return None
    torques = _differences(exerted, 0, tick_s)
    rows = -np.stack([_differences(motions, order, tick_s) for order in (2, 1, 0)], axis=-1)
    power = float(np.sum(torques**2))
    values = _solved(rows, torques)
    left = float(np.sum((torques - rows @ values) ** 2))
    variance = _jackknife(rows, torques) + _of_load(rows, load, trials, tick_s)
    half = HALF_INTERVAL * np.sqrt(variance)
    inertia, damping, stiffness = values.tolist()
    return PathImpedance((inertia, damping, stiffness), tuple(half.tolist()), 1.0 - left / power)


def _differences(values: FloatArray, order: int, tick_s: float) -> FloatArray:
    """A derivative of how trials differ from their mean, (trials, ticks), below HIGHEST_HZ.

    Without the mean of each over the movement: where a shaft rested is known no better than friction held it there.
    """
    edge = round(EDGE_S / tick_s)
    inner = in_band(values - values.mean(axis=0), tick_s, HIGHEST_HZ, order)[:, edge : values.shape[1] - edge]
    return np.asarray(inner - inner.mean(axis=1, keepdims=True))


def _solved(rows: FloatArray, torques: FloatArray) -> FloatArray:
    """Inertia, damping and stiffness, (3,), by least squares."""
    flat = rows.reshape(-1, 3)
    size = np.sqrt(np.mean(flat**2, axis=0))
    scaled, *_ = np.linalg.lstsq(flat / size, torques.reshape(-1), rcond=None)
    return np.asarray(scaled / size)


def _jackknife(rows: FloatArray, torques: FloatArray) -> FloatArray:
    """Variances of what is solved, (3,), by leaving out one piece of the movement after the other."""
    pieces = np.array_split(np.arange(rows.shape[1]), PIECES)
    without = np.stack([_solved(np.delete(rows, piece, axis=1), np.delete(torques, piece, axis=1)) for piece in pieces])
    return np.asarray((PIECES - 1) / PIECES * np.sum((without - without.mean(axis=0)) ** 2, axis=0))


def _of_load(rows: FloatArray, load: Machine, trials: Sequence[Trial], tick_s: float) -> FloatArray:
    """Variances, (3,), by those of the load's values; zero where these are not known."""
    drawn = [exerted_nm([trial.by(each, tick_s) for trial in trials], tick_s) for each in load.drawn()]
    solved = [_solved(rows, _differences(torques, 0, tick_s)) for torques in drawn]
    return np.asarray(np.var(np.stack(solved), axis=0, ddof=1)) if solved else np.zeros(3)


def _from_rest(trial: Trial, load: Machine, tick_s: float) -> FloatArray:
    """A motor, or a counter that began anew, is somewhere else each time."""
    position_rad = delayed(trial.seen.load_position_rad, tick_s, -load.motion_delay_s)
    return np.asarray(position_rad - np.mean(position_rad[: round(REST_S / tick_s)]))
