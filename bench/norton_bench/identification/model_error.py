"""The model's own error: how far predictions are off beyond the sensors' noise, and what that goes with.

The network is asked for segments that its values were not fitted to: those kept for validation, and every other one by
a fit without it. Whatever the fit's deviations say, they say it of the model."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import isnan

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.bootstrap import Simulation
from norton_bench.identification.coupling import Coupling
from norton_bench.identification.departures import (
    CHANGE,
    Candidate,
    Departure,
    Kind,
    departures,
    greatest_share,
)
from norton_bench.identification.expansion import Expansion, Linearised
from norton_bench.identification.ladder import Rung, selected
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.prediction_error import mean_squares, of_simulated
from norton_bench.identification.results import FitResult
from norton_bench.identification.ringing import Ringing
from norton_bench.identification.signals import Signals
from norton_bench.identification.simulated_bench import inertia_of
from norton_bench.identification.statistics import NORMAL_95, reach_of_next
from norton_bench.identification.torque_limit import MOVES_AND_RUBS
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import NAN, Estimate, PredictionError, Status
from norton_bench.records import Measured
from norton_bench.segments import Use

# Shares of critical damping: from a single piece of steel's to that of a joint that rubs (Bachmann et al., Vibration
# Problems in Structures, 1995, app. C); what lies between is a sum of some.
RATIOS = (0.01, 0.03, 0.1)
# The stiffness, in deviations from what the calibration tells.
OFF = (-2.0, 0.0, 2.0)


def folded_ringing(simulation: Simulation, result: FitResult, stretches: tuple[Signals, ...]) -> tuple[Candidate, ...]:
    """What readings fold down of the ringing between motor and load, on the torque sensor's spring.

    Each step of a command makes both inertias ring. Where they do so near the rate of the readings, or a multiple
    of it, the readings show it slowly, in the band that is fitted. How much depends on the damping, which the twist
    within that band hardly tells, and on the stiffness; so columns over what both may be stand for it.

    A departure of the readings, over the rows of an expansion of these ``stretches``, each of which lies in a simulated
    one; none where no ringing is folded into the band.
    """
    coupling, at = simulation.readings.coupling, Linearised.at(result)
    if coupling is None:
        return ()
    inertia_kgm2 = inertia_of(simulation.solution)
    resonance_hz = coupling.resonance_hz(inertia_kgm2)
    rate_hz = 1.0 / simulation.torque.period_s
    folded_hz = abs(resonance_hz - round(resonance_hz / rate_hz) * rate_hz)
    if resonance_hz < 0.5 * rate_hz or folded_hz * simulation.readings.tick_s > at.band.cutoff:
        return ()
    ringing = Ringing.of(simulation, coupling, stretches)
    columns = [ringing.read(spring, at.band) for spring in _springs(coupling, inertia_kgm2)]
    return ((_kind(resonance_hz, rate_hz), 0, np.stack(columns)),)


def _springs(coupling: Coupling, inertia_kgm2: float) -> Iterator[Coupling]:
    for off, ratio in product(OFF, RATIOS):
        yield coupling.stiffer(off).damped(ratio, inertia_kgm2)


def _kind(resonance_hz: float, rate_hz: float) -> Kind:
    return Kind(
        "ringing",
        "ringing that the torque readings fold down",
        f"motor and load ring on the torque sensor's spring at some {resonance_hz:.0f} Hz, and it is read at "
        f"{rate_hz:.0f} Hz; the motor is not to blame, and a softer or a stiffer sensor would mend that",
        "folded ringing",
    )


# More than this share of what is left is no noise: then there is something, even where nothing looked at explains it.
UNEXPLAINED = 0.5
TWICE = 2.0
# Chance passes it in one session of two hundred.
CERTAIN = 0.995


@dataclass(frozen=True)
class Zero:
    """The torque sensor's zero [N m] when it was read at rest before anything moved, in the fit and as it was read.

    The fit's goes on as evenly as it drifts over the session. ``std_nm`` is that of the difference.
    """

    fitted_nm: float
    tare_nm: float = NAN
    std_nm: float = NAN

    @property
    def moved_nm(self) -> float:
        """By how much the two differ; NaN where nothing was read at rest."""
        return self.fitted_nm - self.tare_nm

    @property
    def standing_nm(self) -> float:
        """What of the fitted zero is no zero: a torque that stands there whenever the shaft moves. None where chance
        may have made it."""
        return self.moved_nm if abs(self.moved_nm) > NORMAL_95 * self.std_nm else 0.0


@dataclass(frozen=True)
class ModelError:
    """``rms_nm`` is what the network leaves of the torque on segments that its values were not fitted to, beyond the
    ``noise_nm`` of the readings; ``left_nm`` the same, were all ``departures`` in the model.

    It is ``unexplained`` where most of that is neither noise nor what ticks and counts leave open, or where the fit
    leaves ``times_simulated`` the mean square that errors of the readings alone leave of simulated records (NaN where
    that is not so much).
    ``spread`` (7,) is how far each of motor_values.PHYSICAL moves, relative, when segments are left out one by one
    (jackknife).
    ``prediction`` is empty until it is worked out (``prediction_error``).
    """

    rms_nm: float
    noise_nm: float
    left_nm: float
    departures: tuple[Departure, ...]
    spread: FloatArray
    zero: Zero
    unexplained: bool = False
    times_simulated: float = NAN
    prediction: PredictionError = field(default_factory=PredictionError)

    @property
    def change(self) -> FloatArray:
        """How far the terms that were named move each of motor_values.PHYSICAL, relative, shape (7,)."""
        return self.departures[-1].change if self.departures else np.zeros(len(PHYSICAL))


def expanded(result: FitResult, fitted: Sequence[Signals], unseen: Sequence[Signals]) -> Expansion | None:
    """The equation about a fit to ``fitted``; None where torque tells no scale, or the friction is none.

    A fit that did not converge has one too: what the model lacks may be why.
    """
    if result.ratios_only or any(each.torque_nm is None for each in (*fitted, *unseen)):
        return None
    if min(result.network.coulomb_torque_nm, result.network.presliding_stiffness_nm_rad) <= 0.0:
        return None
    return Expansion.of(result, fitted, unseen)


def model_error(result: FitResult, at: Expansion, unseen: Sequence[Signals], measured: Measured) -> ModelError:
    """Of a fit expanded ``at`` its own values."""
    found, usual = _named(result, at, unseen)
    zero = _zero(result, at, measured)
    squares, noise_nm2 = mean_squares(at, zero.standing_nm)
    beyond = max(float(np.mean(squares)) - noise_nm2, 0.0)
    left = found[-1].left_nm ** 2 if found else _without_cogging(at)
    times_simulated = NAN if found else _times_simulated(result)
    return ModelError(
        rms_nm=float(np.sqrt(beyond)),
        noise_nm=float(np.sqrt(noise_nm2)),
        left_nm=float(np.sqrt(max(left - noise_nm2, 0.0))),
        unexplained=_mostly_no_noise(at, left, usual) or not isnan(times_simulated),
        times_simulated=times_simulated,
        departures=found,
        spread=_spread(at),
        zero=zero,
    )


@dataclass(frozen=True)
class _Usual:
    """What errors of the readings alone do, at most: the share of the mean square that looks like some departure, and
    the mean square that the model leaves [N² m²]."""

    share: float = 0.0
    left_nm2: float = 0.0


def _named(result: FitResult, at: Expansion, unseen: Sequence[Signals]) -> tuple[tuple[Departure, ...], _Usual]:
    """What is no error of the readings; the simulated records are only asked where something is to be named, or much
    is left."""
    found, usual = departures(at), _Usual()
    suspicious = found or _mostly_no_noise(at, _without_cogging(at), usual)
    if suspicious and result.simulated is not None:
        fitted = result.simulated.bench
        simulation = fitted.over(tuple(unseen))
        usual = _usual(result, simulation)
        found = departures(at, usual.share)
        if found or _mostly_no_noise(at, _without_cogging(at), usual):
            # The simulated records ring as the calibration has it; it may be otherwise.
            found = departures(at, usual.share, folded_ringing(simulation, result, (*fitted.stretches, *unseen)))
    return _told_apart(at, found, usual), usual


def _usual(result: FitResult, simulation: Simulation) -> _Usual:
    """From the records that were simulated with the fit for the truth. What they show of an error is known to its own
    size, as a bias is: it may be twice that."""
    share, left_nm2 = 0.0, 0.0
    for _, at in of_simulated(result, simulation):
        share, left_nm2 = max(share, greatest_share(at)), max(left_nm2, _without_cogging(at))
    return _Usual(TWICE**2 * share, left_nm2)


def _told_apart(at: Expansion, result: tuple[Departure, ...], usual: _Usual) -> tuple[Departure, ...]:
    """Only the first where all of them leave more than noise: what comes next may be what its terms left of it."""
    return result[:1] if result and _mostly_no_noise(at, result[-1].left_nm ** 2, usual) else result


def _mostly_no_noise(at: Expansion, left_nm2: float, usual: _Usual) -> bool:
    """Whether more than UNEXPLAINED of what is left is neither noise nor what ticks and counts leave open."""
    return (1 - UNEXPLAINED) * left_nm2 > max(at.noise_nm2 + at.unknown_nm2, usual.left_nm2)


def _times_simulated(result: FitResult) -> float:
    """NaN unless it is certainly more than once, and more than UNEXPLAINED of what is left may be no error of readings.

    A wrong model and errors that no simulation has, such as those of a path within an encoder's counts, may fit as well
    as the right ones do on every part of a recording: what they leave is the only sign of them.
    """
    if result.simulated is None:
        return NAN
    seen = result.simulated.bench.readings.errors_seen
    if seen is not None and seen.factor > 1.0:  # the simulated encoder errs only as its own readings show
        return NAN
    left = result.simulated.left
    share = float(np.mean(left))
    certain = share + reach_of_next(left, CERTAIN) < 1.0
    most = share - reach_of_next(left, 0.975) < 1.0 - UNEXPLAINED
    return 1.0 / share if certain and most else NAN


def judged(result: FitResult, error: ModelError | None) -> FitResult:
    """The same fit with what the model's error makes of deviations, statuses, verdict and network.

    A value that the missing part of the model moves by more than its own deviation is no estimate of a motor's
    constant. One sentence a departure; what only looked like a change at some instant is no longer said.
    """
    if error is None:
        return result
    result = replace(result, network=replace(result.network, prediction=error.prediction))
    if not error.departures and not error.unexplained:
        return result
    named = any(each.kind is not CHANGE for each in error.departures)
    looked_like = tuple(check for check in result.failed_checks if check.midway and named)
    told = replace(
        result,
        failed_checks=tuple(check for check in result.failed_checks if check not in looked_like),
        verdict=tuple(text for text in result.verdict if text not in {check.sentence for check in looked_like}),
    )
    undoubted = bool(looked_like) and not told.failed_checks
    estimates = judged_estimates(result.estimates, error, undoubted=undoubted)
    concerned = [each.name for each in estimates if each.status is Status.INADEQUATE]
    texts = sentences(error, concerned)
    network = widened(result, estimates).with_provenance({"model": texts[0]})
    return replace(told, estimates=estimates, network=network, verdict=(*texts, *told.verdict))


def widened(result: FitResult, estimates: Sequence[Estimate]) -> NortonNetwork:
    """The network with the deviations of ``estimates``, correlated as they were."""
    network = result.network
    std = {estimate.name: estimate.std for estimate in estimates}
    wider = np.array([std[name] / max(result.estimate(name).std, 1e-300) for name in network.covariance_names])
    covariance = np.asarray(network.covariance) * np.outer(wider, wider)
    return replace(network, covariance=tuple(tuple(float(value) for value in row) for row in covariance))


def judged_estimates(
    estimates: Iterable[Estimate], error: ModelError, *, undoubted: bool = False
) -> tuple[Estimate, ...]:
    """With what the model's error makes of deviations and statuses.

    The limit of a servo's torque is what its motor gave when what moves and rubs is taken off: as good as those values.
    """
    judged = tuple(_judged(each, error, undoubted=undoubted) for each in estimates)
    inadequate = {each.name for each in judged if each.status is Status.INADEQUATE}
    if inadequate.isdisjoint(MOVES_AND_RUBS):
        return judged
    return tuple(replace(each, status=Status.INADEQUATE) if each.name == "torque_limit" else each for each in judged)


def _judged(estimate: Estimate, error: ModelError, *, undoubted: bool) -> Estimate:
    status = Status.VALID if undoubted and estimate.status is Status.DOUBTFUL else estimate.status
    # Torque constant and amplifier gain are shares of the torque gain, and move as it does.
    name = "torque_gain" if estimate.name in ("torque_constant", "amplifier_gain") else estimate.name
    # How far terms that are missing move the terms that are there is not worked out.
    at = [PHYSICAL.index(name)] if name in PHYSICAL else []
    moved, spread = (float(np.sum(share[at])) * abs(estimate.value) for share in (np.abs(error.change), error.spread))
    if status is Status.VALID and (error.unexplained or moved > estimate.std):
        status = Status.INADEQUATE
    return replace(estimate, std=max(estimate.std, float(np.hypot(moved, spread))), status=status)


def sentences(error: ModelError, concerned: Sequence[str]) -> tuple[str, ...]:
    """What is wrong with the model, how much that is, and which values are not to be built upon."""
    texts = [_sentence(each) for each in error.departures]
    if error.unexplained:
        but = "; nothing else that was looked at explains it" if texts else "; nothing that was looked at explains it"
        left = f"{'beyond that ' if texts else ''}it leaves {milli(error.left_nm)} rms of the torque that is not noise"
        if not isnan(error.times_simulated):
            left = f"its fit leaves {error.times_simulated:.1f} times the power that the readings' errors alone would"
        texts.append(f"The model is inadequate: {left}{but}.")
    if concerned:
        names = ", ".join(name.replace("_", " ") for name in concerned)
        texts.append(f"Not to be built upon, because another model gives other values: {names}.")
    return tuple(texts)


def of_ladder(rungs: Sequence[Rung]) -> tuple[str, ...]:
    """Which friction model leaves less than Dahl's on data held out, in a sentence; none where Dahl's is selected."""
    dahl = next((rung for rung in rungs if rung.name == "dahl"), None)
    if dahl is None or dahl.selected or not rungs:
        return ()
    best = selected(rungs)
    return (
        f"Of the friction models, {best.name} does best on data held out: it leaves {milli(best.held_out_rms)} rms "
        f"where Dahl's, the network's own, leaves {milli(dahl.held_out_rms)}.",
    )


def _sentence(result: Departure) -> str:
    where = f" ({result.periods_per_turn} a turn)" if result.periods_per_turn else ""
    return (
        f"The model is inadequate: {milli(result.rms_nm)} rms of the torque, {result.share:.0%} of the variance it "
        f"leaves, goes with {result.kind.goes_with}{where}: {result.kind.cause}. "
        f"With a term for it ({result.kind.term}) {milli(result.left_nm)} would be left."
    )


def milli(value_nm: float) -> str:
    """In mN*m, to two digits."""
    return f"{1e3 * value_nm:.2g} mN*m"


def _without_cogging(at: Expansion) -> float:
    """The mean square that the fit's own equation leaves."""
    sums = at.sums
    every = np.arange(len(at.jacobian))
    return sums.left(every, sums.solved(every)) / sums.count


