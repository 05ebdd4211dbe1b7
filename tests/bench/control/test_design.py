"""Gains keep their margins on benches other than the calibrated one, or there are none and somebody says so."""

from dataclasses import replace
from itertools import product
from math import ceil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.control import core, design
from norton_bench.control.calibration import ActuatorFriction, LoadCalibration
from norton_bench.control.design import (
    TorqueGains,
    design_torque_loop,
    design_tracking,
    nominal_bench,
    sliding_benches,
    sticking_benches,
)
from norton_bench.control.observer import WIDTH, Observer, holds_at_any_age
from norton_bench.control.regulator import TWIST, TWIST_RATE
from norton_bench.control.robustness import Control, margins, torque_control, tracking_control
from norton_bench.errors import ExperimentError
from tests.bench.control.plant import PlantSettings

TICK_S = 1e-3
CALIBRATION = replace(PlantSettings().calibration(), actuator_inertia_kgm2=5e-5)


def scales() -> st.SearchStrategy[float]:
    return st.floats(-1.0, 1.0).map(lambda power: 2.0**power)


@st.composite
def calibrations(draw: st.DrawFn) -> LoadCalibration:
    """The demonstration rig, everything between half and twice its value; sensors from 50 to 1000 N m/rad."""
    c = CALIBRATION
    return replace(
        c,
        amplifier_bandwidth_rad_s=c.amplifier_bandwidth_rad_s * draw(scales()),
        inertia_kgm2=c.inertia_kgm2 * draw(scales()),
        coulomb_torque_nm=c.coulomb_torque_nm * draw(scales()),
        presliding_stiffness_nm_rad=c.presliding_stiffness_nm_rad * draw(scales()),
        presliding_damping_nms_rad=c.presliding_damping_nms_rad * draw(scales()),
        sensor_stiffness_nm_rad=draw(st.floats(50.0, 1000.0)),
        sensor_damping_nms_rad=c.sensor_damping_nms_rad * draw(scales()),
        command_delay_s=draw(st.floats(1e-4, 1.3e-3)),
        measurement_delay_s=draw(st.floats(0.0, 6e-4)),
        motion_delay_s=draw(st.floats(-5e-4, 6e-4)),
        actuator_inertia_kgm2=draw(st.one_of(st.none(), scales().map(lambda scale: 5e-5 * scale))),
    )


def law(observer: Observer, gains: TorqueGains, share: float, damping_nms_rad: float) -> Control:
    """The torque loop with a share of its gains."""
    return torque_control(observer, share * gains.proportional, share * gains.integral_per_s, damping_nms_rad, TICK_S)


@pytest.mark.long
@settings(max_examples=8)
@given(calibrations(), st.floats(0.95, 1.08), st.floats(-0.4, 0.4), st.floats(0.85, 1.15))
def test_stable_on_a_bench_that_the_calibration_missed(
    calibration: LoadCalibration, gain: float, late_ticks: float, stiffness: float
) -> None:
    tracking = design_tracking(calibration, TICK_S)
    gains = design_torque_loop(calibration, tracking.observer, TICK_S)
    nominal = nominal_bench(calibration, TICK_S)
    bench = replace(
        nominal,
        gain=gain * nominal.gain,
        command_delay_s=max(nominal.command_delay_s + late_ticks * TICK_S, 0.0),
        stiffness_nm_rad=stiffness * nominal.stiffness_nm_rad,
    )
    assert margins(bench, law(tracking.observer, gains, 1.0, gains.damping_nms_rad), TICK_S).stable
    assert margins(bench, law(tracking.observer, gains, gains.boost, 0.0), TICK_S).stable
    assert margins(bench, tracking_control(tracking.observer, tracking.regulator), TICK_S).stable


@pytest.mark.parametrize("stiffness", [50.0, 200.0, 1000.0])
def test_margins_across_calibration_errors(stiffness: float) -> None:
    """Gain 10 % up, half a tick later, a third more inertia: at least 2 of gain margin, 26° of phase margin."""
    calibration = replace(CALIBRATION, sensor_stiffness_nm_rad=stiffness)
    tracking = design_tracking(calibration, TICK_S)
    gains = design_torque_loop(calibration, tracking.observer, TICK_S)
    bench = nominal_bench(calibration, TICK_S)
    boosted = law(tracking.observer, gains, gains.boost, 0.0)
    for missed in (
        replace(bench, gain=1.1 * bench.gain),
        replace(bench, command_delay_s=bench.command_delay_s + 0.5 * TICK_S),
        replace(bench, actuator_inertia_kgm2=1.33 * bench.actuator_inertia_kgm2),
    ):
        assert margins(missed, boosted, TICK_S).within(2.2)


