"""Watchdogs are tried before a session begins, and the guard is told what the session learns."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from norton_bench.errors import SafetyStopError
from norton_bench.events import Note, SessionEvent, Watcher, ignore
from norton_bench.guard.check import EMPTY_MODEL
from norton_bench.procedures.knowledge import Knowledge
from norton_bench.procedures.options import CalibrateOptions, TareOptions
from norton_bench.recording.reader import read_recording
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig, Supervision
from norton_bench.session import engine
from norton_bench.session.run import guard_model_of
from norton_bench.session.schema import Session, Step
from norton_drivers.registry import load_backend
from norton_sim.firmware.odrive import ODriveAxis
from tests.bench.half_rate import half_rate

RIGS = Path(__file__).parents[3] / "rigs"
RIG = half_rate("sim-odrive")
FREE = load_rig(RIGS / "sim-free-shaft.toml")
TARE = Step("tare", TareOptions(duration_s=0.5))


def recorded(rig: Rig, out: Path, *steps: Step, on_event: Watcher = ignore) -> engine.RecordedSession:
    return engine.record_session(rig, Session(steps, place="test"), out=out, seed=1, on_event=on_event, live=False)


@pytest.mark.long
def test_watchdogs_are_tried_noted_and_recorded_before_anything_moves(tmp_path: Path) -> None:
    events: list[SessionEvent] = []
    done = recorded(RIG, tmp_path, TARE, on_event=events.append)
    measured = read_recording(done.recording).measured
    told = [(event.kind, event.text) for event in measured.events]
    assert [kind for kind, _ in told] == ["watchdog", "watchdog", "step"]
    for role, (_, text) in zip(("actuator", "load"), told[:2], strict=True):
        assert Note(text) in events
        start, milliseconds, unit = text.rsplit(" ", 2)
        assert (start, unit) == (f"watchdog of {role} verified:", "ms")
        assert 300 <= int(milliseconds) <= 420  # the rig's 300 ms, told by the next of ten heartbeats a second
    assert measured.events[1].stamp_ns < measured.ticks["tick_ns"][0]
    assert any(frame.stamp_ns < measured.events[0].stamp_ns for frame in measured.frames)


def test_a_watchdog_that_does_not_act_ends_the_session_before_it_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ODriveAxis, "_starve", lambda self: None)
    with pytest.raises(
        SafetyStopError, match=r"drive: still enabled .* though its watchdog is to stop it after 300 ms"
    ):
        recorded(RIG, tmp_path, TARE)
    measured = read_recording(tmp_path / "sim-odrive.mcap").measured
    assert [event.kind for event in measured.events] == ["stop"]
    assert len(measured.ticks) == 0


def test_a_rig_may_leave_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ODriveAxis, "_starve", lambda self: None)
    done = recorded(replace(RIG, supervision=Supervision(verify_watchdogs=False)), tmp_path, TARE)
    assert [event.kind for event in done.measured.events] == ["step"]


@pytest.mark.long
def test_the_guard_is_told_what_tare_and_calibrate_find(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    backends: list[Any] = []

    def load(name: str) -> Any:
        made = load_backend(name)
        return lambda *given, **options: backends.append(made(*given, **options)) or backends[-1]

    monkeypatch.setattr(engine, "load_backend", load)
    done = recorded(RIG, tmp_path, TARE, Step("calibrate", CalibrateOptions(duration_s=4.0)))
    known = guard_model_of(done.knowledge)
    truth = backends[0]._truth
    assert known.torque is not None
    assert known.torque.noise_nm == pytest.approx(truth.torque_sensor.noise_nm, rel=0.1)
    assert (known.torque.period_s, known.torque.longest_repeat) == (pytest.approx(1e-3, rel=0.01), 1)
    assert known.torque.greatest_step_nm is not None
    assert 5e-3 < known.torque.greatest_step_nm < 0.2
    assert known.sensor_stiffness_nm_rad == pytest.approx(truth.torque_sensor.stiffness_nm_rad, rel=0.1)
    assert known.still_swing_nm is not None
    assert 2e-3 < known.still_swing_nm < 0.1
    assert known.amperes_per_command == pytest.approx(truth.actuator.motor.Ka, rel=0.05)
    assert known.load_amperes_per_nm == pytest.approx(truth.load.motor.Ka, rel=0.1)
    breakaway = (truth.actuator.motor.tau_c + truth.load.motor.tau_c) / (
        truth.actuator.motor.Km * truth.actuator.motor.Ka
    )
    assert known.moving_command == pytest.approx(breakaway, rel=0.5)
    for machine, true in ((known.actuator, truth.actuator.motor), (known.load, truth.load.motor)):
        assert machine is not None
        assert machine.torque_gain == pytest.approx(true.Km * true.Ka, rel=0.1)
        assert machine.inertia_kgm2 == pytest.approx(true.Im, rel=0.1)
        assert machine.coulomb_torque_nm == pytest.approx(true.tau_c, rel=0.2)
        # The amplifier's lag, and some delays of tenths of a millisecond.
        assert 1.0 / true.beta < machine.lag_s < 1.0 / true.beta + 2e-3


def test_of_a_lone_actuator_it_is_told_what_there_is(tmp_path: Path) -> None:
    known = guard_model_of(recorded(FREE, tmp_path, TARE).knowledge)
    assert (known.torque, known.load_amperes_per_nm, known.load, known.actuator) == (None, None, None, None)
    assert known.amperes_per_command == pytest.approx(18.0, rel=0.05)
    assert known.moving_command is not None
    assert 0.015 < known.moving_command < 0.05


def test_before_the_tare_nothing_is_known() -> None:
    assert guard_model_of(Knowledge(RIG)) == EMPTY_MODEL
