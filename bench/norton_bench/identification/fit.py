"""The final fit of the Norton network, in impedance form and without an initial guess (paper, section IV.D).

Torque under the measured motion is linear in gain, inertia, damping, Coulomb torque and presliding damping once the
amplifier's bandwidth, the shape of the friction and two delays are given: see docs/identification.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.bootstrap import Readings, Simulation, scatter_of
from norton_bench.identification.cleaning import NOTHING_FOUND, Findings
from norton_bench.identification.current import Known, fit_current
from norton_bench.identification.joint_fit import solve_behind
from norton_bench.identification.motor_values import PHYSICAL, covariance_of, physical, stated_by_name
from norton_bench.identification.other_encoder import with_errors_seen
from norton_bench.identification.results import (
    FitResult,
    Ground,
    SensorZero,
    Simulated,
    loose_directions,
    trace,
    verdict,
)
from norton_bench.identification.ringing import remark_on, without_ringing
from norton_bench.identification.sanity_checks import (
    LEAST_EVIDENCE,
    FailedCheck,
    beyond_noise,
    comes_out_negative,
    failed_checks,
    scale_evidence,
    status_of,
    why_no_scale,
)
from norton_bench.identification.search_box import limits
from norton_bench.identification.separable import Solution, solve, solve_with_terms
from norton_bench.identification.shape import MOTOR_VALUES
from norton_bench.identification.signals import Port, Signals
from norton_bench.identification.simulated_bench import inertia_of
from norton_bench.identification.statistics import LOOSE_BEYOND, with_lag_as_told
from norton_bench.identification.term_estimates import cogging_found, terms_found, waves_found
from norton_bench.identification.torque_limit import torque_limit
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import BY_NAME, Estimate, Status
from norton_bench.models.terms import Factor, NetworkTerm, joint_of, parameters_of

PRESLIDING = ("presliding_stiffness", "presliding_damping")
# Of an encoder in the presliding length. The smoothed path is off by 0.15 counts near turns, and such errors in
# variables reduce the stiffness by about 5 (0.15 counts / length)², the damping making up for it: 1 % at three counts,
# as much as the deviations that fits state. Simulated records show half of it at most, for their true path is a
# smoothed one. The factor is that of benches of `benchmarks/wide_family.py`, where the true path gave the true values.
# Where the residual is so many times what simulated records leave, the path's error may be as many times greater, and
# the stiffness is reduced as by counts that are as many times coarser.
FEWEST_COUNTS = 3.0

# What free motion tells only as a ratio to the torque gain.
PER_GAIN = tuple(name for name in PHYSICAL if name not in ("torque_gain", "amplifier_bandwidth"))


def fit_signals(
    stretches: tuple[Signals, ...],
    *,
    command_unit: str,
    port: Port = Port.ACTUATOR,
    findings: Findings = NOTHING_FOUND,
    cogging: tuple[float, ...] = (),
    readings: Readings | None = None,
    both_driven: bool = False,
) -> FitResult:
    """Fit the motor to signals that are on one grid. ``findings`` are those of their cleaning.

    ``cogging`` are periods a turn of torques that are known to go with the position; others are looked for.
    ``readings`` are what the signals were made of; without them the deviations hold only what the residual shows, and
    nothing that simulated records tell is taken off the values. With ``both_driven`` both machines pushed on purpose,
    as they do for a load: a noisy sensor then hides no scale. Raises ExperimentError where no command was given.
    """
    solution = solution_of(stretches, port=port, findings=findings, cogging=cogging, both_driven=both_driven)
    readings = None if findings.doubts else readings
    if readings is not None:
        readings, stretches, solution = with_errors_seen(*without_ringing(readings, stretches, solution))
    return result_of(stretches, solution, command_unit=command_unit, findings=findings, readings=readings)


def solution_of(
    stretches: tuple[Signals, ...],
    *,
    port: Port = Port.ACTUATOR,
    findings: Findings = NOTHING_FOUND,
    cogging: tuple[float, ...] = (),
    both_driven: bool = False,
) -> Solution:
    """The equation solved; for the motion alone where torque sets no scale. Arguments and errors as in fit_signals."""
    if not any(np.ptp(stretch.command) > 0.0 for stretch in stretches):
        raise ExperimentError(f"the {port.value} was never commanded: nothing can be learned of its forward path")
    measured = all(stretch.torque_nm is not None for stretch in stretches)
    doubtful = bool(findings.doubts)
    solution = solve(stretches, free_motion=not measured, roughly=doubtful, cogging=cogging)
    determined = measured and scale_evidence(solution) >= LEAST_EVIDENCE * (
        beyond_noise(solution) ** 0.5 if both_driven or port is Port.LOAD else 1.0
    )
    if port is Port.LOAD and (not determined or comes_out_negative(solution, covariance_of(solution))):
        raise ExperimentError(why_no_scale(solution))
    if measured and not determined:
        solution = solve(stretches, free_motion=True, roughly=doubtful, cogging=cogging)
    return solution


def fit_with_terms(
    before: FitResult, terms: Sequence[NetworkTerm], *, command_unit: str, findings: Findings = NOTHING_FOUND
) -> FitResult:
    """The fit ``before`` with ``terms`` more: relative values, from which to begin; a joint begins anywhere.

    The terms that it has already go on from where they are; one joint takes the place of another. Raises ValueError for
    a fit that was made without the readings to simulate records by.
    """
    if before.ground is None:
        raise ValueError("terms are added to a fit whose deviations come from simulated records")
    ground, kept = before.ground, before.ground.solution.shape.terms
    if joint_of(terms) is not None:
        kept = tuple(each for each in kept if each.term.factor is not Factor.JOINT)
    solution = solution_with(ground.solution, (*kept, *terms), before.torque_bias_nm)
    return result_of(ground.stretches, solution, command_unit=command_unit, findings=findings, readings=ground.readings)


def solution_with(near: Solution, terms: Sequence[NetworkTerm], zero_nm: float) -> Solution:
    """The equation solved once more, with ``terms``: relative values, where to begin; ``zero_nm`` is the sensor's."""
    solve_composed = solve_with_terms if joint_of(terms) is None else solve_behind
    return solve_composed(near, terms, zero_nm)


