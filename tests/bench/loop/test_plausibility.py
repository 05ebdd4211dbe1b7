"""Signals that contradict each other on the simulated bench: each lie is noticed by the check that is meant for it.

Faults are put into the emulated firmware and the plant; what they do to the bench travels as real frames and bytes.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import SafetyStopError
from norton_bench.guard.check import GuardModel, Machine, TorqueReadings
from norton_bench.procedures.waves import coasting, pushed
from norton_bench.records import Measured
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Supervision
from norton_bench.segments import Segment, Use
from norton_sim.firmware.bota import BotaSensor
from tests.bench.bench_in_simulation import Bench, opened

RIGS = Path(__file__).parents[3] / "rigs"
RIG = load_rig(RIGS / "sim-odrive.toml")
FREE = load_rig(RIGS / "sim-free-shaft.toml")
IN_SITU = load_rig(RIGS / "sim-in-situ.toml")
ELASTIC = load_rig(RIGS / "sim-series-elastic.toml")
# The rig's true values, which its own steps measure within a percent.
KNOWN = GuardModel(
    torque=TorqueReadings(bias_nm=0.0, noise_nm=1e-3, period_s=1e-3, longest_repeat=1, greatest_step_nm=0.03),
    moving_command=0.03,
    amperes_per_command=18.0,
    load_amperes_per_nm=19.0,
    sensor_stiffness_nm_rad=200.0,
    actuator=Machine(0.9, 5e-5, 1e-3, 0.02),
    load=Machine(0.95, 1.2e-4, 3e-4, 0.008),
)
# What tare tells without a torque sensor.
TARED = GuardModel(moving_command=0.03, amperes_per_command=18.0, load_amperes_per_nm=19.0)
# Of the position-driven actuator behind a spring no law is known.
ELASTIC_KNOWN = replace(KNOWN, moving_command=0.01, amperes_per_command=10.0, actuator=None, still_swing_nm=0.01)
BEGINS_S = 0.75  # of which enabling takes a quarter


class Matching(str):
    """Equal to every text that the pattern is found in."""

    __hash__ = str.__hash__

    def __eq__(self, other: object) -> bool:
        return isinstance(other, str) and re.search(self, other) is not None


@pytest.fixture
def bench() -> Iterator[Bench]:
    with opened(RIG) as made:
        made.loop.guard.learn(KNOWN)
        yield made


def shaking(duration_s: float = 1.5) -> Segment:
    """Both machines push, each in its own rhythm; the shaft reaches some 20 rad/s."""
    time_s = np.arange(0.0, duration_s, RIG.tick_s)
    return pushed(
        "test",
        "shake",
        Use.PREPARE,
        0.12 * np.sin(2 * pi * 3 * time_s) + 0.02,
        0.08 * np.sin(2 * pi * 7 * time_s),
    )


def swaying(duration_s: float = 1.5) -> Segment:
    """The load sways a spring whose source hardly moves; it reaches some 0.15 rad."""
    time_s = np.arange(0.0, duration_s, ELASTIC.tick_s)
    load_nm = 0.4 * np.sin(2 * pi * 1.5 * time_s)
    return pushed("test", "sway", Use.PREPARE, load_nm, 0.01 * np.sin(2 * pi * 0.8 * time_s))


def turns_by(bench: Bench, role: str, change: Callable[[float, float], tuple[float, float]]) -> None:
    """From now on the drive's encoder says ``change(turns, turns_s)`` of what it would say."""
    motor = bench.axis(role).motor
    honest = motor.estimates
    motor.estimates = lambda: change(*honest())  # type: ignore[method-assign]


def torque_by(bench: Bench, change: Callable[[float], float]) -> None:
    """From now on the torque sensor says ``change(torque_nm)`` of what it would say."""
    sensor = bench.backend.world.devices["torque_sensor"]
    assert isinstance(sensor, BotaSensor)
    honest = sensor.signal.measure_nm
    sensor.signal.measure_nm = lambda: change(honest())  # type: ignore[method-assign]


