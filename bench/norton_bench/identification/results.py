"""What an identification says: estimates with their confidence, residuals, and what the data cannot tell."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import scipy

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification import branches
from norton_bench.identification.kernels import FULL_BAND, Kernel
from norton_bench.identification.statistics import LOOSE_BEYOND
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import HALF_INTERVAL, Estimate, Status

if TYPE_CHECKING:
    from norton_bench.identification.bootstrap import Readings, Simulation
    from norton_bench.identification.sanity_checks import FailedCheck
    from norton_bench.identification.separable import Solution
    from norton_bench.identification.signals import Signals

# A parameter takes part in a direction with at least this share of the greatest part.
TAKES_PART = 0.3
# All that grow by the same factor, to within this, are known up to a common factor.
COMMON_WITHIN = 0.25
MEND = {
    "torque_gain": "impose motion and measure torque to fix it",
    "amplifier_bandwidth": "command faster changes",
    "inertia": "impose faster motion",
    "viscous_damping": "impose a wider range of velocities",
    "coulomb_torque": "turn the shaft both ways, well beyond presliding",
    "presliding_stiffness": "impose slow motion of small amplitude",
    "presliding_damping": "impose small, fast motion about a standstill",
}


# What the data cannot tell, in words: from the directions of parameter space in which the estimate is loose.
@dataclass(frozen=True)
class Direction:
    """Parameters that may move together at no cost: relative deviation along it, and each one's part."""

    deviation: float
    names: tuple[str, ...]
    parts: FloatArray

    @property
    def common_factor(self) -> bool:
        """Whether all parts are one and the same."""
        return bool(np.ptp(self.parts) <= COMMON_WITHIN * np.max(np.abs(self.parts)))


def loose_directions(names: Sequence[str], relative_covariance: FloatArray) -> tuple[Direction, ...]:
    """The singular directions of the information, the loosest first; ``relative_covariance`` is of logarithms."""
    variance, vectors = np.linalg.eigh(relative_covariance)
    result = []
    for k in reversed(range(len(variance))):
        deviation = float(np.sqrt(max(variance[k], 0.0)))
        if not deviation > LOOSE_BEYOND:
            break
        largest = int(np.argmax(np.abs(vectors[:, k])))
        vector = vectors[:, k] * np.sign(vectors[largest, k])
        taking = np.flatnonzero(np.abs(vector) >= TAKES_PART * np.max(np.abs(vector)))
        result.append(Direction(deviation, tuple(names[int(i)] for i in taking), vector[taking]))
    return tuple(result)


def words(direction: Direction) -> str:
    """One sentence: what is loose, and what would fix it."""
    names = [name.replace("_", " ") for name in direction.names]
    mend = MEND.get(direction.names[int(np.argmax(np.abs(direction.parts)))], "excite it more")
    if len(names) == 1:
        return f"The data hardly excite {names[0]}: uncertain by more than half of the value; {mend}."
    together = f"{', '.join(names[:-1])} and {names[-1]}"
    if direction.common_factor:
        return f"Known only up to a common factor are {together}: {MEND['torque_gain']}."
    return f"Known only in combination are {together}: one can make up for another; {mend}."


def verdict(
    estimates: Sequence[Estimate],
    directions: Sequence[Direction],
    *,
    ratios: Sequence[Estimate],
    converged: bool,
    has_current: bool,
) -> tuple[str, ...]:
    """All sentences. ``ratios`` are what is known per unit of torque gain where the scale is not."""
    sentences = []
    if not converged:
        sentences.append("The fit did not converge: treat every number as provisional, and measure longer or faster.")
    sentences += [words(direction) for direction in directions]
    if ratios:
        sentences.append(_ratio_sentence(ratios))
    names = [estimate.name.replace("_", " ") for estimate in estimates if estimate.status is Status.AT_BOUND]
    if names:
        these = "it is" if len(names) == 1 else "they are"
        sentences.append(f"At the edge of what was searched: {', '.join(names)}; {these} no estimate.")
    if not has_current:
        sentences.append("Torque constant and amplifier gain are known only as a product: no current was measured.")
    return tuple(sentences)