# Two light machines on a soft sensor: 119 Hz, hardly damped. What holds it still while the contacts stick is the
# damping of the loop, and that ends where they slide.
SWINGS = replace(
    CALIBRATION,
    torque_gain=0.842,
    inertia_kgm2=4.236e-4,
    viscous_damping_nms_rad=4.83e-4,
    coulomb_torque_nm=3.72e-3,
    presliding_stiffness_nm_rad=2.09,
    presliding_damping_nms_rad=9.6e-3,
    command_delay_s=6.67e-4,
    measurement_delay_s=0.0,
    motion_delay_s=1.7e-5,
    sensor_stiffness_nm_rad=70.4,
    sensor_damping_nms_rad=9.5e-3,
    position_resolution_rad=1.92e-4,
    actuator_inertia_kgm2=1.762e-4,
)


def test_a_shaft_that_slides_gets_gentler_gains_where_damping_kept_it_still() -> None:
    tracking = design_tracking(SWINGS, TICK_S)
    gains = design_torque_loop(SWINGS, tracking.observer, TICK_S)
    assert gains.damping_nms_rad > 0.0
    assert gains.boost < 1.0
    sliding = tuple(sliding_benches(SWINGS, TICK_S))
    assert design.holds(law(tracking.observer, gains, gains.boost, 0.0), sliding, 2.2, TICK_S)
    assert not design.holds(law(tracking.observer, gains, 1.0, 0.0), sliding, 2.2, TICK_S)


def test_the_usual_gains_are_kept_to_where_they_will_do() -> None:
    assert design_tracking(CALIBRATION, TICK_S).gentler == 1.0


def test_the_observer_holds_whatever_the_age_of_readings() -> None:
    tracking = design_tracking(CALIBRATION, TICK_S)
    bench = nominal_bench(CALIBRATION, TICK_S)
    assert holds_at_any_age(tracking.observer, bench, TICK_S)
    eager = replace(tracking.observer, gains=4.0 * tracking.observer.gains)
    assert not holds_at_any_age(eager, bench, TICK_S)


# Torque readings 1.6 to 2.6 ms old: now and then they are of a whole number of ticks ago.
ACROSS_A_TICK = LoadCalibration(
    torque_gain=0.698, amplifier_bandwidth_rad_s=953, inertia_kgm2=6.64e-5, viscous_damping_nms_rad=8.5e-5,
    coulomb_torque_nm=0.00322, presliding_stiffness_nm_rad=24.1, presliding_damping_nms_rad=0.00733,
    command_delay_s=1.851e-3, measurement_delay_s=0.0, motion_delay_s=-1.591e-3, sensor_stiffness_nm_rad=42.2,
    sensor_damping_nms_rad=0.00548, torque_noise_nm=4.55e-3, torque_bias_nm=0.0, position_resolution_rad=3.49e-4,
    actuator_inertia_kgm2=1.262e-5,
)  # fmt: skip


def misled(observer: Observer, calibration: LoadCalibration, ages_s: tuple[float, ...], ticks: int) -> float:
    """How far the running observer is off after ``ticks`` of perfect readings of a bench at rest, over the worst."""
    states, inputs = np.zeros((observer.past + 1, WIDTH)), np.zeros((observer.past + 1, 4))
    states[:, TWIST_RATE] = 1.0
    delays_s = np.array([calibration.torque_delay_s, calibration.position_delay_s, calibration.position_delay_s])
    sizes = []
    for _ in range(ticks):
        seen_s = delays_s + ages_s
        core.correct(states, inputs, np.zeros(3), seen_s, np.ones(3, bool), TICK_S, observer.rows, observer.gain)
        core.predict(states, inputs, observer.step)
        sizes.append(abs(calibration.sensor_stiffness_nm_rad * states[0, TWIST]))
    return max(sizes[-20:]) / max(sizes)


def test_the_running_observer_forgets_its_errors_at_every_age_of_the_readings() -> None:
    """At steps of a twentieth of a tick, and just before and behind whole ticks."""
    observer = design_tracking(ACROSS_A_TICK, TICK_S).observer
    whole_s = ceil(ACROSS_A_TICK.torque_delay_s / TICK_S) * TICK_S - ACROSS_A_TICK.torque_delay_s
    ages_s = [*np.linspace(0.0, TICK_S, 21), whole_s - 1e-7, whole_s + 1e-7]
    for torque_s, load_s, actuator_s in product(ages_s, (1e-7, TICK_S), (1e-7, TICK_S)):
        assert misled(observer, ACROSS_A_TICK, (torque_s, load_s, actuator_s), 400) < 0.1