def _spread(at: Expansion) -> FloatArray:
    """The jackknife's deviation of each of motor_values.PHYSICAL, relative, over segments; shape (7,)."""
    sums = at.sums
    every = np.arange(len(at.jacobian))
    parts = np.unique(sums.part)
    shifts = np.stack([at.physical(sums.solved(every, int(part)) / sums.scale) for part in parts])
    return np.asarray(np.sqrt((parts.size - 1) * np.var(shifts, axis=0)))


def _zero(result: FitResult, at: Expansion, measured: Measured) -> Zero:
    zero = at.zero if result.torque_zero is None else result.torque_zero
    rests = [each for each in measured.segments if each.use is Use.TARE and each.name == "rest"]
    if not rests:
        return Zero(float(zero.value_nm[0]))
    rest_s = 1e-9 * (0.5 * (rests[0].start_ns + rests[0].end_ns) - float(measured.ticks["tick_ns"][0]))
    fitted_nm, fitted_std_nm = zero.before(rest_s)
    torque = measured.between(rests[0].start_ns, rests[0].end_ns).torque
    values = np.asarray(torque["torque_nm"][torque["valid"]], dtype=np.float64)
    if values.size < 2:
        return Zero(fitted_nm)
    std_nm = float(np.hypot(np.std(values) / np.sqrt(values.size), fitted_std_nm))
    return Zero(fitted_nm, float(np.mean(values)), std_nm)