def _ratio_sentence(ratios: Sequence[Estimate]) -> str:
    known = [
        f"{estimate.name.replace('_', ' ')} / torque gain = {estimate.value:.4g} ± {estimate.half_interval:.2g}"
        for estimate in ratios
    ]
    return f"Known are the ratios {', '.join(known)} (per command unit; ± is half of a 95 % interval)."


@dataclass(frozen=True)
class SensorZero:
    """The torque sensor's zero: what it reads with nothing at the port, a broken line of time, held on beyond its
    ends.

    ``value_nm`` (knots,) at ``time_s`` (knots,), in time of :class:`~norton_bench.identification.signals.Signals`.

    In the sign of the port. ``covariance_nm2`` (knots, knots) is that of the values, empty where it is not known.
    """

    time_s: FloatArray
    value_nm: FloatArray
    covariance_nm2: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    @classmethod
    def constant(cls, value_nm: float) -> "SensorZero":
        """The same throughout."""
        return cls(np.zeros(1), np.array([value_nm]))

    def weights(self, time_s: npt.ArrayLike) -> FloatArray:
        """How much each knot counts at these instants, shape (n, knots)."""
        at_s = np.asarray(time_s, dtype=float)
        return np.stack([np.interp(at_s, self.time_s, one) for one in np.eye(self.time_s.size)], axis=-1)

    def at(self, time_s: npt.ArrayLike) -> FloatArray:
        """At instants (n,) [N m]."""
        return np.asarray(np.interp(np.asarray(time_s, dtype=float), self.time_s, self.value_nm))

    def before(self, time_s: float) -> tuple[float, float]:
        """At an instant before the first knot, going on as evenly as it drifts between its ends, and the deviation of
        that [N m]."""
        weights = np.zeros(self.time_s.size)
        weights[0] = 1.0
        if self.time_s.size > 1:
            share = (float(self.time_s[0]) - time_s) / float(self.time_s[-1] - self.time_s[0])
            weights[[0, -1]] += share, -share
        variance = weights @ self.covariance_nm2 @ weights if self.covariance_nm2.size else 0.0
        return float(weights @ self.value_nm), float(np.sqrt(max(variance, 0.0)))

    def moved(self, by_nm: float) -> "SensorZero":
        """The same line, higher by so much."""
        return replace(self, value_nm=self.value_nm + by_nm)


@dataclass(frozen=True)
class Trace:
    """Measured beside predicted, arrays of shape (n,); NaN between segments."""

    time_s: FloatArray
    measured: FloatArray
    predicted: FloatArray
    unit: str


@dataclass(frozen=True)
class Cogging:
    """Torque that goes with the position, taken out of every estimate: so many periods a turn; its amplitude, and the
    deviation of that."""

    periods_per_turn: float
    amplitude_nm: float
    std_nm: float

    @property
    def half_interval_nm(self) -> float:
        """Half of the interval of 95 %."""
        return HALF_INTERVAL * self.std_nm


@dataclass(frozen=True)
class Simulated:
    """What simulated records made of a fit: mappings are by the names of parameters.

    ``of_residual`` are the value and the deviation that the residual alone gives; ``repeated_std`` is the part of the
    deviation that every session of the same bench repeats: that of the bias which was taken off, and of what the
    subtraction of ringing changed. ``excess`` is how many times the residual's own deviation is that which simulated
    records state: one where they err as the real one does. ``left`` (draws,) is as in ``scatter.Scatter``.
    """

    of_residual: Mapping[str, tuple[float, float]]
    repeated_std: Mapping[str, float]
    excess: Mapping[str, float]
    left: FloatArray = field(repr=False, compare=False)
    bench: "Simulation" = field(repr=False, compare=False)