def flipped_here(bench: Bench, role: str) -> None:
    """From now on the encoder counts backwards; its velocity is taken from the count."""
    here, _ = bench.axis(role).motor.estimates()
    turns_by(bench, role, lambda turns, turns_s: (2 * here - turns, -turns_s))


def break_coupling(bench: Bench) -> None:
    bench.backend.world.plant.uncouple()


def run_away(bench: Bench, role: str, torque_nm: float) -> None:
    """The drive follows a command that nobody gave."""
    bench.backend.world.plant.run_away(role, torque_nm)  # type: ignore[arg-type]


def current_by(bench: Bench, role: str, change: Callable[[float], float]) -> None:
    motor = bench.axis(role).motor
    honest = motor.current_a
    motor.current_a = lambda: change(honest())  # type: ignore[method-assign]


def hold(bench: Bench, role: str) -> None:
    """The machine's shaft is blocked."""
    bench.backend.world.plant.jam(role)  # type: ignore[arg-type]


def run(bench: Bench, segment: Segment) -> Measured:
    with bench.loop.running():
        return bench.loop.run(segment)


def stopped(bench: Bench, fault: Callable[[Bench], None], segment: Segment) -> tuple[SafetyStopError, float]:
    """What the guard said, and how long after the fault [s]."""
    struck_ns = list[int]()

    def strike() -> None:
        struck_ns.append(bench.backend.world.now_ns)
        fault(bench)

    bench.after(BEGINS_S, strike)
    with pytest.raises(SafetyStopError) as stop:
        run(bench, segment)
    last_ns = max(int(part.ticks["tick_ns"][-1]) for part in bench.parts if len(part.ticks))
    assert bench.armed() == []
    return stop.value, (last_ns - struck_ns[0]) * 1e-9


def test_a_healthy_bench_that_is_shaken_is_left_alone(bench: Bench) -> None:
    measured = run(bench, shaking(3.0))
    assert len(measured.ticks) == 3000
    assert np.abs(measured.ticks["velocity_rad_s"]).max() > 15
    assert len(measured.load_current) == pytest.approx(300, abs=3)


@pytest.mark.parametrize(
    ("fault", "by", "words", "within_s"),
    [
        (lambda b: turns_by(b, "actuator", lambda p, v: (p + 0.2, v)), "encoder", "actuator encoder.*jumped", 0.01),
        (lambda b: turns_by(b, "load", lambda p, v: (p + 0.2, v)), "encoder", "load encoder.*jumped", 0.01),
        (lambda b: turns_by(b, "load", lambda p, v: (p, -v)), "encoder", "load encoder.*runs backwards", 0.2),
        (lambda b: turns_by(b, "actuator", lambda p, v: (1.0, 0.0)), "encoder", "actuator encoder", 0.2),
        (lambda b: b.axis("actuator").freeze(), "coupling", "the actuator's encoder stands still", 0.05),
        (lambda b: b.axis("load").freeze(), "coupling", "the load's encoder stands still", 0.05),
        (lambda b: flipped_here(b, "actuator"), "coupling", "turn opposite ways", 0.05),
        (lambda b: flipped_here(b, "load"), "coupling", "turn opposite ways", 0.05),
        (break_coupling, "coupling", "actuator and load have turned", 0.1),
        (lambda b: torque_by(b, lambda _: 0.0123), "frozen torque", "0.0123 N m in 5. readings in a row", 0.06),
        (lambda b: torque_by(b, lambda torque: torque + 0.2), "balance", "torque sensor's zero, sign and scale", 0.2),
        (lambda b: torque_by(b, lambda torque: -torque), "balance", "torque sensor's zero, sign and scale", 0.3),
        (lambda b: torque_by(b, lambda torque: 6 * torque), "balance", "torque sensor's zero, sign and scale", 0.6),
        (lambda b: run_away(b, "load", 0.0), "balance", "the other does not miss: check the load drive", 0.3),
        (lambda b: run_away(b, "actuator", 0.3), "current", "actuator drive.* 6 A.*follows something else", 0.1),
        (lambda b: run_away(b, "load", -0.4), "current", "load drive.* 8 A.*follows something else", 0.1),
        (lambda b: current_by(b, "actuator", lambda _: 4.0), "current", "actuator drive.*4 A", 0.1),
        (lambda b: current_by(b, "load", lambda current_a: -current_a), "current", "load drive", 0.3),
    ],
)
def test_a_lie_is_noticed_by_the_check_that_is_meant_for_it(
    bench: Bench, fault: Callable[[Bench], None], by: str, words: str, within_s: float
) -> None:
    stop, after_s = stopped(bench, fault, shaking())
    assert (stop.by, str(stop)) == (by, Matching(words))
    assert after_s < within_s


