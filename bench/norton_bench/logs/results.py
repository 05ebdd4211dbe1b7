"""What the fit of a foreign log says."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.friction_model import Dimension
from norton_bench.identification.ladder import FrictionFit
from norton_bench.identification.results import Direction, Trace, loose_directions
from norton_bench.logs.between import Compared
from norton_bench.logs.delays import COMMAND, EXERTION, SHIFT, with_delays
from norton_bench.logs.equation import Problem
from norton_bench.logs.log_units import Units
from norton_bench.logs.predictions import Predictions
from norton_bench.models.parameters import Estimate, Status


@dataclass(frozen=True)
class ErrorFigures:
    """How far a prediction is from what was measured, ``rms`` and ``mean_absolute`` in ``unit``.

    ``relative`` is the rms over that of the quantity: of exertion as it stands, of a position about its mean.
    """

    rms: float
    relative: float
    mean_absolute: float
    unit: str

    @classmethod
    def of(cls, residual: FloatArray, scale: float, unit: str) -> "ErrorFigures | None":
        """None where there is no sample."""
        if not residual.size:
            return None
        rms = float(np.sqrt(np.mean(residual**2)))
        return cls(rms, rms / scale if scale > 0 else float("nan"), float(np.mean(np.abs(residual))), unit)


@dataclass(frozen=True)
class Errors:
    """Of one side of the split; None for what was not measured or cannot be predicted."""

    exertion: ErrorFigures | None = None
    motion: ErrorFigures | None = None


@dataclass(frozen=True)
class Step:
    """One model of the ladder; relative errors are over the rms of the exertion."""

    model: str
    train_relative: float
    held_out_relative: float
    held_out_std: float
    selected: bool
    estimates: tuple[Estimate, ...]


@dataclass(frozen=True)
class LogFit:
    """One fit. ``doubtful`` says that the log contradicts itself or the equation: no estimate is then valid.

    ``totals`` are Coulomb and viscous friction in total, whatever the model. ``alarms`` say that the fit does not hold
    on the test, and why. ``between`` are the parts of the training data, fitted apart.
    """

    model: str
    estimates: tuple[Estimate, ...]
    verdict: tuple[str, ...]
    converged: bool
    doubtful: bool
    train: Errors
    test: Errors
    ladder: tuple[Step, ...]
    exertion: Trace
    totals: tuple[Estimate, ...] = ()
    alarms: tuple[str, ...] = ()
    between: Compared | None = None
    predictions: Predictions | None = None


# Beyond so many deviations a sign is no accident.
SURE = 2.0
# An estimate less certain than this, relative to itself, is none.
UNEXCITED_BEYOND = 0.5
# What is never negative.
POSITIVE = ("inertia", "link_stiffness", "link_damping")
# These may be nothing at all, and then have a deviation beyond their value.
MAY_VANISH = ("offset", "cogging_", "stribeck_torque")
# Any harmonic of gravity may be nothing, too; but together they are not.
HARMONIC = "gravity_"
PER_DEGREE = "_per_degree"
# One of many elements of a contact, of which most may have no strength: their sum is what counts.
ELEMENT = "slip_torque"


# The values of a fit as estimates: each with a unit, a deviation and a status.
def unit_of(name: str, fit: FrictionFit, units: Units) -> str:
    """The unit of a value of the fit."""
    dimension = fit.dimension(name)
    if dimension is not None:
        return dimension.unit(rotation=units.motion == "rad")
    if name.endswith(PER_DEGREE):
        dimension = Dimension.DAMPING if name.startswith("viscous") else Dimension.FRICTION
        return f"{dimension.unit(rotation=units.motion == 'rad')}/K"
    known = {"torque_gain": units.gain, "inertia": units.inertia, COMMAND: "s", EXERTION: "s", **units.link}
    return known.get(name, units.exertion)


def estimates_of(problem: Problem, fit: FrictionFit, units: Units, *, doubtful: bool) -> tuple[Estimate, ...]:
    """In the order of the fit; delays with what has been put in place beforehand."""
    return tuple(
        Estimate(name, value, std, unit_of(name, fit, units), status)
        for name, (value, std) in with_delays(problem, fit).items()
        for status in (_status(name, value, std, fit, problem, doubtful=doubtful),)
    )


def _status(name: str, value: float, std: float, fit: FrictionFit, problem: Problem, *, doubtful: bool) -> Status:
    if doubtful:
        return Status.DOUBTFUL
    if not fit.converged:
        return Status.NOT_CONVERGED
    if name in fit.at_bound or (name in POSITIVE and value <= -SURE * std):
        return Status.AT_BOUND
    if name in POSITIVE and value <= 0:
        return Status.UNEXCITED
    if std == 0.0:
        return Status.UNEXCITED  # nothing depends on it
    scale = abs(value)
    if name.startswith((*MAY_VANISH, HARMONIC)):
        scale = max(scale, 0.1 * problem.exertion_rms)
    elif name.endswith(SHIFT):
        # To within a sample, no delay is as good to know as a delay.
        scale = max(scale, problem.filters.dt_s)
    return Status.VALID if std <= UNEXCITED_BEYOND * scale else Status.UNEXCITED


def as_doubtful(estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
    """The same, none of them to be believed."""
    return tuple(replace(estimate, status=Status.DOUBTFUL) for estimate in estimates)


def as_inadequate(estimates: tuple[Estimate, ...], best: Mapping[str, Estimate]) -> tuple[Estimate, ...]:
    """The same, of a law that another one outdoes: what seems known is so only where it is the same in the ``best``
    one's, by its name; friction's own values mean something else there."""

    def agrees(one: Estimate) -> bool:
        other = best.get(one.name)
        return other is not None and abs(one.value - other.value) <= SURE * np.hypot(one.std, other.std)

    return tuple(each if agrees(each) else inadequate(each) for each in estimates)


def inadequate(estimate: Estimate) -> Estimate:
    """The same, if it seemed known, as what the machine is not."""
    known = estimate.status in (Status.VALID, Status.UNEXCITED)
    return replace(estimate, status=Status.INADEQUATE) if known else estimate


def _is_none(estimate: Estimate) -> bool:
    """Whether a harmonic is known to be next to nothing: there is no ratio to it."""
    small = estimate.std > UNEXCITED_BEYOND * abs(estimate.value)
    return estimate.name.startswith(HARMONIC) and estimate.status is Status.VALID and small


def loose(fit: FrictionFit, estimates: tuple[Estimate, ...]) -> tuple[Direction, ...]:
    """Directions in which what should not vanish is known to no better than half of itself."""
    known = {
        each.name
        for each in estimates
        if each.status in (Status.VALID, Status.UNEXCITED) and each.value != 0.0 and not _is_none(each)
    }
    names = [
        name
        for name in fit.names
        if name in known and not name.startswith((*MAY_VANISH, ELEMENT)) and not name.endswith(SHIFT)
    ]
    at = [fit.names.index(name) for name in names]
    return loose_directions(names, fit.covariance[np.ix_(at, at)] / np.outer(fit.values[at], fit.values[at]))


def without_scale(estimates: tuple[Estimate, ...], units: Units) -> tuple[tuple[Estimate, ...], str]:
    """No number where only ratios to the torque gain are known, and the sentence that tells the ratios."""
    fixed = ("rad", "m", "rad/s", "m/s", "s", "1")
    known = [estimate for estimate in estimates if estimate.unit not in fixed]
    ratios = ", ".join(
        f"{estimate.name.replace('_', ' ')} / torque gain = {estimate.value:.5g} ± {estimate.half_interval:.2g}"
        for estimate in known
        if estimate.status is Status.VALID
    )
    nan = float("nan")
    blank = tuple(
        replace(estimate, value=nan, std=nan, status=_of_ratio(estimate.status)) if estimate in known else estimate
        for estimate in (Estimate("torque_gain", 1.0, 0.0, units.gain, Status.VALID), *estimates)
    )
    gain = replace(blank[0], value=nan, std=nan, status=Status.RATIO_ONLY)
    sentence = (
        "No torque was measured and no gain or load is known: torque gain, inertia, damping and friction are known "
        "only up to a common factor; give [actuator] torque_gain, or a known [load], to fix it."
    )
    if ratios:
        sentence += f" Known are {ratios} (per {units.drive or 'unit of command'})."
    return (gain, *blank[1:]), sentence


def _of_ratio(status: Status) -> Status:
    return Status.RATIO_ONLY if status is Status.VALID else status


def back_emf_damping(gain: float, resistance_ohm: float) -> float:
    """Km²/R, of a gain Km/R per volt."""
    return gain**2 * resistance_ohm


def with_back_emf(
    estimates: tuple[Estimate, ...], resistance_ohm: float | None, known_gain: float | None
) -> tuple[tuple[Estimate, ...], str]:
    """A voltage-driven motor's damping holds its back-EMF; where the resistance is known, the two are told apart.

    From the gain Km/R, the constant is Km = gain · R.
    """
    by_name: Mapping[str, Estimate] = {estimate.name: estimate for estimate in estimates}
    gain = by_name.get("torque_gain", Estimate("torque_gain", known_gain or float("nan"), 0.0, "", Status.VALID))
    if resistance_ohm is None or not np.isfinite(gain.value):
        return estimates, (
            "Driven by voltage: the viscous damping holds the back-EMF's; [actuator] resistance would tell them apart."
        )
    braking = back_emf_damping(gain.value, resistance_ohm)
    braking_std = 2 * abs(gain.value) * resistance_ohm * gain.std
    lessened = tuple(
        replace(each, value=each.value - braking, std=float(np.hypot(each.std, braking_std)))
        if each.name.startswith("viscous_damping")
        else each
        for each in estimates
    )
    constant = Estimate("torque_constant", gain.value * resistance_ohm, gain.std * resistance_ohm, "N*m/A", gain.status)
    sentence = f"The back-EMF's damping, {braking:.4g}, is taken out of the viscous damping."
    return (*lessened, constant), sentence
