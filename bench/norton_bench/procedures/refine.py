"""Adaptive excitation: the next excitation is the one that would narrow the widest interval most, until all are narrow.

Between rounds the drives are idle; then all recorded data are fitted, and the next round is chosen from the fit.
"""

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.cleaning import clean
from norton_bench.identification.counts import resolution_of
from norton_bench.identification.expansion import (
    Linearised,
    deviations,
    information,
    information_of_plan,
    noise_density_nm,
    vague,
)
from norton_bench.identification.judged_fit import fit
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import signals
from norton_bench.procedures.excitations import Candidate, PlanBounds, candidates, travel_left_rad
from norton_bench.procedures.knowledge import (
    Decision,
    Knowledge,
    Plan,
    refuse_servo,
    require_load,
    require_model,
    why_no_basis,
)
from norton_bench.procedures.options import RefineOptions
from norton_bench.procedures.refinement import (
    IMPROVABLE,
    Interval,
    Option,
    Refinement,
    Selection,
    in_percent,
    intervals_of,
    select,
    why_wide,
    words,
)
from norton_bench.procedures.waves import hold, imposed
from norton_bench.records import Measured, SegmentInfo, join
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

REST_S = 0.3
# A round is this share of the recording before it: fits become longer, so rounds must, too.
ROUND_SHARE = 0.3
SHORTEST_ROUND_S = 6.0
LONGEST_ROUND_S = 40.0
# Aim a little below the target: predictions are met only on average.
AIM = 0.85
ALL = "all that was recorded"
# Friction depends on the motion this long before a segment.
MEMORY_NS = 500_000_000


@dataclass(frozen=True)
class Round:
    """The excitations of one round, one after the other."""

    number: int
    chosen: tuple[Candidate, ...]
    name: ClassVar[str] = "refine"

    def require(self, rig: Rig) -> None:
        """Checked when the round was chosen."""

    def duration_s(self, rig: Rig) -> float:
        return sum(candidate.ticks for candidate in self.chosen) * rig.tick_s + REST_S

    def plan(self, known: Knowledge) -> Plan:
        for candidate in self.chosen:
            name = f"{_round(self.number)}{candidate.name}"
            yield imposed(self.name, name, Use.IDENTIFY, candidate.command, candidate.motion)
        yield imposed(self.name, "rest", Use.PREPARE, hold(0.0, REST_S, known.tick_s))

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known


@dataclass(frozen=True)
class RefineProcedure:
    """Rounds of imposed motion and command until all intervals are within the target, or time is up, or nothing
    helps."""

    options: RefineOptions = field(default_factory=RefineOptions)
    name: ClassVar[str] = "refine"

    def require(self, rig: Rig) -> None:
        require_model(rig, self.name)
        refuse_servo(rig, self.name)
        require_load(rig, self.name, "to impose motion: without it only ratios of parameters can be identified")

    def duration_s(self, rig: Rig) -> float:
        return self.options.at_most_s

    def following(self, known: Knowledge) -> Decision:
        before = known.refinement
        log = before if before is not None and not before.finished else Refinement(self.options.until)
        record = join(known.records)
        result = fit(record, command_unit=known.rig.command.unit, tick_s=known.tick_s)
        fault = why_no_basis(result, ALL)
        # Until there is a better fit, choose by the first one, from the calibration.
        basis = result if fault is None else known.actuator
        if basis is None or why_no_basis(basis, ALL) is not None:
            return _done(known, log.ended(reached=False, reasons=(fault,) if fault else ()))
        view = _View.of(basis, record, known)
        log = replace(log.judged(view.intervals), delivered={**log.delivered, **view.delivered(record, log.rounds)})
        wanted = [interval for interval in view.intervals if interval.half_width > log.target]
        open_ = [interval for interval in wanted if not log.set_aside(interval)]
        if not open_:
            reasons = [fault] if fault else [*map(why_wide, wanted), *_without_number(result)]
            reached = fault is None and bool(view.intervals) and not wanted
            return _done(known, log.ended(reached=reached, reasons=reasons))
        return self._next_round(known, log, view, open_)

    def _next_round(self, known: Knowledge, log: Refinement, view: "_View", open_: list[Interval]) -> Decision:
        widest = max(open_, key=lambda interval: interval.half_width)
        about = f"{words(widest.name)} {in_percent(widest.half_width)}"
        left_s = self.options.at_most_s - log.bench_time_s - REST_S
        wished_s = float(np.clip(ROUND_SHARE * view.recorded_s, SHORTEST_ROUND_S, LONGEST_ROUND_S))
        pool = candidates(view.bounds, seed=100 + log.rounds)
        shortest_s = min((candidate.ticks * known.tick_s for candidate in pool), default=0.0)
        if left_s < shortest_s:
            return _done(known, log.ended(reached=False, reasons=(f"time is up; still wide: {about}",)))
        chosen, predicted = view.choose(pool, open_, log, min(wished_s, left_s))
        if not chosen:
            reason = f"nothing that the rig's limits allow would narrow the widest interval, that of {about}"
            return _done(known, log.ended(reached=False, reasons=(reason,)))
        following = Round(log.rounds + 1, chosen)
        taken_s = following.duration_s(known.rig)
        log = replace(
            log, rounds=following.number, bench_time_s=log.bench_time_s + taken_s,
            predicted={interval.name: (interval.half_width, after)
                      for interval, after in zip(open_, predicted.tolist(), strict=True)},
        )  # fmt: skip
        said = f"round {following.number}: widest is {about}; next, for {taken_s:.0f} s: {_listed(chosen)}"
        return Decision(replace(known, refinement=log), following, said)