REST = coasting("test", "rest", Use.PREPARE, np.zeros(1000))


def test_a_load_that_is_held(bench: Bench) -> None:
    push = pushed("test", "push", Use.PREPARE, np.concatenate([np.zeros(700), np.full(1000, 0.12)]))
    stop, after_s = stopped(bench, lambda b: hold(b, "load"), push)
    assert (stop.by, str(stop)) == ("balance", Matching("the other does not miss: check the load drive"))
    assert after_s < 0.3


def test_a_torque_that_jumps_at_rest(bench: Bench) -> None:
    stop, after_s = stopped(bench, lambda b: torque_by(b, lambda torque: torque + 0.6), REST)
    assert (stop.by, str(stop)) == ("torque jump", Matching("jumped from .* to 0.6"))
    assert after_s < 0.006


def test_a_sensor_at_its_end_though_the_limit_allows_for_it() -> None:
    with opened(replace(RIG, limits=replace(RIG.limits, torque_nm=2.0))) as bench:
        stop, after_s = stopped(bench, lambda b: b.force_torque(1.999), REST)
    assert (stop.by, str(stop)) == ("saturation", Matching("end of its range of 2 N m"))
    assert after_s < 0.006


def test_an_encoder_that_is_stuck_on_a_free_shaft() -> None:
    with opened(FREE) as bench:
        bench.loop.guard.learn(KNOWN)
        command = np.concatenate([np.zeros(800), np.full(1000, 0.08)])
        stop, after_s = stopped(
            bench, lambda b: b.axis("actuator").freeze(), coasting("test", "push", Use.PREPARE, command)
        )
        assert abs(bench.backend.world.plant.true_velocity_rad_s("actuator")) < 60
    assert (stop.by, str(stop)) == ("standstill", Matching("stands still at .* under 0.08 N\\*m"))
    assert after_s < 0.35  # of which 0.2 s before the push


def test_an_encoder_that_sticks_while_a_free_shaft_turns() -> None:
    with opened(FREE) as bench:
        push = coasting("test", "push", Use.PREPARE, np.full(1500, 0.04))
        stop, after_s = stopped(bench, lambda b: b.axis("actuator").freeze(), push)
    assert (stop.by, str(stop)) == ("encoder", Matching("actuator encoder: its position is -"))
    assert after_s < 0.1


# ---- no law of the actuator is known --------------------------------------------------------------------------------


@pytest.fixture
def elastic() -> Iterator[Bench]:
    with opened(ELASTIC) as made:
        made.loop.guard.learn(ELASTIC_KNOWN)
        yield made


@pytest.mark.long
def test_a_healthy_spring_that_is_swayed_is_left_alone(elastic: Bench) -> None:
    measured = run(elastic, swaying(3.0))
    assert len(measured.ticks) == 3000
    assert np.ptp(measured.ticks["position_rad"]) > 0.2


