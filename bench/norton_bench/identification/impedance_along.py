"""The impedance of an actuator along a repeated movement, by trials that were pushed off it, each in another way.

    τ_k = M (ẍ₀ − ẍ_k) + B(t) (ẋ₀ − ẋ_k) + K(t) (x₀ − x_k)

With the same command in each trial, differences from the mean of all trials do not contain the motion source x₀. B and
K change along the movement in the same way in each trial; they are sums of B-splines in time. How near to each other
the splines stand is chosen by how well each trial is predicted from the others.

Ensemble methods fit each instant by itself, from hundreds of trials, and others fit each piece of one trial as if it
did not change (van de Ruit et al., Annual Reviews in Control 52, 2021, compares them). Splines use both, what trials
have in common and that a limb does not change at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline

from norton_bench.arrays import FloatArray
from norton_bench.distributions import t_quantile
from norton_bench.identification.assembly import Machine, Trial
from norton_bench.identification.at_ticks import in_band
from norton_bench.identification.path_impedance import EDGE_S, LINEAR, exerted_nm, motions_rad
from norton_bench.identification.statistics import simplest_as_good

# Torques are compared below it, nothing above twice that.
HIGHEST_HZ = 15.0
# Distances of the splines that are tried, beside values that do not change.
SPACINGS_S = (0.4, 0.2, 0.1, 0.05, 0.025)
DEGREE = 3
# No more of them than that: beside a minute's movement 25 ms apart they would take gigabytes and minutes.
MOST_SPLINES = 400
# Fewer trials tell no deviations.
LEAST_TRIALS = 4
# A quarter of the least distance between splines: so near to each other are the instants of the result.
INSTANTS_S = 0.00625
# A combination of basis functions that is excited less than this, of what is excited most, is not known.
UNKNOWN = 1e-6
# Trials that differ by less than this, of what they usually do, rest.
MOVED = 0.2
NOTHING = 1e-300


@dataclass(frozen=True, eq=False)
class ImpedanceAlong:
    """Damping [N m s/rad] and stiffness [N m/rad] at ``time_s`` (n,), and the inertia [kg m²], in newton metres of the
    load drive; ``half`` is half a 95 % interval.

    ``resolution_s`` is how far from each other the splines of the stiffness stand, infinite where no change was found;
    ``damping_changes`` whether the damping has such splines, too. ``explained`` is the share of the torque's
    differences that is explained in trials which the fit has not seen.
    """

    time_s: FloatArray
    inertia_kgm2: float
    inertia_half_kgm2: float
    damping_nms_rad: FloatArray
    damping_half_nms_rad: FloatArray
    stiffness_nm_rad: FloatArray
    stiffness_half_nm_rad: FloatArray
    resolution_s: float
    damping_changes: bool
    explained: float

    @property
    def linear(self) -> bool:
        """Whether this is what the actuator answers with, as far as it was seen."""
        return self.explained >= LINEAR


@dataclass(frozen=True, eq=False)
class _Basis:
    """Basis functions of the damping and of the stiffness at the ticks, (functions, ticks) each."""

    spacing_s: float
    damping: FloatArray
    stiffness: FloatArray

    @property
    def size(self) -> int:
        return 1 + len(self.damping) + len(self.stiffness)

    def values(self, solved: FloatArray) -> FloatArray:
        """Inertia, damping and stiffness at the ticks, (3, ticks), from what was ``solved`` (size,)."""
        inertia, damping, stiffness = np.split(solved, np.cumsum([1, len(self.damping)]))
        ones = np.ones(self.damping.shape[1])
        return np.stack([inertia * ones, damping @ self.damping, stiffness @ self.stiffness])


def impedance_along(load: Machine, trials: Sequence[Trial], tick_s: float) -> ImpedanceAlong | None:
    """By ``trials`` of one movement; None where there are fewer than LEAST_TRIALS, or where they do not differ.

    Deviations are those of a jackknife over the trials, and what the load's values leave open.
    """
    if len(trials) < LEAST_TRIALS:
        return None
    motions = motions_rad(load, trials, tick_s)
    torques = _compared(exerted_nm(trials, tick_s), tick_s)
    if not (np.any(np.ptp(motions, axis=0)) and np.any(np.ptp(torques, axis=0))):
        return None
    power = float(np.mean((torques - torques.mean(axis=0)) ** 2))
    derivatives = [in_band(motions - motions.mean(axis=0), tick_s, 2 * HIGHEST_HZ, order) for order in range(3)]

    def fitted(basis: _Basis) -> _Fit:
        return _Fit.of(basis, _rows(basis, derivatives, tick_s), torques)

    constant, *changing = map(fitted, _stiffnesses(motions.shape[1], tick_s))
    # Not the simplest of these: what a coarser one smooths away would be missing in its intervals.
    best_changing = min(changing, key=_mean_unseen)
    best = _simplest([constant, best_changing])
    if best is best_changing:
        best = _simplest([best, fitted(replace(best.basis, damping=best.basis.stiffness))])
    variance = best.jackknife() + _of_load(best, load, trials, tick_s)
    half = t_quantile(0.975, len(trials) - 1) * np.sqrt(variance)
    explained = 1.0 - _mean_unseen(best) / power
    moved = _moved(motions, tick_s)
    instants = np.arange(moved[0], moved[-1] + 1, max(round(INSTANTS_S / tick_s), 1))
    return _at(instants, best, half, explained, tick_s)


def _moved(motions: FloatArray, tick_s: float) -> npt.NDArray[np.intp]:
    """The ticks from the first to the last at which trials differ about as much as they usually do: before and after
    that they rest. Not where a band begins or ends."""
    edge = round(EDGE_S / tick_s)
    apart = np.std(motions, axis=0)[edge : motions.shape[1] - edge]
    return edge + np.flatnonzero(apart >= MOVED * np.median(apart))


def _at(
    instants: npt.NDArray[np.intp], fit: "_Fit", half: FloatArray, explained: float, tick_s: float
) -> ImpedanceAlong:
    inertia, damping, stiffness = fit.values[:, instants]
    inertia_half, damping_half, stiffness_half = half[:, instants]
    return ImpedanceAlong(
        np.asarray(instants * tick_s, dtype=np.float64),
        float(inertia[0]),
        float(inertia_half[0]),
        damping,
        damping_half,
        stiffness,
        stiffness_half,
        fit.basis.spacing_s,
        len(fit.basis.damping) > 1,
        explained,
    )


def _stiffnesses(ticks: int, tick_s: float) -> list[_Basis]:
    """From one that does not change to such that change fast, with a damping that does not."""
    constant = np.ones((1, ticks))
    fine = [spacing_s for spacing_s in SPACINGS_S if ticks * tick_s / spacing_s <= MOST_SPLINES] or SPACINGS_S[:1]
    changing = (_Basis(spacing_s, constant, _splines(ticks, tick_s, spacing_s)) for spacing_s in fine)
    return [_Basis(np.inf, constant, constant), *changing]


def _splines(ticks: int, tick_s: float, spacing_s: float) -> FloatArray:
    """Cubic B-splines, (functions, ticks), whose knots are about so far from each other."""
    pieces = max(round(ticks * tick_s / spacing_s), 1)
    knots = np.arange(-DEGREE, pieces + DEGREE + 1, dtype=np.float64)
    at = (np.arange(ticks) + 0.5) * pieces / ticks
    return np.ascontiguousarray(BSpline.design_matrix(at, knots, DEGREE).toarray().T)


def _rows(basis: _Basis, derivatives: Sequence[FloatArray], tick_s: float) -> FloatArray:
    """What each basis function with a value of 1 makes of the trials' torques, (trials, instants, functions)."""
    position, velocity, acceleration = derivatives
    products = ((velocity, basis.damping), (position, basis.stiffness))
    columns = [_compared(acceleration, tick_s)]  # one after the other: all ticks of all of them would fill the memory
    columns += [_compared(motion * each, tick_s) for motion, functions in products for each in functions]
    return -np.stack(columns, axis=-1)