@dataclass(frozen=True)
class _View:
    """The fit of all recorded data, in the form that the choice of the next round needs."""

    intervals: tuple[Interval, ...]
    known: FloatArray
    at: Linearised
    noise_nm: float
    resolution_rad: float
    bounds: PlanBounds
    recorded_s: float

    @classmethod
    def of(cls, result: FitResult, record: Measured, known: Knowledge) -> "_View":
        assert known.calibration is not None
        at, noise_nm = Linearised.at(result), noise_density_nm(result)
        stretches = signals(clean(record).measured, known.tick_s, Use.IDENTIFY)
        there = vague() + information(stretches, at, noise_nm)
        return cls(
            intervals=intervals_of(result.estimates, deviations(there)),
            known=there,
            at=at,
            noise_nm=noise_nm,
            resolution_rad=resolution_of(record.motion["position_rad"]).width,
            bounds=PlanBounds(known.rig, result.network, known.calibration, travel_left_rad((record,), known.rig)),
            recorded_s=result.samples * known.tick_s,
        )

    def delivered(self, record: Measured, number: int) -> dict[str, FloatArray]:
        """The information that each excitation of round ``number`` gave; the load may not have followed exactly."""
        prefix = _round(number)
        cleaned = clean(record).measured
        segments = [segment for segment in record.segments if segment.name.startswith(prefix)]
        return {segment.name.removeprefix(prefix): self._information(cleaned, segment) for segment in segments}

    def _information(self, record: Measured, segment: SegmentInfo) -> FloatArray:
        piece = record.between(segment.start_ns - MEMORY_NS, segment.end_ns)
        stretches = [
            replace(stretch, usable=stretch.usable & (stretch.segment == segment.index))
            for stretch in signals(piece, self.bounds.rig.tick_s, Use.IDENTIFY)
        ]
        useful = tuple(stretch for stretch in stretches if stretch.usable.any())
        return information(useful, self.at, self.noise_nm) if useful else np.zeros_like(self.known)

    def choose(
        self, pool: tuple[Candidate, ...], open_: list[Interval], log: Refinement, time_s: float
    ) -> tuple[tuple[Candidate, ...], FloatArray]:
        """The excitations to run, and the predicted half-widths of ``open_`` after them.

        It is assumed that the part of an interval that is not noise shrinks in the same ratio as that of the noise.
        """
        tick_s = self.bounds.rig.tick_s
        options = [Option(candidate.ticks * tick_s, self._expected(candidate, log)) for candidate in pool]
        rows = [interval.row for interval in open_]
        now = deviations(self.known)[rows]
        per_deviation = np.array([interval.half_width for interval in open_]) / now
        selection: Selection = select(
            options, self.known, lambda each: per_deviation * each[rows], target=AIM * log.target, time_s=time_s
        )
        return tuple(pool[pick] for pick in selection.picks), selection.predicted

    def _expected(self, candidate: Candidate, log: Refinement) -> FloatArray:
        delivered = log.delivered.get(candidate.name)
        if delivered is not None:
            return delivered
        return information_of_plan(
            self.bounds.excitation(candidate), self.at, self.noise_nm, position_resolution_rad=self.resolution_rad
        )


def _without_number(result: FitResult) -> list[str]:
    names = [
        f"{words(estimate.name)} ({estimate.status.value})"
        for estimate in result.estimates
        if estimate.status not in IMPROVABLE
    ]
    return [f"without an interval: {', '.join(names)}"] if names else []


def _done(known: Knowledge, log: Refinement) -> Decision:
    rounds = f"{log.rounds} round{'' if log.rounds == 1 else 's'}"
    end = f"every interval is within {in_percent(log.target)}" if log.reached else "stopped"
    said = f"after {rounds}: {'; '.join([end, *log.reasons])}"
    return Decision(replace(known, refinement=log), None, said)


def _round(number: int) -> str:
    """The prefix of the names of a round's segments."""
    return f"round {number}: "


def _listed(chosen: tuple[Candidate, ...]) -> str:
    counts = Counter(candidate.name for candidate in chosen)
    return "; ".join(name if count == 1 else f"{name} ({count} times)" for name, count in counts.items())