@dataclass(frozen=True)
class Ground:
    """What a fit stands on, so that it can go on with other terms; ``readings`` are those to simulate records by."""

    stretches: "tuple[Signals, ...]"
    solution: "Solution"
    readings: "Readings"


@dataclass(frozen=True)
class FitResult:
    """One fit of the Norton network.

    ``torque_rms_nm`` is the rms of the torque residual, ``torque_relative`` that over the rms of the torque. Delays are
    relative to the torque stream; positive means later. ``verdict`` says in words what the data cannot tell.
    """

    estimates: tuple[Estimate, ...]
    network: NortonNetwork
    converged: bool
    torque_rms_nm: float
    torque_relative: float
    samples: int
    command_delay_s: float
    command_delay_std_s: float
    motion_delay_s: float
    motion_delay_std_s: float
    trace: Trace
    band: Kernel = FULL_BAND  # the low-pass through which everything was looked at
    cogging: tuple[Cogging, ...] = ()
    torque_bias_nm: float = 0.0  # what the torque reads with nothing at the port, in the sign of the port looked at
    verdict: tuple[str, ...] = ()
    ground: "Ground | None" = field(default=None, repr=False, compare=False)
    failed_checks: "tuple[FailedCheck, ...]" = ()  # what of the verdict makes estimates doubtful
    torque_zero: SensorZero | None = None  # the same as it drifts; None where no torque was fitted
    middle_s: float = 0.0  # of what was fitted, in time of Signals: when what changes with time has its values
    simulated: Simulated | None = None  # None where the deviations are those of the residual alone

    @property
    def doubtful(self) -> bool:
        """Whether the data contradict themselves: some estimates are then none, as the verdict says."""
        return any(estimate.status is Status.DOUBTFUL for estimate in self.estimates)

    @property
    def shortcoming(self) -> str:
        """Why its values, or some of them, are no results; empty where they all are what they claim to be."""
        if not self.converged:
            return "the fit did not converge: these parameters are no result; see the report for what was not excited"
        if self.doubtful:
            return "the data contradict themselves: what is called doubtful is no result; the verdict says why"
        if any(estimate.status is Status.INADEQUATE for estimate in self.estimates):
            return (
                "the actuator does what the model does not have: what is called inadequate is no result; the "
                "verdict says what, and the network says how far its predictions are off"
            )
        return ""

    @property
    def ratios_only(self) -> bool:
        """Whether only the free motion told anything: everything is then per unit of torque gain."""
        return "scale" in self.network.provenance

    def estimate(self, name: str) -> Estimate:
        """Raises KeyError for a name that was not estimated."""
        return {estimate.name: estimate for estimate in self.estimates}[name]


@dataclass(frozen=True)
class Validation:
    """Prediction of segments that no fit has seen: torque under the measured motion, and the free motion itself.

    The sensor's zero is that of the fit. The free motion is that under the torque measured at the port, whose noise and
    that of the position's readings alone put ``velocity_noise_rad_s`` rms between the two.
    """

    torque_rms_nm: float
    torque_relative: float
    velocity_rms_rad_s: float
    velocity_relative: float
    torque: Trace
    velocity: Trace
    velocity_noise_rad_s: float = 0.0


