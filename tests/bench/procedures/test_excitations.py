"""Whatever the rig's limits, what is chosen from keeps to them, and begins and ends at rest."""

import re
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_bench.control.calibration import LoadCalibration
from norton_bench.identification.expansion import KNOWN, Linearised, information_of_plan
from norton_bench.models.network import NortonNetwork
from norton_bench.procedures.excitations import Candidate, PlanBounds, candidates
from norton_bench.procedures.refinement import Option, select
from norton_bench.procedures.waves import multisine, sine_motion
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_drivers.servo import Servo

RIG = load_rig(Path(__file__).parents[3] / "rigs" / "sim-odrive.toml")
NETWORK = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, command_unit="N*m")
LOAD = LoadCalibration(
    0.95, 1e3, 1.2e-4, 3e-4, 0.008, 8.0, 0.005, 1.5e-3, 0.0, 200.0, 0.01, 1e-3, 0.0, 4.8e-5, -1e-3, 5e-5
)


def limited(command: float = 0.5, **limits: float) -> Rig:
    return replace(RIG, command=replace(RIG.command, limit=command), limits=replace(RIG.limits, **limits))


def port_torque_nm(candidate: Candidate) -> np.ndarray:
    """The impedance once more, in plain steps: an exponential lag, and the Dahl contact along the path."""
    tick_s, motion = RIG.tick_s, candidate.motion
    motor, contact, torque_nm = 0.0, 0.0, []
    s_per_rad = NETWORK.presliding_stiffness_nm_rad / NETWORK.coulomb_torque_nm
    for command, velocity, acceleration in zip(
        candidate.command, motion.velocity_rad_s, motion.acceleration_rad_s2, strict=True
    ):
        before, side = contact, np.sign(velocity)
        contact = side + (contact - side) * np.exp(-s_per_rad * abs(velocity) * tick_s) if side else contact
        rate_nm = NETWORK.presliding_damping_nms_rad * (contact - before) / s_per_rad / tick_s
        friction = NETWORK.viscous_damping_nms_rad * velocity + NETWORK.coulomb_torque_nm * contact + rate_nm
        torque_nm.append(motor - NETWORK.inertia_kgm2 * acceleration - friction)
        motor += (NETWORK.torque_gain * command - motor) * (1 - np.exp(-NETWORK.amplifier_bandwidth_rad_s * tick_s))
    return np.array(torque_nm)


@pytest.mark.long
@settings(max_examples=12, deadline=None)
@given(
    command=st.floats(0.02, 2.0),
    rate=st.one_of(st.just(inf), st.floats(1.0, 100.0)),
    velocity=st.floats(2.0, 150.0),
    torque=st.floats(0.03, 1.0),
    power=st.one_of(st.just(inf), st.floats(0.05, 20.0)),
    load=st.floats(0.05, 1.0),
    travel=st.one_of(st.just(inf), st.floats(1e-3, 20.0)),
)
def test_every_candidate_keeps_to_every_limit(
    command: float, rate: float, velocity: float, torque: float, power: float, load: float, travel: float
) -> None:
    rig = limited(
        command,
        command_rate_per_s=rate,
        velocity_rad_s=velocity,
        torque_nm=torque,
        power_w=power,
        load_torque_nm=load,
    )
    for candidate in candidates(PlanBounds(rig, NETWORK, LOAD, travel), seed=1)[::4]:
        motion, port_nm = candidate.motion, port_torque_nm(candidate)
        needed_nm = np.abs(LOAD.inertia_kgm2 * motion.acceleration_rad_s2 - port_nm) + LOAD.coulomb_torque_nm
        for values, limit in (
            (candidate.command, command),
            (np.diff(candidate.command, prepend=0.0, append=0.0) / rig.tick_s, rate),
            (motion.velocity_rad_s, velocity),
            (motion.position_rad, travel),
            (port_nm, torque),
            (port_nm * motion.velocity_rad_s, power),
            (needed_nm / LOAD.torque_gain, load),
        ):
            assert np.max(np.abs(values)) <= 0.9 * limit, candidate.name


