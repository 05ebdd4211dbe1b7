"""What is known of a session by whoever watches: from a real recording, event by event."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.events import PartMeasured, PlannedStep, SessionState
from norton_bench.identification.results import LiveEstimate
from norton_bench.models.parameters import Estimate, Status
from norton_bench.records import TICK, Event, Measured
from norton_bench.rig.rig import Rig
from norton_bench.screen import figures
from norton_bench.screen.experiment import Experiment
from norton_bench.screen.picture.parts import StepList, half_width
from norton_bench.screen.picture.picture import EventLog, LogLine, Picture, RecentTicks
from norton_bench.screen.plots import PlotFigure

NAMES = ["tare", "calibrate", "free", "imposed", "validate"]


def at(replayed: Experiment, moment_s: float) -> Picture:
    replayed.seek(moment_s)
    replayed.update()
    return replayed.picture


def during(replayed: Experiment, procedure: str, name: str = "") -> Picture:
    """The picture at the end of the last segment of that name."""
    assert replayed.replay is not None
    measured = replayed.replay.replay.measured
    segment = [s for s in measured.segments if s.procedure == procedure and s.name.startswith(name)][-1]
    return at(replayed, (segment.end_ns - int(measured.ticks["tick_ns"][0])) * 1e-9 - 0.01)


def end(replayed: Experiment) -> Picture:
    assert replayed.replay is not None
    return at(replayed, replayed.replay.replay.duration_s)


def test_steps_follow_the_recording(replayed: Experiment) -> None:
    picture = during(replayed, "free")
    states = {step.planned.name: step.state for step in picture.steps.all}
    assert states == {"tare": "done", "calibrate": "done", "free": "running", "imposed": "ahead", "validate": "ahead"}
    running = picture.steps.running
    assert running is not None
    assert 0.8 < running.share < 1.0
    assert picture.steps.number == 3
    assert picture.steps.left_s == pytest.approx(sum(step.left_s for step in picture.steps.all))


def test_the_whole_recording_is_told_however_it_is_cut(replayed: Experiment) -> None:
    """In one piece, in many, and back and forth: the same picture at the end."""
    whole = end(replayed)
    for moment_s in (3.0, 11.0, 2.0, 8.0):
        at(replayed, moment_s)
    assert replayed.replay is not None
    clock, replay = replayed.replay.replay._clock, replayed.replay.replay
    replayed.seek(0.0)
    while not replay.ended:
        clock.now_s += 0.37  # type: ignore[attr-defined]
        replayed.update()
    pieces = replayed.picture
    assert pieces.known.estimates == whole.known.estimates
    assert pieces.recent.rows().tobytes() == whole.recent.rows().tobytes()  # a rig without modulator has NaN there
    assert [step.state for step in pieces.steps.all] == [step.state for step in whole.steps.all] == ["done"] * 5
    assert {line.text for line in pieces.log.lines} == {line.text for line in whole.log.lines}
    assert np.allclose(pieces.source.branch(rising=True), whole.source.branch(rising=True))
    assert pieces.state is SessionState.DONE


def test_parameters_converge(replayed: Experiment) -> None:
    early, late = during(replayed, "tare").known, end(replayed).known
    assert late.valid == len(late.estimates) == 7
    assert early.valid == 0
    gain = late.widths["torque_gain"]
    known = [width for width in gain if np.isfinite(width)]
    assert known[-1] < known[0]
    assert known[-1] == half_width(late.estimates[0])


def test_the_source_fills_in_level_by_level(replayed: Experiment, rig: Rig) -> None:
    picture = during(replayed, "free", "staircase rising")
    assert len(picture.source.branch(rising=True)) == 5
    assert len(picture.source.branch(rising=False)) == 0
    full = during(replayed, "free", "staircase falling")
    rising, falling = (full.source.branch(rising=side) for side in (True, False))
    assert np.allclose(np.sort(rising[:, 0]), np.sort(falling[:, 0]))
    assert np.all(np.diff(rising[:, 1]) > -0.5)
    assert figures.source(full).latest == "▴▾ 10 levels"


def test_the_source_curve_appears_with_the_last_parameter(replayed: Experiment) -> None:
    before = during(replayed, "free", "search")
    before.known.estimates = (replace(before.known.estimates[0], status=Status.LEARNING), *before.known.estimates[1:])
    assert all(trace.cloud for trace in figures.source(before).traces)
    curve = [trace for trace in figures.source(end(replayed)).traces if not trace.cloud]
    assert len(curve) == 1
    levels = end(replayed).source.branch(rising=True)
    # Where the shaft turns, the curve goes through what was measured.
    fast = levels[np.argmax(levels[:, 1])]
    assert np.interp(fast[0], curve[0].x, curve[0].y) == pytest.approx(fast[1], rel=0.1)


def test_a_hysteresis_loop_is_closed(replayed: Experiment) -> None:
    """The phase plane shows the segment alone: torque leads and trails, so the loop encloses an area."""
    figure = figures.torque_position(during(replayed, "imposed", "loop 15 mrad"))
    x = np.concatenate([figure.traces[1].x, figure.traces[0].x])
    y = np.concatenate([figure.traces[1].y, figure.traces[0].y])
    assert np.ptp(x) == pytest.approx(30e-3, rel=0.2)
    enclosed = abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) / 2
    assert enclosed > 0.1 * np.ptp(x) * np.ptp(y)


@pytest.mark.parametrize("make", [figures.torque, figures.velocity, figures.command])
def test_traces_end_now(replayed: Experiment, make) -> None:
    picture = during(replayed, "free")
    shown: PlotFigure = make(picture, 5.0)
    assert shown.x.span == pytest.approx((picture.now_s - 5.0, picture.now_s))
    assert shown.traces[0].x[-1] == pytest.approx(picture.now_s)
    assert len(shown.traces[0].x) == pytest.approx(5000, abs=2 + 300)  # between procedures nothing is recorded


def test_devices_are_counted(replayed: Experiment) -> None:
    picture = during(replayed, "imposed")
    for pulse in picture.health.devices():
        assert pulse.state == "ok"
        assert pulse.rate_hz == pytest.approx(1000, rel=0.05)
        assert pulse.lost == 0


def test_a_silent_device_and_a_troubled_bus_are_named(rig: Rig) -> None:
    picture = Picture(rig)
    ticks = np.zeros(10, TICK)
    ticks["tick_ns"] = np.arange(10) * 1_000_000
    ticks["torque_age_ns"] = 2 * rig.limits.stale_after_ns
    events = (Event(5_000_000, "bus", "bus can0: error passive, once"),)
    picture.take(PartMeasured(Measured(ticks=ticks, events=events), LiveEstimate(0)))
    states = {pulse.name: pulse.state for pulse in (*picture.health.devices(), *picture.health.buses())}
    assert states == {"actuator": "ok", "load": "ok", "torque sensor": "silent", "can0": "trouble"}
    assert picture.health.buses()[0].said == "error passive, once"


def test_lost_readings_are_counted_but_not_between_procedures(rig: Rig) -> None:
    picture = Picture(rig)
    for first_ns, first in ((0, 0), (100_000_000, 103), (2_000_000_000, 900)):
        part = Measured(ticks=np.zeros(1, TICK), motion=np.zeros(100, [*Measured().motion.dtype.descr]))
        part.ticks["tick_ns"] = first_ns + 99_000_000
        part.motion["arrival_ns"] = first_ns + np.arange(100) * 1_000_000
        part.motion["sequence"] = first + np.arange(100)
        picture.take(PartMeasured(part, LiveEstimate(0)))
    assert picture.health.devices()[0].lost == 3


def test_a_tape_keeps_the_last_and_in_order() -> None:
    recent = RecentTicks(100)
    for first in range(0, 1000, 30):
        rows = np.zeros(30, TICK)
        rows["tick_ns"] = np.arange(first, first + 30)
        recent.append(rows)
    kept = recent.rows()["tick_ns"]
    assert len(kept) == 100
    assert np.all(np.diff(kept) == 1)
    assert recent.since(int(kept[-3]))["tick_ns"].tolist() == kept[-3:].tolist()
    more = np.zeros(5000, TICK)
    recent.append(more)
    assert len(recent.rows()) == 100


def test_steps_left_out_and_stopped_say_so() -> None:
    steps = StepList()
    steps.plan([PlannedStep(name, 10.0) for name in "abc"])
    steps.begin(0, 0.0)
    steps.begin(2, 5.0)
    steps.advance(9.0)
    steps.end(9.0, whole=False)
    assert [(step.state, step.took_s) for step in steps.all] == [("done", 5.0), ("left out", 0.0), ("stopped", 4.0)]
    steps.plan([PlannedStep(name, 10.0) for name in "abcd"])
    assert [step.state for step in steps.all] == ["done", "left out", "stopped", "ahead"]
    assert steps.left_s == 10.0


def test_the_log_says_a_thing_once() -> None:
    log = EventLog()
    for text in ("verified", "verified", "stopped"):
        log.add(LogLine(0.0, "note", text))
    assert [line.text for line in log.lines] == ["verified", "stopped"]


def test_an_estimate_that_is_none_has_no_width() -> None:
    assert half_width(Estimate("inertia", 2.0, 0.1, "kg*m^2", Status.VALID)) == pytest.approx(0.098)
    for value, std in ((0.0, 1.0), (float("nan"), 1.0), (1.0, float("inf")), (1.0, 0.0)):
        assert np.isnan(half_width(Estimate("inertia", value, std, "kg*m^2", Status.LEARNING)))
