"""A bench moved by hand on the real path: the simulated drives tell whether they were stopped."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import OperatorStopError, SafetyStopError
from norton_bench.jog.hands import Board, Setpoints, bounds_of
from norton_bench.jog.script import JogScript, Pace, introductions
from norton_bench.jog.signals import BenchSignals
from norton_bench.procedures.knowledge import Knowledge, follow
from norton_bench.records import Measured
from norton_bench.rig.load import load_rig
from tests.bench.bench_in_simulation import Bench, opened
from tests.bench.half_rate import half_rate
from tests.bench.jog.test_hands import Keys

RIG = half_rate("sim-odrive")
ROOT = Path(__file__).parents[3]


@pytest.fixture
def bench() -> Iterator[Bench]:
    with opened(RIG) as bench:
        yield bench


@dataclass
class Played(Board):
    """Whose keys are pressed at their ``moments`` [s of bench time]."""

    keys: Keys = field(default_factory=Keys)
    moments: dict[float, str] = field(default_factory=dict)

    def wanted(self, elapsed_s: float) -> Setpoints:
        self.keys.now_s = elapsed_s
        for moment_s in [each for each in self.moments if each <= elapsed_s]:
            self.keys.give(self, self.moments.pop(moment_s))
        return super().wanted(elapsed_s)


def jogged(bench: Bench, keys: Keys, moments: dict[float, str]) -> list[Measured]:
    """What was measured while keys were pressed at those moments."""
    bounds = bounds_of(bench.rig)
    board = Played(keys, bench.rig, bounds, clock=lambda: keys.now_s, keys=keys, moments=moments)
    found = list[Measured]()
    for part in follow(JogScript(bounds, board).plan(Knowledge(bench.rig)), bench.loop):
        assert bench.armed() == ["actuator", "load"]
        keys.listen(board)
        found.append(part)
    return found


def velocity(parts: list[Measured]) -> np.ndarray:
    return np.concatenate([part.ticks["velocity_rad_s"] for part in parts])


def test_nudged_it_turns_and_at_the_end_it_is_idle(bench: Bench) -> None:
    keys = Keys()
    parts = jogged(bench, keys, {0.2: "actuator 0.1", 1.4: "zero", 2.4: "end"})
    ticks = np.concatenate([part.ticks for part in parts])
    assert ticks["command"].max() == pytest.approx(0.05, rel=1e-6)
    assert 5.0 < velocity(parts).max() < 40.0
    assert ticks["command"][-1] == 0.0
    assert not ticks["limited"].any()
    assert bench.armed() == []


def test_the_stop_word_idles_both_drives_within_a_tick(bench: Bench) -> None:
    keys = Keys()
    said_ns: list[int] = []

    def stop_request() -> str | None:
        if bench.backend.world.now_ns > 1_500_000_000 and not said_ns:
            said_ns.append(bench.backend.world.now_ns)
        return "space" if said_ns else None

    bench.loop.stop_request = stop_request
    with pytest.raises(OperatorStopError, match="space"):
        jogged(bench, keys, {0.0: "actuator 0.1"})
    assert bench.armed() == []
    last = bench.parts[-1].ticks["tick_ns"][-1] if len(bench.parts[-1].ticks) else bench.parts[-2].ticks["tick_ns"][-1]
    assert last <= said_ns[0] + RIG.tick_ns


def test_torques_end_at_the_speed_and_the_guard_has_nothing_to_stop(bench: Bench) -> None:
    keys = Keys()
    parts = jogged(bench, keys, {0.0: "actuator 0.8", 3.0: "end"})
    fastest = np.abs(velocity(parts)).max()
    assert 40.0 <= fastest < 60.0  # of 80, at which the guard stops
    assert sum("torques are switched off" in text for text in keys.said) == 1
    assert parts[-1].ticks["command"][-1] == 0.0


def test_who_lets_go_of_the_keys_lets_go_of_the_bench(bench: Bench) -> None:
    keys = Keys()
    parts = jogged(bench, keys, {0.0: "actuator 0.1", 13.0: "end"})
    ticks = np.concatenate([part.ticks for part in parts])
    time_s = (ticks["tick_ns"] - ticks["tick_ns"][0]) * 1e-9
    assert np.all(ticks["command"][(time_s > 1.0) & (time_s < 10.0)] == pytest.approx(0.05, rel=1e-6))
    assert np.all(ticks["command"][time_s > 10.8] == 0.0)
    assert abs(velocity(parts)[-1]) < 1.0


def test_the_guard_watches_as_ever(bench: Bench) -> None:
    keys = Keys()
    bench.after(1.0, lambda: bench.cut("torque_sensor"))
    with pytest.raises(SafetyStopError, match="torque sensor: silent"):
        jogged(bench, keys, {0.0: "actuator 0.1"})
    assert bench.armed() == []


def test_every_signal_is_seen_with_its_extremes(bench: Bench) -> None:
    keys, signals = Keys(), BenchSignals(RIG)
    for part in jogged(bench, keys, {0.0: "actuator 0.1", 1.0: "end"}):
        signals.take(part)
    seen = {(each.device, each.name): each for each in signals.seen()}
    assert seen["actuator", "command"].greatest == pytest.approx(0.05, rel=1e-6)
    assert seen["actuator", "supply"].value == pytest.approx(24.0)
    assert 0.0 <= seen["port", "torque"].age_s < 5e-3
    assert seen["actuator", "velocity"].least <= 0.0 < seen["actuator", "velocity"].greatest
    assert 0.0 < seen["actuator", "current"].age_s < 0.02
    assert ("actuator", "motor") not in seen  # this drive does not tell it
    assert ("modulator", "angle") not in seen
    signals.forget_extremes()
    again = {(each.device, each.name): each for each in signals.seen()}["actuator", "velocity"]
    assert again.least == again.value == again.greatest


def test_every_device_is_introduced(bench: Bench) -> None:
    said = list(introductions(RIG, tuple(bench.loop.identify())))
    assert [text.split(":")[0] for text in said] == ["device actuator", "device load", "device torque_sensor"]
    assert "firmware 0.6.10; direction 1, node 1" in said[0]


@pytest.mark.parametrize("name", ["sim-free-shaft", "sim-pneumatic", "sim-variable-stiffness", "sim-in-situ"])
def test_other_benches_can_be_moved(name: str) -> None:
    rig = load_rig(ROOT / "rigs" / f"{name}.toml")
    keys = Keys()
    with opened(rig) as bench:
        board = Board(keys, rig, bounds_of(rig))
        plan = JogScript(bounds_of(rig), board).plan(Knowledge(rig))
        parts = list[Measured]()
        for part in follow(plan, bench.loop):
            keys.press(board, "end" if parts else "actuator 0.05")
            parts.append(part)
        greatest = max(np.max(np.abs(part.ticks["command"])) for part in parts)
        assert greatest == pytest.approx(0.05 * rig.command.limit, rel=0.02)
        assert parts[-1].ticks["command"][-1] == pytest.approx(0.0, abs=1e-3 * rig.command.limit)
        assert bench.armed() == []


def test_a_simulated_bench_keeps_to_wall_time(monkeypatch: pytest.MonkeyPatch) -> None:
    slept, now = list[float](), [0.0]
    monkeypatch.setattr("norton_bench.jog.script.time.sleep", slept.append)
    monkeypatch.setattr("norton_bench.jog.script.time.monotonic", lambda: now[0])
    pace = Pace(0.0)
    pace(0.2)
    assert slept == [pytest.approx(0.2)]
    now[0] = 5.0  # a calibration, say: it is not made up for
    pace(0.2)
    now[0] = 5.1
    pace(0.2)
    assert slept[1:] == [pytest.approx(0.1)]


def test_limits_of_the_rig_are_kept_to() -> None:
    gentle = replace(RIG, limits=replace(RIG.limits, command_rate_per_s=0.02))
    keys = Keys()
    with opened(gentle) as bench:
        parts = jogged(bench, keys, {0.0: "actuator 0.1", 1.0: "end"})
    ticks = np.concatenate([part.ticks for part in parts])
    assert ticks["command"].max() == pytest.approx(0.02, rel=0.02)
    assert not ticks["limited"].any()