@pytest.mark.parametrize(
    ("fault", "by", "words", "within_s"),
    [
        (lambda b: torque_by(b, lambda torque: -torque), "balance", "check the torque sensor's zero, sign", 0.3),
        (lambda b: torque_by(b, lambda torque: torque + 0.2), "balance", "check the torque sensor's zero, sign", 0.2),
        (lambda b: run_away(b, "load", 0.0), "balance", "the load drive, its direction", 0.3),
        (lambda b: run_away(b, "actuator", 0.2), "current", "actuator drive.*follows something else", 0.1),
        (lambda b: hold(b, "load"), "balance", "and that its shaft turns freely", 0.3),
        (lambda b: hold(b, "actuator"), "standstill", "stands still at .* while the port torque goes from", 0.2),
    ],
)
def test_without_a_law_of_the_actuator_the_load_and_the_drives_tell(
    elastic: Bench, fault: Callable[[Bench], None], by: str, words: str, within_s: float
) -> None:
    stop, after_s = stopped(elastic, fault, swaying())
    assert (stop.by, str(stop)) == (by, Matching(words))
    assert after_s < within_s


def test_a_spring_on_a_free_shaft_may_stand_still_under_its_greatest_command() -> None:
    alone = replace(ELASTIC.wiring, load=None, torque_sensor=None)
    actuator = {key: value for key, value in ELASTIC.simulated.items() if key not in ("load", "torque_sensor")}
    with opened(replace(ELASTIC, wiring=alone, simulated=actuator)) as bench:
        bench.loop.guard.learn(ELASTIC_KNOWN)
        measured = run(bench, coasting("test", "hold", Use.PREPARE, np.minimum(np.linspace(0.0, 0.4, 1500), 0.2)))
    assert len(measured.ticks) == 1500
    assert len(np.unique(measured.ticks["position_rad"][-200:])) == 1


# ---- two drives, and nothing that reads the torque between them ------------------------------------------------------


@pytest.fixture
def in_situ() -> Iterator[Bench]:
    with opened(IN_SITU) as made:
        made.loop.guard.learn(TARED)
        yield made


@pytest.mark.parametrize(
    ("fault", "by", "words", "within_s"),
    [
        (lambda b: b.axis("actuator").freeze(), "encoder", "actuator encoder", 0.1),
        (lambda b: flipped_here(b, "load"), "coupling", "turn opposite ways", 0.1),
        (break_coupling, "coupling", "actuator and load have turned", 0.2),
        (lambda b: run_away(b, "actuator", 0.3), "current", "actuator drive.*follows something else", 0.1),
        (lambda b: run_away(b, "load", -0.4), "current", "load drive.*follows something else", 0.1),
    ],
)
def test_without_a_torque_sensor_encoders_and_currents_are_held_against_each_other(
    in_situ: Bench, fault: Callable[[Bench], None], by: str, words: str, within_s: float
) -> None:
    stop, after_s = stopped(in_situ, fault, shaking())
    assert (stop.by, str(stop)) == (by, Matching(words))
    assert after_s < within_s


@pytest.mark.parametrize("role", ["actuator", "load"])
def test_without_a_torque_sensor_a_shaft_that_is_held_is_not_seen(in_situ: Bench, role: str) -> None:
    in_situ.after(BEGINS_S, lambda: hold(in_situ, role))
    assert len(run(in_situ, shaking()).ticks) == 1500


def test_one_bad_reading_is_let_pass(bench: Bench) -> None:
    def glitch(bench: Bench) -> None:
        motor = bench.axis("actuator").motor
        honest = motor.estimates

        def once() -> tuple[float, float]:
            del motor.estimates
            turns, turns_s = honest()
            return turns + 0.2, turns_s

        motor.estimates = once  # type: ignore[method-assign]

    bench.after(BEGINS_S, lambda: glitch(bench))
    assert len(run(bench, shaking(1.0)).ticks) == 1000


def test_what_the_rig_leaves_out_is_not_asked() -> None:
    rig = replace(RIG, supervision=Supervision(leave_out=("encoder", "coupling")))
    with opened(rig) as bench:
        bench.after(BEGINS_S, lambda: turns_by(bench, "actuator", lambda turns, turns_s: (turns + 0.2, turns_s)))
        assert len(run(bench, shaking()).ticks) == 1500