def test_candidates_follow_each_other_in_any_order() -> None:
    offered = candidates(PlanBounds(RIG, NETWORK, LOAD, inf), seed=1)
    for candidate in offered:
        motion = candidate.motion
        assert len(motion.position_rad) == candidate.ticks
        length_rad = np.max(np.abs(motion.position_rad))
        assert abs(motion.position_rad[-1]) <= 1e-4 * length_rad
        assert abs(motion.velocity_rad_s[-1]) <= 0.02 * np.max(np.abs(motion.velocity_rad_s))
        assert abs(candidate.command[-1]) <= 0.02 * RIG.command.limit
    assert len({candidate.name for candidate in offered}) == len(offered) > 20


def test_what_does_not_fit_at_all_is_not_offered() -> None:
    # A load that cannot overcome its own friction imposes nothing.
    rig = limited(load_torque_nm=0.9 * LOAD.coulomb_torque_nm)
    assert candidates(PlanBounds(rig, NETWORK, LOAD, inf), seed=1) == ()


def test_another_seed_gives_other_multisines_of_the_same_names() -> None:
    bounds = PlanBounds(RIG, NETWORK, LOAD, inf)
    first, second = candidates(bounds, seed=1), candidates(bounds, seed=2)
    assert [each.name for each in first] == [each.name for each in second]
    assert not np.array_equal(first[0].command, second[0].command)


@pytest.mark.parametrize(
    ("wide", "suits"),
    [
        ("torque_gain", "command"),
        ("amplifier_bandwidth", "command"),
        ("inertia", "shaken|at 25 Hz"),
        ("viscous_damping", "cruise"),
        ("presliding_stiffness", "loops"),
    ],
)
def test_what_is_widest_is_what_the_choice_excites(wide: str, suits: str) -> None:
    """Everything is known to a tenth of a per cent but one parameter."""
    bounds = PlanBounds(RIG, NETWORK, LOAD, inf)
    offered, at = candidates(bounds, seed=1), Linearised(NETWORK, 1.5e-3, -0.5e-3)
    options = [
        Option(each.ticks * RIG.tick_s, information_of_plan(bounds.excitation(each), at, 1e-3)) for each in offered
    ]
    known = np.array([1.0 if name == wide else 1e-5 if name.endswith("delay") else 1e-3 for name in KNOWN]) ** -2.0
    (best, *_) = select(options, np.diag(known), lambda each: each[:7], target=1e-4, time_s=2.0).picks
    assert re.search(suits, offered[best].name)


def test_a_held_shaft_swings_as_the_two_inertias_do() -> None:
    frequency_hz = 80.0
    command = 0.1 * np.sin(2 * np.pi * frequency_hz * np.arange(1000) * RIG.tick_s)
    swing = PlanBounds(RIG, NETWORK, LOAD, inf).swing_rad_s(command, sine_motion(0.1, 1.0, 1, RIG.tick_s))[500:]
    omega = 2 * np.pi * frequency_hz
    free = 0.9 * 0.1 / np.hypot(1, omega / 600.0) / (omega * (5e-5 + 1.2e-4))
    assert np.max(np.abs(swing)) == pytest.approx(free, rel=0.1)


def test_a_velocity_that_the_shaft_has_swings_nothing() -> None:
    motion = sine_motion(0.1, 4.0, 4, RIG.tick_s)
    looped = replace(NETWORK, servo=Servo(0.0, NETWORK.torque_gain))
    bounds = PlanBounds(RIG, looped, LOAD, inf)
    assert not bounds.swing_rad_s(motion.velocity_rad_s, motion).any()
    assert bounds.swing_rad_s(motion.velocity_rad_s + 1.0, motion)[-1] > 1.0


def test_clipping_makes_a_multisine_flat() -> None:
    for seed in range(5):
        plain, flat = (
            multisine(2.0, RIG.tick_s, low_hz=5.0, high_hz=200.0, seed=seed, lines=30, clippings=clippings)
            for clippings in (0, 50)
        )
        assert np.max(np.abs(flat)) == pytest.approx(1.0)
        assert np.std(flat) > 1.1 * np.std(plain)
        spectra = [np.abs(np.fft.rfft(wave / np.std(wave))) for wave in (plain, flat)]
        assert np.corrcoef(spectra)[0, 1] > 0.9