def test_an_observer_that_fails_at_a_whole_tick_alone_is_seen_to() -> None:
    """Trusting encoders to two counts, as sharp as any; at the ends of the readings' ages it holds."""
    bench = nominal_bench(ACROSS_A_TICK, TICK_S)
    torque_nm = design.doubted_torque_nm(ACROSS_A_TICK)
    free_rad_s2 = 100 * torque_nm / bench.actuator_inertia_kgm2
    sharp = design.doubting_observer(ACROSS_A_TICK, bench, 2.0, (free_rad_s2, free_rad_s2, 30 * torque_nm), TICK_S)
    whole_s = 2 * TICK_S - ACROSS_A_TICK.torque_delay_s
    assert misled(sharp, ACROSS_A_TICK, (whole_s, 6e-4, 2e-4), 400) == 1.0
    assert misled(sharp, ACROSS_A_TICK, (0.0, 6e-4, 2e-4), 400) < 0.1
    assert misled(sharp, ACROSS_A_TICK, (TICK_S, 6e-4, 2e-4), 400) < 0.1
    assert not holds_at_any_age(sharp, bench, TICK_S)


def test_too_bold_a_gain_is_seen_to_be_unstable() -> None:
    tracking = design_tracking(CALIBRATION, TICK_S)
    bold = torque_control(tracking.observer, 10.0, 10_000.0, 0.0, TICK_S)
    assert not margins(nominal_bench(CALIBRATION, TICK_S), bold, TICK_S).stable


def test_sensitivity_of_a_weak_loop_is_that_of_its_continuous_model() -> None:
    """S = 1/(1 − L) with L in continuous time at a frequency far below the tick's."""
    bench = replace(
        nominal_bench(CALIBRATION, TICK_S), actuator_inertia_kgm2=1.0, stiffness_nm_rad=2e4, damping_nms_rad=5.0
    )
    tracking = design_tracking(CALIBRATION, TICK_S)
    integral = 150.0
    found = margins(bench, torque_control(tracking.observer, 0.0, integral, 0.0, TICK_S), TICK_S)
    omega = np.geomspace(10.0, 1500.0, 2000)
    s = 1j * omega
    # Holding the command adds half a tick; summing up to the newest reading takes half a tick away.
    delay_s = bench.command_delay_s + bench.torque_delay_s
    # The wall takes all of the load's torque below its resonance: τ = −T.
    loop = -integral / s * bench.gain / (1 + s / bench.bandwidth_rad_s) * np.exp(-s * delay_s)
    assert found.sensitivity == pytest.approx(np.max(1 / np.abs(1 - loop)), rel=0.02)


