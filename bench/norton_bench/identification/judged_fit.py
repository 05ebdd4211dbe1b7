"""The fit of a recording: as if the model were true, and as its session concludes it, with what the model's own error
makes of it."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.identification.bootstrap import DRAWS, Readings
from norton_bench.identification.cleaning import Cleaned, Findings, clean
from norton_bench.identification.expansion import Expansion
from norton_bench.identification.fit import fit_signals, fit_with_terms
from norton_bench.identification.load import coupling_of
from norton_bench.identification.model_error import (
    ModelError,
    expanded,
    judged,
    milli,
    model_error,
    widened,
)
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.prediction_error import prediction_error
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import Signals, signals, validation_stretches
from norton_bench.models.network import PARAMETER_OF_FIELD, NortonNetwork, impossible
from norton_bench.models.parameters import Estimate, Status
from norton_bench.models.terms import TERM_BY_NAME, TERM_PARAMETERS, Factor, NetworkTerm, parameters_of
from norton_bench.records import Measured
from norton_bench.segments import Use

WITHIN = 1.96  # deviations, of 95 %


# Values that no motor has: what becomes of estimates beyond their bounds, and of the network with them.
def beyond_bounds(network: NortonNetwork) -> tuple[str, ...]:
    """Parameters, by their names, whose values no network file may have."""
    values = {name: getattr(network, field) for field, name in PARAMETER_OF_FIELD.items()}
    return tuple(name for name, value in values.items() if value is not None and impossible(name, value))


def possible(result: FitResult) -> FitResult:
    """The same, with presliding damping no less than none in the network; and said so.

    The estimate keeps its number: zero lies within its interval, or it is at its bound. What else is below zero leaves
    no network that could be used.
    """
    beyond = beyond_bounds(result.network)
    if not beyond:
        return result
    sentences, network = [], result.network
    if "presliding_damping" in beyond:
        network = replace(network, presliding_damping_nms_rad=0.0)
        sentences.append("Presliding damping comes out below zero: the network has none.")
    others = [name.replace("_", " ") for name in beyond if name != "presliding_damping"]
    if others and not result.doubtful:
        sentences.append(f"No network is written, because no machine has values below zero: {', '.join(others)}.")
    estimates = tuple(_bounded(each) if each.name in beyond else each for each in result.estimates)
    return replace(result, network=network, estimates=estimates, verdict=(*result.verdict, *sentences))


def _bounded(estimate: Estimate) -> Estimate:
    """At its bound where even its interval lies below it, not excited where it does not."""
    if estimate.status is not Status.VALID:
        return estimate
    below = estimate.value < -WITHIN * estimate.std
    return replace(estimate, status=Status.AT_BOUND if below else Status.UNEXCITED)


MOST_TERMS = 3
# What is tried for a cause that no fit has values for. Behind a stiff spring a motor leaves what one behind play does;
# and it swings where it is pushed fast, which may look like another motor from there on.
INSTEAD = {"backlash": "compliance", "change": "compliance"}
# The search begins at nothing, but beside a Stribeck velocity: where no friction fades, it has no slope.
START_SHARE = 0.05
NOTHING_TO_VALIDATE_ON = "validation: too little was read without gaps to predict anything; repeat it."


@dataclass(frozen=True)
class JudgedFit:
    """``fitted`` is the fit to ``stretches`` as if the model were true, ``result`` the same with the model's ``error``.

    ``unseen`` are the stretches kept for validation. ``at`` and ``error`` are None where the torque tells no scale.
    ``rejected`` says which term the residual asked for that the fit could not have, and why; empty where there is none.
    """

    fitted: FitResult
    result: FitResult
    stretches: tuple[Signals, ...]
    unseen: tuple[Signals, ...]
    at: Expansion | None
    error: ModelError | None
    rejected: str = ""


def fit(
    measured: Measured, *, command_unit: str, tick_s: float, use: Use = Use.IDENTIFY, draws: int = DRAWS
) -> FitResult:
    """Fit the actuator to every segment meant for ``use``, as if the model were true.

    ``draws`` records are simulated for the deviations (:mod:`norton_bench.identification.bootstrap`); with none of them
    the fit takes a tenth of the time, values and deviations hold only what readings and residual show, and ringing that
    the readings alias may pass for a lag or an inertia. Raises ExperimentError where there is nothing to fit.
    """
    cleaned = clean(measured)
    stretches = signals(cleaned.measured, tick_s, use)
    coupling = coupling_of(cleaned.measured, tick_s) if draws else None
    readings = Readings(cleaned.measured, tick_s, use, draws, coupling) if draws else None
    return fit_signals(stretches, command_unit=command_unit, findings=cleaned.findings, readings=readings)


def fit_judged(cleaned: Cleaned, *, command_unit: str, tick_s: float) -> JudgedFit:
    """Statuses and deviations as a session concludes them. Raises ExperimentError where there is nothing to fit."""
    measured = cleaned.measured
    stretches, unseen = signals(measured, tick_s, Use.IDENTIFY), validation_stretches(measured, tick_s)
    readings = Readings(measured, tick_s, Use.IDENTIFY, coupling=coupling_of(measured, tick_s))
    findings = _findings(cleaned, unseen)
    fitted = possible(fit_signals(stretches, command_unit=command_unit, findings=findings, readings=readings))
    if fitted.ground is not None:
        measured, stretches = fitted.ground.readings.measured, fitted.ground.stretches
        if measured is not cleaned.measured:  # without what rang in it
            unseen = validation_stretches(measured, tick_s)
        if (seen := fitted.ground.readings.errors_seen) is not None:
            unseen = seen.of(unseen)
    plain = looked_at(fitted, stretches, unseen, measured)
    best = _predicting(composed(plain, measured, command_unit=command_unit, findings=findings), measured)
    result = with_terms_named(judged(best.fitted, best.error), plain.fitted)
    return replace(best, result=replace(result, verdict=(*result.verdict, *filter(None, [best.rejected]))))


def looked_at(
    fitted: FitResult, stretches: tuple[Signals, ...], unseen: tuple[Signals, ...], measured: Measured
) -> JudgedFit:
    """A fit with the model's error, not yet judged by it."""
    at = expanded(fitted, stretches, unseen)
    error = None if at is None else model_error(fitted, at, unseen, measured)
    return JudgedFit(fitted, fitted, stretches, unseen, at, error)