@dataclass(frozen=True)
class _NetworkTerms:
    """The solution in the terms of the network. ``ratios`` are what is known per unit of gain where no scale is."""

    estimates: tuple[Estimate, ...]
    network: NortonNetwork
    ratios: tuple[Estimate, ...]
    has_current: bool

    def verdict(
        self, solution: Solution, values: FloatArray, covariance: FloatArray, failed: Sequence[FailedCheck]
    ) -> tuple[str, ...]:
        """Sentences on what is known, and what is not."""
        loose = loose_directions(PHYSICAL, _relative(solution, values, covariance))
        known = verdict(
            self.estimates, loose, ratios=self.ratios, converged=solution.converged, has_current=self.has_current
        )
        return (*(each.sentence for each in failed), *known)


def result_of(
    stretches: tuple[Signals, ...],
    solution: Solution,
    *,
    command_unit: str,
    findings: Findings = NOTHING_FOUND,
    readings: Readings | None = None,
) -> FitResult:
    """What a solution says of the motor. Arguments as in fit_signals."""
    regression, target = solution.regression, solution.regression.target()
    of_unknowns = covariance_of(solution)
    values, covariance, simulated = _values(stretches, solution, of_unknowns, readings)
    covariance = with_lag_as_told(values, covariance, PHYSICAL.index("amplifier_bandwidth"))
    deviations = np.sqrt(np.diag(covariance))
    failed = (*map(FailedCheck, findings.doubts), *failed_checks(solution, values, deviations, stretches[0].tick_s))
    fewest, remarks = _fewest_counts(simulated), _remarks(findings, readings, solution)
    terms = _in_terms_of_network(stretches, solution, values, covariance, command_unit, failed, fewest)
    to_torque = float(abs(values[PHYSICAL.index("inertia")])) if solution.free_motion else 1.0
    rms = float(np.sqrt(np.mean(solution.residual**2)))
    return FitResult(
        estimates=terms.estimates,
        network=terms.network,
        converged=solution.converged,
        torque_rms_nm=rms * to_torque,
        torque_relative=rms / float(np.sqrt(np.mean(target**2))),
        samples=len(target),
        command_delay_s=float(values[7] - values[8] if solution.free_motion else values[7]),
        command_delay_std_s=float(deviations[7]),
        motion_delay_s=float(values[8]),
        motion_delay_std_s=float(deviations[8]),
        trace=trace(stretches, target * to_torque, (target - solution.residual) * to_torque),
        band=regression.rows[0].kernel,
        cogging=cogging_found(solution, of_unknowns, to_torque),
        torque_bias_nm=bias_of(solution),
        middle_s=regression.middle_s,
        torque_zero=_zero(solution, of_unknowns),
        simulated=simulated,
        ground=None if readings is None else Ground(stretches, solution, readings),
        verdict=(*terms.verdict(solution, values, covariance, failed), *_unresolved(solution, fewest), *remarks),
        failed_checks=failed,
    )