@dataclass(frozen=True)
class SourceMap:
    """The static motion source as measured: steady free velocity against command; arrays of shape (levels,).

    ``rising`` says from which side each level was approached. ``resampled_rad_s`` (resamples, levels) are velocities as
    a repetition of the experiment might have given them: every interval comes from them.
    ``settling_s`` is the time constant with which the shaft was seen to settle, 0 where it was not.
    ``port_torque_nm`` and ``port_torque_std_nm`` (levels,) are the mean torque at the port while each level was held,
    less the sensor's zero: velocities are those without it. Empty where it is not known, and velocities as measured.
    """

    command: FloatArray
    velocity_rad_s: FloatArray
    velocity_std_rad_s: FloatArray
    rising: npt.NDArray[np.bool_]
    resampled_rad_s: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    settling_s: float = 0.0
    port_torque_nm: FloatArray = field(default_factory=lambda: np.empty(0))
    port_torque_std_nm: FloatArray = field(default_factory=lambda: np.empty(0))

    def velocity(self, command: npt.ArrayLike, rising: bool) -> FloatArray:
        """Steady free velocity [rad/s] on one branch, of the shape of ``command``: monotonic between the levels, NaN
        outside them. Raises ExperimentError where that branch was not measured."""
        levels, values, _ = self.branch(rising)
        return np.asarray(self._curve(levels, values, rising)(np.asarray(command, dtype=float)))

    def band(self, command: npt.ArrayLike, rising: bool) -> FloatArray:
        """The 95 % band of :meth:`velocity`, shape (2, ...): lower and upper; NaN where nothing was resampled."""
        levels, _, draws = self.branch(rising)
        if not len(draws):
            return np.full((2, *np.shape(command)), np.nan)
        at = np.asarray(command, dtype=float)
        drawn = [self._curve(levels, draw, rising)(at) for draw in draws]
        return np.asarray(np.quantile(drawn, branches.TAILS, axis=0))

    def dead_zone(self, rising: bool) -> branches.DeadZone | None:
        """The commands between which the shaft rests; None where the branch does not show both ends."""
        levels, values, draws = self.branch(rising)
        return branches.dead_zone(levels, values, draws) if levels.size else None

    def hysteresis(self) -> branches.Hysteresis | None:
        """How far the two branches lie apart; None where the data cannot tell."""
        return branches.hysteresis(self.branch(True), self.branch(False))

    def branch(self, rising: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Command and velocity (levels,) and resamples (resamples, levels) of one branch, where they are known."""
        chosen = (self.rising == rising) & np.isfinite(self.velocity_rad_s)
        draws = self.resampled_rad_s if len(self.resampled_rad_s) else np.empty((0, self.command.size))
        return self.command[chosen], self.velocity_rad_s[chosen], draws[:, chosen]

    @staticmethod
    def _curve(levels: FloatArray, values: FloatArray, rising: bool) -> "scipy.interpolate.PchipInterpolator":
        if np.unique(levels).size < 2:
            side = "rising" if rising else "falling"
            raise ExperimentError(f"the {side} branch of the source was not measured: run the step 'free' to its end")
        return branches.monotone(levels, values)


@dataclass(frozen=True)
class BlockedMap:
    """The Thévenin experiment: torque at standstill against command, by how standstill was reached.

    ``histories`` has "slow", "fast" or "rest" (never moved: it has no side) for each; empty where all were slow.
    """

    command: FloatArray
    torque_nm: FloatArray
    torque_std_nm: FloatArray
    from_above: npt.NDArray[np.bool_]  # True: the shaft came to rest from positive velocity
    histories: tuple[str, ...] = ()

    def chosen(self, history: str) -> npt.NDArray[np.bool_]:
        """Which levels were reached like that, shape (levels,)."""
        return np.array([each == history for each in self.histories or ("slow",) * self.command.size], dtype=bool)


@dataclass(frozen=True)
class LiveEstimate:
    """The state of the live identification at ``stamp_ns``. ``network`` is there once every parameter is valid."""

    stamp_ns: int
    estimates: tuple[Estimate, ...] = ()
    network: NortonNetwork | None = None
    samples: int = field(default=0)


def trace(stretches: "tuple[Signals, ...]", measured: FloatArray, predicted: FloatArray) -> Trace:
    """Both on the whole grid, NaN where nothing was used. Inputs have one value for each usable instant."""
    usable = np.concatenate([stretch.usable for stretch in stretches])
    pair = np.full((2, usable.size), np.nan)
    pair[0, usable], pair[1, usable] = measured, predicted
    time_s = np.concatenate([stretch.time_s for stretch in stretches])
    return Trace(time_s, pair[0], pair[1], "N*m")