@pytest.mark.long
def test_no_margins_no_gains_but_a_sentence_with_what_would_help(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a bench that is 12 ms late, with few candidates: delay is what has to be mended, and counts would not."""
    monkeypatch.setattr(design, "GENTLE_EFFORTS", ())
    monkeypatch.setattr(design, "DISTRUSTS", ())
    late = replace(CALIBRATION, command_delay_s=0.012)
    with pytest.raises(
        ExperimentError, match=r"prescribed motion.*a shorter delay from command to torque \(12"
    ) as said:
        design_tracking(late, TICK_S)
    assert "counts" not in str(said.value)
    observer = design_tracking(CALIBRATION, TICK_S).observer
    monkeypatch.setattr(design, "INTEGRAL_TIMES_S", ())
    with pytest.raises(ExperimentError, match=r"zero torque: no feedback keeps its margins.*run 'calibrate' again"):
        design_torque_loop(CALIBRATION, observer, TICK_S)


# Two benches as `calibrate` measured them: 8192 counts a turn and a sensor that seems 40 % too stiff; a drive that is
# 1.7 ms late. No gains of the usual family were stable on all that they may mean.
COARSE = LoadCalibration(
    torque_gain=0.981, amplifier_bandwidth_rad_s=651, inertia_kgm2=1.228e-4, viscous_damping_nms_rad=1.41e-4,
    coulomb_torque_nm=0.031, presliding_stiffness_nm_rad=15.4, presliding_damping_nms_rad=0.00695,
    command_delay_s=-8.6e-5, measurement_delay_s=0.0, motion_delay_s=-2.94e-4, sensor_stiffness_nm_rad=2300.0,
    sensor_damping_nms_rad=0.00424, torque_noise_nm=2.4e-4, torque_bias_nm=0.0, position_resolution_rad=7.67e-4,
    actuator_inertia_kgm2=2.16e-4, actuator_friction=ActuatorFriction(3.8e-4, 0.0448, 3.27, 0.0225),
)  # fmt: skip
LATE = LoadCalibration(
    torque_gain=0.938, amplifier_bandwidth_rad_s=1647, inertia_kgm2=1.468e-4, viscous_damping_nms_rad=1.93e-4,
    coulomb_torque_nm=0.0308, presliding_stiffness_nm_rad=3.05, presliding_damping_nms_rad=0.00186,
    command_delay_s=1.66e-3, measurement_delay_s=0.0, motion_delay_s=-8.9e-4, sensor_stiffness_nm_rad=93.7,
    sensor_damping_nms_rad=0.00153, torque_noise_nm=3.5e-4, torque_bias_nm=0.0, position_resolution_rad=7.67e-4,
    actuator_inertia_kgm2=5.68e-5, actuator_friction=ActuatorFriction(1.95e-3, 0.00641, 5.22, 0.0152),
)  # fmt: skip


# One more: a sensor that rings at 220 Hz, where a loop 2 ms late still acts. With the usual observers only gains that
# follow nothing are stable.
RINGING = LoadCalibration(
    torque_gain=1.193, amplifier_bandwidth_rad_s=985, inertia_kgm2=2.03e-4, viscous_damping_nms_rad=2.1e-4,
    coulomb_torque_nm=0.00221, presliding_stiffness_nm_rad=7.41, presliding_damping_nms_rad=0.0198,
    command_delay_s=7.9e-4, measurement_delay_s=0.0, motion_delay_s=1.4e-5, sensor_stiffness_nm_rad=190.0,
    sensor_damping_nms_rad=0.00136, torque_noise_nm=4.2e-4, torque_bias_nm=0.0, position_resolution_rad=1.9e-4,
    actuator_inertia_kgm2=1.87e-4,
)  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("calibration", [COARSE, LATE, RINGING], ids=["coarse", "late", "ringing"])
def test_other_gains_where_the_usual_ones_are_not_stable(
    calibration: LoadCalibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracking = design_tracking(calibration, TICK_S)
    loop = tracking_control(tracking.observer, tracking.regulator)
    benches = (*design.sliding_benches(calibration, TICK_S), *sticking_benches(calibration, TICK_S))
    assert all(margins(bench, loop, TICK_S).within(design.TRACKING_SENSITIVITY) for bench in benches)
    assert design_torque_loop(calibration, tracking.observer, TICK_S).integral_per_s > 0.0
    monkeypatch.setattr(design, "GENTLE_EFFORTS", ())
    monkeypatch.setattr(design, "DISTRUSTS", ())
    with pytest.raises(ExperimentError, match="no feedback, however gentle, is stable"):
        design_tracking(replace(calibration, actuator_friction=None), TICK_S)


def test_an_observer_that_goes_by_the_encoders_spares_a_ringing_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    """At least ten times as stiff as what the usual observers come to."""
    by_encoders = design_tracking(RINGING, TICK_S)
    assert by_encoders.gentler == 1.0
    monkeypatch.setattr(design, "DISTRUSTS", ())
    assert by_encoders.regulator.on_state[0] > 10.0 * design_tracking(RINGING, TICK_S).regulator.on_state[0]


def test_a_contact_that_is_known_is_not_guessed() -> None:
    """The actuator's own, to either side of its estimate, whatever the load's is."""
    known = {bench.actuator_spring_nm_rad for bench in sticking_benches(LATE, TICK_S)}
    assert min(known) < 5.22 < max(known) < 1.5 * 5.22
    guessed = {
        bench.actuator_spring_nm_rad for bench in sticking_benches(replace(LATE, actuator_friction=None), TICK_S)
    }
    assert min(guessed) < 3.05 < max(guessed)


def test_a_stiff_sensor_with_delays_of_several_ticks_has_an_observer() -> None:
    """Seed 181 of ``benchmarks/wide_family.py``, where scipy's Riccati solver gives up: a shift of four past states."""
    calibration = LoadCalibration(
        torque_gain=1.2959218513462782,
        amplifier_bandwidth_rad_s=1002.4203652461889,
        inertia_kgm2=9.68756025666254e-05,
        viscous_damping_nms_rad=0.00020994428293985332,
        coulomb_torque_nm=0.003950430594396785,
        presliding_stiffness_nm_rad=28.61220072748189,
        presliding_damping_nms_rad=0.004448658390869232,
        command_delay_s=0.0023592788167692545,
        measurement_delay_s=0.0,
        sensor_stiffness_nm_rad=1062.677230475428,
        sensor_damping_nms_rad=0.001282679388439645,
        torque_noise_nm=0.0033169436196135477,
        torque_bias_nm=-0.005296888456775388,
        position_resolution_rad=0.0001917475984857043,
        motion_delay_s=-0.001630607433643355,
        actuator_inertia_kgm2=1.842724817745269e-05,
        actuator_friction=ActuatorFriction(
            viscous_damping_nms_rad=0.0028979297694817613,
            coulomb_torque_nm=0.0066098056137565185,
            presliding_stiffness_nm_rad=34.64857779891837,
            presliding_damping_nms_rad=0.013656859641674573,
        ),
    )
    tracking = design_tracking(calibration, TICK_S)
    assert holds_at_any_age(tracking.observer, nominal_bench(calibration, TICK_S).with_damping(1.0), TICK_S)


# Seed 374 of ``benchmarks/wide_family.py``: a soft and noisy sensor, frames that travel unevenly by 0.2 ms.
UNEVEN = LoadCalibration(
    torque_gain=1.036, amplifier_bandwidth_rad_s=985.6, inertia_kgm2=2.474e-4, viscous_damping_nms_rad=7.32e-4,
    coulomb_torque_nm=0.01163, presliding_stiffness_nm_rad=31.27, presliding_damping_nms_rad=0.00423,
    command_delay_s=1.5993e-3, measurement_delay_s=0.0, motion_delay_s=-9.25e-4, sensor_stiffness_nm_rad=71.67,
    sensor_damping_nms_rad=0.00956, torque_noise_nm=2.289e-3, torque_bias_nm=0.0, position_resolution_rad=9.587e-5,
    position_jitter_s=2.0e-4, actuator_inertia_kgm2=1.1048e-4,
    actuator_friction=ActuatorFriction(1.405e-3, 0.02719, 5.038, 0.00377),
)  # fmt: skip


def test_encoders_that_are_read_at_other_times_are_no_negative_damper() -> None:
    """A twist in proportion to the velocity: the shaft oscillated at 2.4 Hz, and ran away from a slow reference."""
    benches = tuple(design.unevenly_read(UNEVEN, TICK_S))
    assert {bench.age_difference_s for bench in benches} == {2.0e-4, -2.0e-4}

    def slowest(calibration: LoadCalibration) -> float:
        tracking = design_tracking(calibration, TICK_S)
        loop = tracking_control(tracking.observer, tracking.regulator)
        return max(margins(bench, loop, TICK_S).radius for bench in benches)

    assert slowest(replace(UNEVEN, position_jitter_s=0.0)) > 1.002  # grows by half in 0.2 s
    assert slowest(UNEVEN) < 1.0


def test_what_is_held_to_a_path_may_not_grow_however_slowly() -> None:
    """By 0.04 % a tick, e-fold in 2.4 s: common drift of both shafts would be let pass, and here nothing drifts."""
    calibration = replace(UNEVEN, position_jitter_s=0.0)
    tracking = design_tracking(calibration, TICK_S)
    loop = tracking_control(tracking.observer, tracking.regulator)
    nominal = nominal_bench(calibration, TICK_S)
    growing = replace(nominal, age_difference_s=-76e-6)
    assert margins(growing, loop, TICK_S).stable
    assert design._worst(loop, (nominal,), np.inf, TICK_S) < design.TRACKING_SENSITIVITY
    assert design._worst(loop, (nominal, growing), np.inf, TICK_S) == np.inf


def test_margins_are_looked_at_where_the_gentlest_feedback_has_them() -> None:
    """At 2.4 Hz, below 0.02 rad a tick, where usual gains have none."""
    calibration = replace(UNEVEN, position_jitter_s=0.0)
    tracking = design_tracking(calibration, TICK_S)
    loop = tracking_control(tracking.observer, tracking.regulator)
    slow = replace(nominal_bench(calibration, TICK_S), age_difference_s=-68e-6)
    assert margins(slow, loop, TICK_S).sensitivity > design.TRACKING_SENSITIVITY