def _compared(torques: FloatArray, tick_s: float) -> FloatArray:
    """Torques (trials, ticks) below HIGHEST_HZ, (trials, instants), at instants that hold all of that.

    Without the mean of each trial: where a shaft rested is known no better than friction held it there.
    """
    edge, step = round(EDGE_S / tick_s), max(int(1.0 / (4.0 * HIGHEST_HZ * tick_s)), 1)
    inner = in_band(torques, tick_s, HIGHEST_HZ)[:, edge : torques.shape[1] - edge : step]
    return np.asarray(inner - inner.mean(axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Least squares by how the trials differ from their mean: of all of them, and of all but one."""

    basis: _Basis
    rows: FloatArray  # (trials, instants, functions)
    torques: FloatArray  # (trials, instants)
    solved: FloatArray  # (functions,)
    without: FloatArray  # (trials, functions): what the others tell

    @classmethod
    def of(cls, basis: _Basis, rows: FloatArray, torques: FloatArray) -> "_Fit":
        size = np.maximum(np.sqrt(np.mean(rows**2, axis=(0, 1))), NOTHING)
        scaled, sides = rows / size, torques - torques.mean(axis=0)
        squares = np.einsum("kti,ktj->kij", scaled, scaled, optimize=True)
        products = np.einsum("kti,kt->ki", scaled, sides)
        sums = scaled.sum(axis=0), sides.sum(axis=0)

        def solved(left_out: Sequence[int]) -> FloatArray:
            """Without the mean of the others, which is as much a part of the source's path as of any trial."""
            others = np.delete(np.arange(len(rows)), left_out)
            column_sum = sums[0] - scaled[left_out].sum(axis=0)
            side_sum = sums[1] - sides[left_out].sum(axis=0)
            square = squares[others].sum(axis=0) - column_sum.T @ column_sum / len(others)
            product = products[others].sum(axis=0) - column_sum.T @ side_sum / len(others)
            return np.asarray(np.linalg.pinv(square, rcond=UNKNOWN**2, hermitian=True) @ product / size)

        return cls(basis, rows, torques, solved([]), np.stack([solved([trial]) for trial in range(len(rows))]))

    @property
    def values(self) -> FloatArray:
        """Inertia, damping and stiffness at the ticks, (3, ticks)."""
        return self.basis.values(self.solved)

    def unseen(self) -> list[float]:
        """The mean square by which the torque of each trial is off that is predicted from the others."""
        count, errors = len(self.rows), []
        for trial, solved in enumerate(self.without):
            off = self.torques - self.rows @ solved
            mean = (off.sum(axis=0) - off[trial]) / (count - 1)
            errors.append(float(np.mean((off[trial] - mean) ** 2)))
        return errors

    def jackknife(self) -> FloatArray:
        """Variances of inertia, damping and stiffness at the ticks, (3, ticks), from what each trial adds."""
        values, count = np.stack([self.basis.values(each) for each in self.without]), len(self.without)
        return np.asarray((count - 1) / count * np.sum((values - values.mean(axis=0)) ** 2, axis=0))


def _mean_unseen(fit: _Fit) -> float:
    return float(np.mean(fit.unseen()))


def _simplest(fits: Sequence[_Fit]) -> _Fit:
    """The simplest that predicts unseen trials as well as any."""
    return fits[simplest_as_good([each.unseen() for each in fits], [each.basis.size for each in fits])]


def _of_load(fit: _Fit, load: Machine, trials: Sequence[Trial], tick_s: float) -> FloatArray:
    """Variances, (3, ticks), by those of the load's values; zero where these are not known."""
    differences = (fit.rows - fit.rows.mean(axis=0)).reshape(-1, fit.basis.size)
    inverse = np.linalg.pinv(differences, rcond=UNKNOWN)
    drawn = [exerted_nm([trial.by(each, tick_s) for trial in trials], tick_s) for each in load.drawn()]
    compared = (_compared(torques, tick_s) for torques in drawn)
    values = [fit.basis.values(inverse @ (each - each.mean(axis=0)).reshape(-1)) for each in compared]
    return np.asarray(np.var(np.stack(values), axis=0, ddof=1)) if values else np.zeros((3, fit.values.shape[1]))