def _predicting(best: JudgedFit, measured: Measured) -> JudgedFit:
    """With how far its predictions are off."""
    if best.error is None or best.at is None:
        return best
    standing_nm = best.error.zero.standing_nm
    prediction = prediction_error(best.fitted, best.at, standing_nm, best.stretches, best.unseen, measured)
    return replace(best, error=replace(best.error, prediction=prediction))


def composed(
    before: JudgedFit,
    measured: Measured,
    *,
    command_unit: str,
    findings: Findings,
    allowed: Collection[str] = TERM_BY_NAME.keys(),
) -> JudgedFit:
    """The same with every term that the residual asks for, one after the other: the one that explains the most first.

    The residual asks for a term where that explains what is left of every segment from the others (``departures``). It
    stays where the fit with it converges, its values are known, and less of the torque is left; then the residual is
    looked at again. Only what the table of terms has can be added, and of that what is ``allowed``. What is tried
    instead of something that no fit finds stays only where it leaves nothing but noise.
    """
    for _ in range(MOST_TERMS):
        term = None if before.error is None else asked_for(before.error, before.fitted)
        if term is None or term.name not in allowed:
            return before
        fitted = possible(fit_with_terms(before.fitted, [term], command_unit=command_unit, findings=findings))
        after = looked_at(fitted, before.stretches, before.unseen, measured)
        if why_not := objection(after, before, term):
            return replace(before, rejected=f"The term {term.name} was tried for it, but {why_not}.")
        before = after
    return before


def with_terms_named(result: FitResult, plain: FitResult) -> FitResult:
    """The same with a sentence on each factor that its network has; ``plain`` is the fit of the paper's motor alone."""
    terms = [each.term for each in result.network.relative_terms]
    if not terms:
        return result
    texts = [
        f"Beside the paper's motor the network has a term, because {each.meaning}: {each.equation}." for each in terms
    ]
    texts.append(
        f"The paper's motor alone leaves {milli(plain.torque_rms_nm)} rms of the torque, noise included; with "
        f"{'this term' if len(terms) == 1 else 'these terms'} {milli(result.torque_rms_nm)} are left."
    )
    if any(each.in_time for each in terms):
        texts.append(
            "What changed with time has its values in the middle of the session (t = 0); predictions are for then."
        )
    return replace(result, verdict=(*texts, *result.verdict))


def asked_for(error: ModelError, fitted: FitResult) -> NetworkTerm | None:
    """The term for the departure that explains the most, with relative values to begin from; None where none is."""
    if fitted.ground is None or not error.departures:
        return None
    first = error.departures[0]
    name = INSTEAD.get(first.kind.name, first.kind.name)
    if name not in TERM_BY_NAME or any(each.name == name for each in fitted.network.terms):
        return None
    term = TERM_BY_NAME[name]
    if term.factor is Factor.JOINT and fitted.network.servo is not None:  # its loop acts before the joint
        return None
    # A rigid motor may not settle, or look as if it changed, because of a joint; nothing else explains that.
    wrong = fitted.simulated is None or fitted.doubtful
    if wrong and (term.factor is not Factor.JOINT or any(not check.midway for check in fitted.failed_checks)):
        return None
    parameters = term.parameters
    begin = START_SHARE if any(each.logarithmic for each in parameters) else 0.0
    values = tuple(1.0 if each.logarithmic else begin for each in parameters)
    return NetworkTerm(name, values, first.periods_per_turn)