def _presliding_counts(solution: Solution) -> float:
    """How many encoder counts the presliding length is."""
    count_rad = solution.regression.count_rad
    return float("inf") if count_rad == 0.0 else 1.0 / (solution.shape.s_per_rad * count_rad)


def _fewest_counts(simulated: Simulated | None) -> float:
    """How many the presliding length must be, for its stiffness and damping to be told."""
    return FEWEST_COUNTS * max(1.0, 1.0 if simulated is None else simulated.excess["presliding_stiffness"])


def _unresolved(solution: Solution, fewest_counts: float) -> tuple[str, ...]:
    """A sentence on a presliding length that the encoder does not resolve; none where it does."""
    counts, length_mrad = _presliding_counts(solution), 1e3 / solution.shape.s_per_rad
    if counts >= fewest_counts:
        return ()
    more = "" if counts < FEWEST_COUNTS else ", on motion that is less smooth than its counts tell"
    return (
        f"The encoder does not resolve a presliding length of {length_mrad:.2g} mrad, {counts:.1f} counts{more}: "
        "presliding stiffness and damping depend on how counts are smoothed. Counts of "
        f"{length_mrad / fewest_counts:.2g} mrad or finer would resolve them.",
    )


def _remarks(findings: Findings, readings: Readings | None, solution: Solution) -> tuple[str, ...]:
    """What was done to the readings before they were fitted."""
    return (*findings.remarks, *(() if readings is None else remark_on(readings, inertia_of(solution))))


def _values(
    stretches: tuple[Signals, ...], solution: Solution, of_unknowns: FloatArray, readings: Readings | None
) -> tuple[FloatArray, FloatArray, Simulated | None]:
    """Values (9,) and covariance (9, 9) as :func:`physical` has them, corrected by simulated records if there are any.

    Free motion is not simulated: its torque is nil, and what is measured of it follows from nothing else.
    """
    values, covariance = physical(solution, of_unknowns)
    if readings is None or not solution.converged or solution.free_motion:
        return values, covariance, None
    return _simulated(Simulation.of(readings, stretches, solution), values, covariance)


def _simulated(
    bench: Simulation, values: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray, Simulated]:
    """Values (9,) and covariance (9, 9) as simulated records correct them, and what they were before.

    Ringing is faster than anything that was measured of the motors: what its subtraction changes is known only as well
    as its amplitudes are, over and above how well the readings tell the spring.
    """
    scatter = scatter_of(bench, values, physical)
    of_residual = stated_by_name(bench.solution, values, covariance)
    of_ringing = np.zeros_like(covariance)
    if (known := bench.readings.ringing_covariance) is not None:
        of_ringing[: len(known), : len(known)] = known
    repeated_std, excess = (
        dict(zip(of_residual, each.tolist(), strict=True))
        for each in (np.sqrt(scatter.bias_std**2 + np.diag(of_ringing)), scatter.excess(covariance))
    )
    values, covariance = scatter.applied(values, covariance)
    covariance = covariance + of_ringing
    return values, covariance, Simulated(of_residual, repeated_std, excess, scatter.left, bench)


def _in_terms_of_network(
    stretches: tuple[Signals, ...],
    solution: Solution,
    values: FloatArray,
    covariance: FloatArray,
    command_unit: str,
    failed_checks: tuple[FailedCheck, ...],
    fewest_counts: float,
) -> _NetworkTerms:
    deviations = np.sqrt(np.diag(covariance))
    statuses = _statuses(solution, values, deviations, stretches[0].tick_s, fewest_counts)
    estimates = [
        Estimate(name, float(value), float(std), BY_NAME[name].unit_for(command_unit), status)
        for name, value, std, status in zip(PHYSICAL, values, deviations, statuses, strict=False)
    ]
    gain, bandwidth = (Known(float(values[at]), float(deviations[at])) for at in (0, 1))
    current = fit_current(stretches, bandwidth, float(values[7]), gain)
    if current is not None:
        estimates += current.estimates(command_unit, statuses[0])
    limit = torque_limit(solution, values, covariance)
    estimates += [] if limit is None else [limit]
    terms = terms_found(solution, values, covariance, command_unit)
    estimates += [estimate for _, own in terms for estimate in own]
    network = network_of(estimates, command_unit, covariance, tuple(term for term, _ in terms))
    waves = waves_found(solution, float(abs(values[PHYSICAL.index("inertia")])) if solution.free_motion else 1.0)
    network = replace(network, servo=stretches[0].servo, terms=(*network.terms, *waves))
    ratios: tuple[Estimate, ...] = ()
    if solution.free_motion:
        ratios = tuple(estimate for estimate in estimates if estimate.name in PER_GAIN and not failed_checks)
        network = replace(network, provenance={"scale": "free motion only: everything per unit of torque gain"})
        estimates = [_without_scale(estimate) for estimate in estimates]
    judged = tuple(replace(each, status=status_of(each.status, each.name, failed_checks)) for each in estimates)
    return _NetworkTerms(judged, network, ratios, current is not None)


