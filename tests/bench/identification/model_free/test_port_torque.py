"""A source map under a port torque that is not zero: against a simulated shaft whose steady velocity is known."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.identification.impedance_table import ImpedanceTable
from norton_bench.identification.results import SensorZero
from norton_bench.identification.source_map import PortTorque, source_map
from norton_bench.records import MOTION, TICK, TORQUE, Measured, SegmentInfo
from norton_bench.segments import Use
from tests.bench.identification.synthetic import Bench

TICK_S, DWELL_TICKS = 1e-3, 400
GAIN, INERTIA, DAMPING, COULOMB = 0.9, 5e-5, 1e-3, 0.02
LEVELS = np.linspace(-0.08, 0.08, 11)
NOISE_NM, COGGING_NM = 1e-3, 2e-4
ZERO_NM, DRIFT_NM_S, ZERO_STD_NM = 3e-3, 2e-6, 2e-5


def steady(command):
    torque = GAIN * np.asarray(command)
    return np.sign(torque) * np.maximum(np.abs(torque) - COULOMB, 0.0) / DAMPING


def staircases(seed, port_nm):
    """Both staircases of a shaft from which the port takes ``port_nm``, which wanders and has a mean of its own."""
    random = np.random.default_rng(seed)
    command = np.repeat(np.concatenate([LEVELS, LEVELS[::-1]]), DWELL_TICKS)
    count = command.size
    taken_nm = port_nm * np.repeat(random.normal(1.0, 0.3, 22), DWELL_TICKS)
    hidden_nm = COGGING_NM * random.standard_normal(count)
    velocity, v = np.empty(count), float(steady(command[0]))
    moves = np.abs(GAIN * command) > COULOMB
    for k in range(count):
        push = GAIN * command[k] - np.sign(command[k]) * COULOMB - taken_nm[k] + hidden_nm[k]
        v = v + TICK_S / INERTIA * (push - DAMPING * v) if moves[k] else 0.5 * v
        velocity[k] = v
    stamps = 1_000_000_000 + 1_000_000 * np.arange(count)
    ticks, motion, torque = np.zeros(count, TICK), np.zeros(count, MOTION), np.zeros(count, TORQUE)
    ticks["tick_ns"], ticks["command"], ticks["segment"] = stamps, command, np.arange(count) >= count // 2
    motion["arrival_ns"], motion["position_rad"] = stamps, np.cumsum(velocity) * TICK_S
    torque["arrival_ns"], torque["valid"] = stamps, True
    zero_nm = ZERO_NM + DRIFT_NM_S * TICK_S * np.arange(count)
    torque["torque_nm"] = taken_nm + zero_nm + NOISE_NM * random.standard_normal(count)
    half, end = int(stamps[count // 2]), int(stamps[-1]) + 1_000_000
    segments = (
        SegmentInfo(0, "free", "staircase rising", Use.IDENTIFY, "admittance", int(stamps[0]), half),
        SegmentInfo(1, "free", "staircase falling", Use.IDENTIFY, "admittance", half, end),
    )
    return Measured(ticks=ticks, motion=motion, torque=torque, segments=segments)


def known(seed, table=None):
    """What a fit would say of zero and damping: the truth, and an error as large as it says."""
    ends_s = np.array([0.0, 8.8])
    wrong_nm = ZERO_STD_NM * np.random.default_rng([seed, 1]).standard_normal(2)
    zero = SensorZero(ends_s, ZERO_NM + DRIFT_NM_S * ends_s + wrong_nm, ZERO_STD_NM**2 * np.eye(2))
    return PortTorque(1_000_000_000, zero, table, DAMPING, 0.01 * DAMPING)


@pytest.mark.parametrize("port_nm", [0.0, 1e-3])
def test_the_bands_hold_the_source_whatever_torque_was_left(port_nm):
    inside, differs = [], []
    for seed in range(20):
        found = source_map(staircases(seed, port_nm), known(seed))
        moves = steady(found.command) != 0.0
        low, high = np.quantile(found.resampled_rad_s, [0.025, 0.975], axis=0)
        inside.append(((low < steady(found.command)) & (steady(found.command) < high))[moves])
        differs.append(found.hysteresis().significant)
    # 320 levels, of 20 zeros that are common to 16 each: a standard deviation of about 0.02.
    assert np.mean(inside) == pytest.approx(0.95, abs=0.05)
    assert sum(differs) <= 4  # more has a chance of 0.003


def test_as_measured_it_is_off_by_the_torque_over_the_damping():
    found, corrected = source_map(staircases(1, 1e-3)), source_map(staircases(1, 1e-3), known(1))
    moves = steady(found.command) != 0.0
    assert np.mean((found.velocity_rad_s - steady(found.command))[moves]) == pytest.approx(-1.0, abs=0.3)
    assert np.mean((corrected.velocity_rad_s - steady(found.command))[moves]) == pytest.approx(0.0, abs=0.1)
    assert not found.port_torque_nm.size
    assert np.mean(corrected.port_torque_nm) == pytest.approx(1e-3, abs=0.3e-3)


def test_a_shaft_at_rest_stays_where_friction_holds_it():
    found = source_map(staircases(2, 1e-3), known(2))
    rests = steady(found.command) == 0.0
    assert np.all(np.abs(found.velocity_rad_s[rests]) < 0.01)
    assert np.all(found.port_torque_nm[rests] > 0.0)


def table_of(torque):
    command, velocity = np.array([-0.08, 0.0, 0.08]), np.array([-40.0, -16.0, -4.0, 4.0, 16.0, 40.0])
    torque_nm = torque(command[:, None], velocity[None, :])
    return ImpedanceTable(command, velocity, torque_nm, np.full(torque_nm.shape, 5e-5), np.ones(torque_nm.shape))


def test_the_slope_is_that_beside_the_level_on_its_own_side_of_rest():
    """Drag that grows with the square of speed: its slope is exact at the middle of two columns."""
    table = table_of(lambda c, v: GAIN * c - 1e-3 * v - 2e-5 * v * np.abs(v) - COULOMB * np.sign(v))
    for velocity in (-28.0, -10.0, 10.0, 28.0):
        assert table.fall(0.03, velocity)[0] == pytest.approx(1e-3 + 4e-5 * abs(velocity), rel=1e-9)
    assert table.fall(0.0, 28.0)[1] == pytest.approx(np.hypot(5e-5, 5e-5) / 24.0)
    assert known(0, table).slope(0.03, 28.0) == table.fall(0.03, 28.0)


def test_where_the_grid_says_nothing_the_damping_does_and_where_neither_is_sure_there_is_none():
    table = table_of(lambda c, v: GAIN * c - 1e-3 * v)
    table.torque_nm[:, 3] = np.nan
    assert np.isnan(table.fall(0.0, 10.0)[0])
    assert known(0, table).slope(0.0, 10.0) == (DAMPING, 0.01 * DAMPING)
    unsure = PortTorque(0, known(0).zero, None, DAMPING, 0.5 * DAMPING)
    assert np.isnan(unsure.slope(0.0, 10.0)).all()


def test_the_zero_lies_on_straight_lines_between_its_knots():
    zero = SensorZero(np.array([0.0, 10.0, 20.0]), np.array([1.0, 3.0, 2.0]), np.eye(3))
    np.testing.assert_allclose(zero.at([-5.0, 0.0, 5.0, 15.0, 30.0]), [1.0, 1.0, 2.0, 2.5, 2.0])


def test_before_its_first_knot_the_zero_goes_on_as_evenly_as_it_drifts():
    zero = SensorZero(np.array([10.0, 20.0, 30.0]), np.array([1.0, 9.0, 3.0]), np.diag([1.0, 5.0, 4.0]))
    assert zero.before(0.0) == pytest.approx((0.0, np.sqrt(1.5**2 * 1.0 + 0.5**2 * 4.0)))
    assert SensorZero.constant(2.0).before(-5.0) == (2.0, 0.0)


def test_a_fit_that_tells_no_zero_corrects_nothing(result):
    assert PortTorque.of(result, None, 0) is not None
    assert PortTorque.of(replace(result, torque_zero=None), None, 0) is None


def test_the_fit_finds_the_zero_and_its_drift_within_what_it_says(experiment, result):
    """Of the synthetic bench: a bias and a steady drift."""
    bench, zero = Bench(), result.torque_zero
    true = bench.bias_nm + bench.drift_nm_s * zero.time_s
    assert np.all(np.abs(zero.value_nm - true) < 4 * np.sqrt(np.diag(zero.covariance_nm2)) + 1e-5)