def objection(after: JudgedFit, before: JudgedFit, asked: NetworkTerm) -> str:
    """Why the fit ``after`` with the term asked for is not to be preferred; empty where it is."""
    if not after.fitted.converged or after.fitted.doubtful or after.error is None:
        return "the fit with it does not converge"
    term = asked.term
    # A joint is there where its stiffness is known; its damping, or what turns beyond it, may be nothing.
    names = [each.name for each in term.parameters if each.logarithmic or term.factor is not Factor.JOINT]
    if any(after.fitted.estimate(name).status is not Status.VALID for name in names):
        return f"its values are not known from this motion. They need {term.excitation}"
    asked_by = before.error.departures[0].kind.name if before.error is not None else term.name
    if asked_by != term.name and (after.error.departures or after.error.unexplained):
        return "more than noise is left with it"
    if after.fitted.torque_rms_nm >= before.fitted.torque_rms_nm:
        return "it leaves no less of the torque"
    return ""


def _findings(cleaned: Cleaned, unseen: tuple[Signals, ...]) -> Findings:
    """And that nothing is left to validate on, where something was meant to be: the fit is worth its while."""
    findings = cleaned.findings
    if unseen or all(segment.use is not Use.VALIDATE for segment in cleaned.measured.segments):
        return findings
    return replace(findings, remarks=(*findings.remarks, NOTHING_TO_VALIDATE_ON))


# Deviations. Chance passes it in less than one session of a hundred where seven parameters are compared (Bonferroni).
SIGNIFICANT_CHANGE = 3.2
COMPARABLE = (Status.VALID, Status.INADEQUATE)


# Live values at the session's end beside the final ones: a parameter that moved meanwhile is reported as moved.
@dataclass(frozen=True)
class Change:
    """One parameter, known at the end of the session and from all of it."""

    live: Estimate
    final: Estimate

    @property
    def deviations(self) -> float:
        """The difference over its deviation, at least: both come from the same data, so their errors agree in part."""
        return float((self.live.value - self.final.value) / np.hypot(self.live.std, self.final.std))

    @property
    def significant(self) -> bool:
        return abs(self.deviations) > SIGNIFICANT_CHANGE

    @property
    def sentence(self) -> str:
        name, unit = self.final.name.replace("_", " ").capitalize(), self.final.unit
        return (
            f"{name} moved during the session: {self.live.value:.4g} ± {self.live.half_interval:.2g} {unit} at its "
            f"end, {self.final.value:.4g} {unit} over all of it. Its interval holds the values in between."
        )


def changes(live: Sequence[Estimate], final: FitResult) -> tuple[Change, ...]:
    """Of what is valid in both; what another model would change in the final fit is compared too. Live values, which
    know nothing of what another encoder told, are moved by as much as it moved the final ones."""
    seen = None if final.ground is None else final.ground.readings.errors_seen
    moved = {} if seen is None else dict(zip(PHYSICAL, seen.moved.tolist(), strict=False))
    known = (each for each in live if each.status is Status.VALID and each.std > 0.0)
    before = {each.name: replace(each, value=each.value + moved.get(each.name, 0.0)) for each in known}
    return tuple(
        Change(before[each.name], each)
        for each in final.estimates
        if each.name in before and each.status in COMPARABLE and each.std > 0.0
    )


def with_what_moved(result: FitResult, fit: FitResult, live: Sequence[Estimate]) -> FitResult:
    """``result`` with a sentence on each parameter whose live values end elsewhere than ``fit``, wide enough for them.

    ``result`` is ``fit`` with the deviations that the model's error gives. What moves evenly past its mean deviates
    from it by the distance to either end over the square root of 3. Live values of another composition tell nothing.
    """
    terms = {parameter.name for parameter in parameters_of(result.network.relative_terms)}
    if terms != {each.name for each in live if each.name in TERM_PARAMETERS}:
        return result
    moved = {change.final.name: change for change in changes(live, fit) if change.significant}
    if not moved:
        return result
    estimates = tuple(_wider(each, moved[each.name]) if each.name in moved else each for each in result.estimates)
    sentences = tuple(change.sentence for change in moved.values())
    return replace(
        result, estimates=estimates, network=widened(result, estimates), verdict=(*sentences, *result.verdict)
    )


def _wider(estimate: Estimate, change: Change) -> Estimate:
    over_time = abs(change.live.value - change.final.value) / np.sqrt(3.0)
    return replace(estimate, std=max(estimate.std, float(np.hypot(change.final.std, over_time))))
