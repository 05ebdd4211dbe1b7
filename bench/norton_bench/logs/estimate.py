"""From the equation of a log to the fit that is chosen: delays, the tension at each start, and the ladder."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from norton_bench.identification.friction_fit import FrictionFit
from norton_bench.identification.friction_laws import model as member
from norton_bench.identification.friction_model import Dimension, FrictionModel
from norton_bench.identification.ladder import Rung, fit_friction, ladder
from norton_bench.logs import delays as late
from norton_bench.logs.equation import Problem
from norton_bench.logs.motion import Delays
from norton_bench.logs.starts import SCOUT, begun

# Models that are near to any other as far as delays go, and quick.
SCOUTS = ("coulomb-viscous", "stribeck-asymmetric", "film-asymmetric", SCOUT)
PLAIN = "coulomb-viscous"
# A log is of presliding if a contact that remembers leaves less than this share of what plain friction leaves.
PRESLIDES = 1 / 3
# The chosen model's own delays are put in place of those of the first one, so often at most, as long as they move by
# more than this share of a sample and leave less.
ROUNDS = 3
SETTLED = 0.02


@dataclass(frozen=True)
class Estimated:
    """``problem`` has the delays of the chosen model; ``rungs`` those of the first fit, and each a correction."""

    problem: Problem
    rungs: tuple[Rung, ...]
    chosen: Rung


def remembers(law: FrictionModel) -> bool:
    """Whether its friction depends on the path."""
    return any(unknown.dimension is Dimension.DISPLACEMENT for unknown in law.unknowns)


def comparable(problem: Problem, family: Sequence[FrictionModel]) -> tuple[tuple[FrictionModel, ...], str]:
    """Those of the family that can describe the log at all, and a sentence about the others.

    Where a contact that remembers leaves far less than friction of velocity alone, the log is of presliding, and no
    law of velocity can foretell a record of it.
    """
    plain, scout = (fit_friction(problem.equation, member(name), problem.train) for name in (PLAIN, SCOUT))
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
    models: Callable[[Problem], Sequence[FrictionModel]],
    choose: Callable[[Sequence[Rung]], Rung],
) -> Estimated:
    """``again`` makes the problem for given delays, ``models`` the candidates for it.

    Raises ExperimentError where there is too little to fit or compare.
    """
    problem = again(Delays(sought=sought))
    candidates = models(problem)
    if sought:
        first = _first(problem, candidates)
        moved = again(late.searched(problem, first, again))
        problem = late.with_columns(moved, fit_friction(moved.equation, first.model, moved.train))
    if any(map(remembers, candidates)):
        problem = begun(problem)
    rungs = ladder(problem.equation, candidates, problem.train)
    return _settled(Estimated(problem, rungs, choose(rungs)), again)


def _first(problem: Problem, candidates: Sequence[FrictionModel]) -> FrictionFit:
    """The scout that fits best among the candidates, or the simplest of these where there is none."""
    scouts = [each for each in candidates if each.name in SCOUTS] or [candidates[0]]
    return min((fit_friction(problem.equation, each, problem.train) for each in scouts), key=lambda fit: fit.rms)


def _settled(result: Estimated, again: Callable[[Delays], Problem]) -> Estimated:
    """The chosen model, fitted where its own delays are: the columns are those of small ones."""
    problem, chosen = result.problem, result.chosen
    for _ in range(ROUNDS if problem.delays.sought else 0):
        delays = late.found(problem, chosen.fit)
        moved_s = max(
            abs(delays.command_s - problem.delays.command_s), abs(delays.exertion_s - problem.delays.exertion_s)
        )
        if moved_s < SETTLED * problem.filters.dt_s:
            break
        moved = again(delays)
        path = replace(moved.equation.path, shares=problem.equation.path.shares)
        moved = late.with_columns(replace(moved, equation=replace(moved.equation, path=path)), chosen.fit)
        fit = fit_friction(moved.equation, chosen.model, moved.train, near=chosen.fit.shape)
        if fit.rms >= chosen.fit.rms:
            break
        problem, chosen = moved, replace(chosen, fit=fit, train_rms=fit.rms)
    rungs = tuple(chosen if rung.name == chosen.name else rung for rung in result.rungs)
    return Estimated(problem, rungs, chosen)