def _relative(solution: Solution, values: FloatArray, covariance: FloatArray) -> FloatArray:
    """Covariance of the logarithms of PHYSICAL; a scale that free motion leaves open has a variance of 1e6."""
    size = np.maximum(np.abs(values[:7]), 1e-300)
    relative = covariance[:7, :7] / np.outer(size, size)
    if not solution.free_motion:
        return np.asarray(relative)
    scaled = np.array([float(name != "amplifier_bandwidth") for name in PHYSICAL])
    return np.asarray(relative + 1e6 * np.outer(scaled, scaled))


def bias_of(solution: Solution) -> float:
    """The mean of the bias's basis functions, which follow the linear unknowns and the pairs of the cogging."""
    return 0.0 if solution.free_motion else float(np.mean(solution.linear[5 + 2 * len(solution.regression.cogging) :]))


def _zero(solution: Solution, covariance: FloatArray) -> SensorZero | None:
    """The bias's basis functions, with their part of the unknowns' ``covariance``; None where no torque was fitted."""
    if solution.free_motion:
        return None
    time_s, unknowns = solution.regression.time_s(), len(solution.linear)
    first = 5 + 2 * len(solution.regression.cogging)
    knots_s = np.linspace(np.min(time_s), np.max(time_s), unknowns - first)  # as `linear_basis` has them
    return SensorZero(knots_s, solution.linear[first:], covariance[first:unknowns, first:unknowns])


def _without_scale(estimate: Estimate) -> Estimate:
    """No number where only a ratio is known; what is known on its own stays."""
    if estimate.name in ("amplifier_bandwidth", "amplifier_gain") or estimate.status is not Status.VALID:
        return estimate
    return replace(estimate, value=float("nan"), std=float("nan"), status=Status.RATIO_ONLY)


def _statuses(
    solution: Solution, values: FloatArray, deviations: FloatArray, tick_s: float, fewest_counts: float
) -> list[Status]:
    numbers, held = zip(PHYSICAL, values[:7], deviations[:7], strict=True), _at_bound(solution, tick_s)
    unresolved = PRESLIDING if _presliding_counts(solution) < fewest_counts else ()
    return [_status(solution, held, unresolved, *each) for each in numbers]


def _status(
    solution: Solution, at_bound: set[str], unresolved: tuple[str, ...], name: str, value: float, deviation: float
) -> Status:
    if not solution.converged:
        return Status.NOT_CONVERGED
    if name in at_bound or (value < 0 and name not in ("torque_gain", "presliding_damping")):
        return Status.AT_BOUND
    if name in unresolved:
        return Status.UNEXCITED
    known = deviation <= LOOSE_BEYOND * abs(value) or (name == "torque_gain" and solution.free_motion)
    return Status.VALID if known else Status.UNEXCITED


def _at_bound(solution: Solution, tick_s: float) -> set[str]:
    low, high = limits(tick_s)
    at, width = solution.shape.as_array()[: low.size], high - low
    held = (at - low < 1e-3 * width) | (high - at < 1e-3 * width)
    return {name for name, hit in zip(("amplifier_bandwidth", "presliding_stiffness"), held, strict=False) if hit}


def network_of(
    estimates: Sequence[Estimate],
    command_unit: str,
    covariance: FloatArray | None = None,
    terms: tuple[NetworkTerm, ...] = (),
) -> NortonNetwork:
    """The network with these values; ``covariance`` is that of PHYSICAL, or as :func:`physical` has it."""
    more = [parameter.name for parameter in parameters_of(terms)]
    kept = [*range(len(PHYSICAL)), *range(MOTOR_VALUES, MOTOR_VALUES + len(more))]
    return NortonNetwork.of_parameters(
        {estimate.name: estimate.value for estimate in estimates},
        command_unit,
        covariance_names=() if covariance is None else (*PHYSICAL, *more),
        covariance=() if covariance is None else tuple(tuple(row[kept].tolist()) for row in covariance[kept]),
        terms=terms,
    )
