"""Experiments that choose themselves, on the simulated bench through the real path."""

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from norton_bench.cli.tables import until_figures, until_sentences
from norton_bench.errors import RigError, UsageError
from norton_bench.events import Note, SessionEvent
from norton_bench.identification.judged_fit import fit
from norton_bench.models.parameters import Status
from norton_bench.procedures import refine
from norton_bench.procedures.excitations import travel_left_rad
from norton_bench.procedures.options import CalibrateOptions, ImposedOptions, RefineOptions, TareOptions
from norton_bench.procedures.refine import RefineProcedure
from norton_bench.procedures.refinement import half_width
from norton_bench.records import Measured
from norton_bench.result import Result
from norton_bench.rig.load import load_rig
from norton_bench.segments import Use
from norton_bench.session.engine import run_session
from norton_bench.session.schema import Session, Step, refining_session
from norton_sim.tools import true_parameters
from tests.bench.session.conclusions import fit_alone

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[3]
RIG = load_rig(ROOT / "rigs" / "sim-odrive.toml")
SEED = 3
ASKED = 0.02
AT_MOST_S = 40.0
STEPS = (
    Step("tare", TareOptions(duration_s=0.5)),
    Step("calibrate", CalibrateOptions(duration_s=4.0)),
    Step("imposed", ImposedOptions(velocities_rad_s=(-20.0, 20.0), commands=1, duration_s=1.5)),
    Step("refine", RefineOptions(until=ASKED, at_most_s=AT_MOST_S)),
)


@dataclass(frozen=True)
class Refined:
    result: Result
    notes: list[str]


@pytest.fixture(scope="module")
def refined(tmp_path_factory: pytest.TempPathFactory) -> Refined:
    events: list[SessionEvent] = []
    out = tmp_path_factory.mktemp("refined")
    with fit_alone():
        result = run_session(RIG, Session(STEPS, "test"), out=out, seed=SEED, on_event=events.append, live=False)
    return Refined(result, [event.text for event in events if isinstance(event, Note)])


def test_every_interval_becomes_as_narrow_as_asked(refined: Refined) -> None:
    fit, log = refined.result.fit, refined.result.knowledge.refinement
    assert fit is not None
    assert log is not None
    assert log.finished
    assert log.reached
    assert all(half_width(estimate) <= ASKED for estimate in fit.estimates)
    figures = until_figures(log, fit, len(refined.result.measured.ticks) * RIG.tick_s)
    assert figures["reached"]
    assert figures["rounds"] == log.rounds >= 1
    assert figures["widest"]["half_width"] <= figures["asked"] == ASKED
    assert until_sentences(figures).startswith("Reached ±2 % after")


def test_the_truth_is_within_the_intervals(refined: Refined) -> None:
    fit = refined.result.fit
    assert fit is not None
    truth = true_parameters(RIG.simulated, seed=SEED, place="", command_unit=RIG.command.unit)
    for estimate in fit.estimates:
        assert estimate.status is Status.VALID
        true, _ = truth[estimate.name]
        assert abs(estimate.value - true) < max(4 * estimate.std, 0.01 * true), estimate.name


def test_rounds_are_said_recorded_and_kept_to_the_time(refined: Refined) -> None:
    log = refined.result.knowledge.refinement
    assert log is not None
    assert any(note.startswith("round 1: widest is ") for note in refined.notes)
    assert any(note.startswith(f"after {log.rounds} round") for note in refined.notes)
    segments = [each for each in refined.result.measured.segments if each.procedure == "refine"]
    rounds = {each.name.split(":")[0] for each in segments if each.use is Use.IDENTIFY}
    assert rounds == {f"round {number}" for number in range(1, log.rounds + 1)}
    spent_s = sum(each.end_ns - each.start_ns for each in segments) * 1e-9
    assert spent_s == pytest.approx(log.bench_time_s, abs=0.01)
    assert spent_s <= AT_MOST_S
    assert set(log.delivered) == {each.name.split(": ")[1] for each in segments if each.use is Use.IDENTIFY}


