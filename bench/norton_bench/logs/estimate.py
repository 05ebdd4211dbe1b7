"""From the equation of a log to the fit that is chosen: delays, the tension at each start, and the ladder."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.friction_fit import FrictionFit, fit_friction
from norton_bench.identification.friction_laws import model as member
from norton_bench.identification.friction_model import FrictionModel, remembers
from norton_bench.identification.ladder import Rung, ladder
from norton_bench.logs import delays as late
from norton_bench.logs.equation import TORQUE_GAIN, Problem
from norton_bench.logs.motion import Delays
from norton_bench.logs.near_rest import NearRest, WeightedFit
from norton_bench.logs.starts import SCOUT, begun, tensed

# Models that are near to any other as far as delays go, and quick.
SCOUTS = ("coulomb-viscous", "load-dependent", "stribeck-asymmetric", "film-asymmetric", SCOUT)
PLAIN = "coulomb-viscous"
# A log is of presliding if a contact that remembers leaves less than this share of what plain friction leaves.
PRESLIDES = 1 / 3
# The chosen model's own delays are put in place of those of the first one, so often at most, as long as they move by
# more than this share of a sample, and by less every time.
ROUNDS = 12
SETTLED = 0.02
# Of the fit, and of the tension that it begins with.
TENSED = 4
# Of the fit, and of the errors that it leaves.
SHRINKS = 2


@dataclass(frozen=True)
class Estimated:
    """``problem`` has the delays of the chosen model, ``compared`` those of the first fit, which all ``rungs`` but the
    chosen one were fitted to, each with a correction."""

    problem: Problem
    compared: Problem
    rungs: tuple[Rung, ...]
    chosen: Rung

    def again(self, problem: Problem, chosen: Rung) -> "Estimated":
        """With the chosen model fitted anew."""
        rungs = tuple(chosen if rung.name == chosen.name else rung for rung in self.rungs)
        return replace(self, problem=problem, rungs=rungs, chosen=chosen)


def comparable(near: NearRest, family: Sequence[FrictionModel]) -> tuple[tuple[FrictionModel, ...], str]:
    """Those of the family that can describe the log at all, and a sentence about the others.

    Where a contact that remembers leaves far less than friction of velocity alone, the log is of presliding, and no
    law of velocity can foretell a record of it.
    """
    plain, scout = (near.fit(member(name)).fit for name in (PLAIN, SCOUT))
    kept = tuple(filter(remembers, family))
    if not kept or not scout.rms < PRESLIDES * plain.rms:
        return tuple(family), ""
    return kept, (
        f"Friction follows the path here: laws of velocity alone leave {plain.rms / scout.rms:.2g} times as much as a "
        "contact that deflects, and are not compared."
    )


def estimated(
    again: Callable[[Delays], Problem],
    sought: tuple[str, ...],
    models: Callable[[NearRest], Sequence[FrictionModel]],
    choose: Callable[[Sequence[Rung]], Rung],
) -> Estimated:
    """``again`` makes the problem for given delays, ``models`` the candidates for it.

    Raises ExperimentError where there is too little to fit or compare.
    """
    near = NearRest.of(again(Delays(sought=sought)))
    candidates = models(near)
    first = _first(near, candidates)
    if sought:
        excess = first.excess
        delays = late.searched(
            near.weighted(excess), first.fit, lambda delays: NearRest.of(again(delays)).weighted(excess)
        )
        near = NearRest.of(again(delays))
        first = _first(near, candidates)
    problem = near.weighted(first.excess)
    if problem.delays.sought:
        problem = late.with_columns(problem, first.fit)
    if any(map(remembers, candidates)):
        near = NearRest.of(begun(problem))
        problem = near.weighted(_first(near, candidates).excess)
    rungs = ladder(problem.equation, candidates, problem.train)
    return _unshrunk(_settled(_tensed(Estimated(problem, problem, rungs, choose(rungs))), again))


def _first(near: NearRest, candidates: Sequence[FrictionModel]) -> WeightedFit:
    """The likeliest scout among the candidates, one of which is a contact; or the simplest of these."""
    scouts = [each for each in candidates if each.name in SCOUTS]
    if not any(map(remembers, scouts)):
        scouts += [*filter(remembers, candidates)][:1]
    scouts = scouts or [candidates[0]]
    return min((near.fit(each) for each in scouts), key=lambda each: each.doubt)


def _tensed(result: Estimated) -> Estimated:
    """The chosen contact, with the tension at each beginning that it asks for itself.

    An error of it is left in all rows until the contact has turned over, and delays and damping take it up.
    """
    problem, chosen = result.problem, result.chosen
    if not remembers(chosen.model):
        return result
    for _ in range(TENSED):
        other = tensed(problem, chosen.fit)
        refitted = _refitted(other, chosen)
        if not refitted.fit.rms < chosen.fit.rms:  # the first rows tell of what the law lacks
            break
        problem, chosen = other, refitted
    return result.again(problem, chosen)


def _settled(result: Estimated, again: Callable[[Delays], Problem]) -> Estimated:
    """The chosen model, fitted where its own delays are: the columns are those of small ones."""
    problem, chosen = result.problem, result.chosen
    if not problem.delays.sought:
        return result
    near, last_s = NearRest.of(problem), np.inf
    for _ in range(ROUNDS):
        delays = late.found(problem, chosen.fit)
        moved_s = max(
            abs(delays.command_s - problem.delays.command_s), abs(delays.exertion_s - problem.delays.exertion_s)
        )
        if moved_s < SETTLED * problem.filters.dt_s or moved_s >= last_s:
            break
        excess, moved = near.excess(chosen.fit), again(delays)
        path = replace(moved.equation.path, shares=problem.equation.path.shares)
        near = NearRest.of(replace(moved, equation=replace(moved.equation, path=path)))
        problem, last_s = late.with_columns(near.weighted(excess), chosen.fit), moved_s
        chosen = _refitted(problem, chosen)
    return result.again(problem, chosen)


def _refitted(problem: Problem, rung: Rung) -> Rung:
    """To an equation that differs little."""
    fit = fit_friction(problem.equation, rung.model, problem.train, near=rung.fit.shape)
    return replace(rung, fit=fit, train_rms=fit.rms)


def _unshrunk(result: Estimated) -> Estimated:
    """Where the torque at the port alone gives the scale, what the equation leaves beyond that sensor's noise is an
    error of the other side: of the drive, of what moves, of friction's law. Errors on that side make all of it look
    smaller, by their power over that of the torque (Fuller, Measurement Error Models, section 1.1). So they are taken
    off as noise of the drive: whichever column they are in, it is one common factor."""
    problem, chosen = result.problem, result.chosen
    if problem.terms[0].port is None or TORQUE_GAIN not in problem.equation.names:
        return result
    for _ in range(SHRINKS):
        equation = problem.equation
        noise = {**equation.noise, TORQUE_GAIN: _drive_noise(problem, chosen.fit)}
        problem = replace(problem, equation=replace(equation, noise=noise))
        chosen = _refitted(problem, chosen)
    return result.again(problem, chosen)


def _drive_noise(problem: Problem, fit: FrictionFit) -> FloatArray:
    """The variance of the drive in each row that stands for all errors but those of the sensor and of the
    acceleration, (n,)."""
    equation, rows = problem.equation, problem.train
    weight = equation.scale[rows] ** 2
    sensor = problem.readings.white_noise("exertion") * float(np.linalg.norm(problem.filters.kernel))
    known = np.full(rows.size, sensor**2)
    if "inertia" in equation.noise:
        known = known + fit.value("inertia") ** 2 * equation.noise["inertia"]
    left = float(np.mean(weight * (fit.residual[rows] ** 2 - known[rows])))
    return np.asarray(max(left, 0.0) / fit.value(TORQUE_GAIN) ** 2 / equation.scale**2)