def test_drives_idle_between_rounds_while_the_fit_thinks(refined: Refined) -> None:
    """No tick belongs to the time between two rounds, nor between the step before and the first."""
    segments = refined.result.measured.segments
    ticks = refined.result.measured.ticks
    for before, after in pairwise(segments):
        if after.name.startswith("round") and before.name == "rest":
            assert after.start_ns > before.end_ns
            between = (ticks["tick_ns"] >= before.end_ns) & (ticks["tick_ns"] < after.start_ns)
            assert not np.any(between)


def test_the_greatest_torque_stays_within_the_limits(refined: Refined) -> None:
    measured = refined.result.measured
    for segment in measured.segments:
        if segment.procedure == "refine":
            part = measured.between(segment.start_ns, segment.end_ns)
            assert np.max(np.abs(part.torque["torque_nm"])) < 0.9 * RIG.limits.torque_nm
            assert np.max(np.abs(part.ticks["velocity_rad_s"])) < 0.9 * RIG.limits.velocity_rad_s
            assert not np.any(part.ticks["limited"])


def test_it_stops_honestly_when_time_is_up(refined: Refined) -> None:
    known = replace(refined.result.knowledge, refinement=None)
    decision = RefineProcedure(RefineOptions(until=1e-4, at_most_s=0.5)).following(known)
    assert decision.procedure is None
    log = decision.known.refinement
    assert log is not None
    assert (log.finished, log.reached) == (True, False)
    assert log.reasons[0].startswith("time is up; still wide: ")


def test_a_fit_that_does_not_converge_is_given_something_better(
    refined: Refined, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The calibration's own fit of the actuator is there to choose by; without it there is nothing."""
    monkeypatch.setattr(refine, "fit", lambda *given, **more: replace(fit(*given, **more), converged=False))
    known = replace(refined.result.knowledge, refinement=None)
    procedure = RefineProcedure(RefineOptions(until=0.001, at_most_s=100.0))
    assert procedure.following(known).procedure is not None
    decision = procedure.following(replace(known, actuator=None))
    assert decision.procedure is None
    assert "did not converge" in decision.sentence


def test_nothing_is_offered_where_the_load_can_do_nothing(refined: Refined) -> None:
    rig = replace(RIG, limits=replace(RIG.limits, load_torque_nm=1e-3))
    known = replace(refined.result.knowledge, rig=rig, refinement=None)
    decision = RefineProcedure(RefineOptions(until=0.001, at_most_s=100.0)).following(known)
    assert decision.procedure is None
    assert "nothing that the rig's limits allow" in decision.sentence


def test_the_window_of_positions_is_counted_from_where_the_shaft_first_stood() -> None:
    ticks = np.zeros(4, Measured().ticks.dtype)
    ticks["position_rad"] = [np.nan, 1.0, 5.0, -2.0]
    rig = replace(RIG, limits=replace(RIG.limits, position_rad=10.0))
    assert travel_left_rad((Measured(ticks=ticks),), rig) == pytest.approx(7.0)


def test_a_rig_without_a_load_is_refused() -> None:
    rig = load_rig(ROOT / "rigs" / "sim-free-shaft.toml")
    with pytest.raises(RigError, match="needs a load drive to impose motion: without it only ratios"):
        refining_session(rig, 0.01, 600.0)


def test_the_time_for_refining_is_what_the_other_steps_leave() -> None:
    session = refining_session(RIG, 0.01, 600.0)
    assert [step.do for step in session.steps] == ["tare", "calibrate", "free", "imposed", "refine", "validate"]
    (options,) = [step.options for step in session.steps if isinstance(step.options, RefineOptions)]
    assert 500 < options.at_most_s < 550
    with pytest.raises(UsageError, match="the steps around the refinement take about"):
        refining_session(RIG, 0.01, 60.0)
