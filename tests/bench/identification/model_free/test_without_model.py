"""Table and operator on a simulated experiment, beside the truth and beside the parametric network."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from norton_bench.identification.impedance_table import ImpedanceTable, impedance_table
from norton_bench.identification.rows import align, usable_of
from norton_bench.identification.signals import FINE, Signals, signals
from norton_bench.identification.validation import validate
from norton_bench.identification.without_model import (
    COMMAND_TICKS,
    ELEMENTS,
    Normal,
    fit_operator,
    operator_columns,
    without_model,
)
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.synthetic import TICK_S, Truth

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def unseen():
    return synthetic.validation(9)


@pytest.fixture(scope="module")
def found(experiment, result, unseen):
    stretches = signals(experiment, TICK_S, Use.IDENTIFY)
    return without_model(result, stretches, signals(unseen, TICK_S, Use.VALIDATE), experiment.segments)


def test_the_operator_predicts_unseen_torque_nearly_as_well_as_the_network(found, result, unseen):
    network = validate(result, unseen, tick_s=TICK_S)
    assert found.operator_prediction.torque_rms_nm < 1.15 * network.torque_rms_nm
    assert found.operator_prediction.share == 1.0


def test_the_operator_finds_what_a_motor_is_made_of_without_being_told(found):
    truth, operator = Truth(), found.operator
    assert operator.torque_gain == pytest.approx(truth.torque_gain, rel=0.01)
    assert operator.inertia_kgm2 == pytest.approx(truth.inertia, rel=0.03)
    assert operator.coulomb_torque_nm == pytest.approx(truth.coulomb_torque, rel=0.03)
    # The contact of the simulated motor yields by an exponential, not all at once.
    assert operator.abrupt_share < 0.1
    assert np.all(operator.strength_nm >= 0)
    assert np.all(operator.damping_nms >= 0)


def slipping(seed, duration_s=20.0):
    """A machine whose friction is two ideal stops of 1 and 8 mrad, under a random motion with many turning points.

    Each stop is stepped sample by sample here, by a loop of its own.
    """
    rng = np.random.default_rng(seed)
    count = round(duration_s / TICK_S)
    fine_s = np.arange(count * FINE) * TICK_S / FINE
    position = sum(
        a / f * np.sin(2 * np.pi * f * fine_s + rng.uniform(0, 6)) for a, f in ((0.02, 0.7), (0.03, 2.3), (0.05, 5.9))
    )
    torque, command = np.zeros(position.size), np.repeat(0.05 * rng.normal(size=count // 20), 20)
    for reach, strength in ((1e-3, 0.01), (8e-3, 0.02)):
        strain = 0.0
        for k in range(1, position.size):
            strain = min(max(strain + position[k] - position[k - 1], -reach), reach)
            torque[k] -= strength * strain / reach
    torque -= 4e-5 * np.gradient(np.gradient(position, TICK_S / FINE), TICK_S / FINE)
    time_s = np.arange(count) * TICK_S
    usable = np.zeros(count, dtype=bool)
    usable[200:-200] = True
    return Signals(
        tick_s=TICK_S,
        origin_ns=0,
        time_s=time_s,
        position_rad=position,
        path_rad=position,
        sent_s=time_s,
        command=command,
        segment=np.zeros(count, np.int64),
        usable=usable,
        rests=np.empty(0, np.int64),
        torque_nm=torque[::FINE] + 0.5 * command + 1e-4 * rng.normal(size=count),
    )


def test_friction_that_yields_all_at_once_is_told_from_one_that_gives_way():
    columns, target = [], []
    for seed in (1, 2):
        stretches = align((slipping(seed),), 0.0)
        columns.append(operator_columns(stretches))
        target.append(usable_of(stretches, [each.torque_nm for each in stretches]))
    operator = fit_operator(Normal.of(columns[0], target[0]))
    assert operator.abrupt_share > 0.8
    assert operator.coulomb_torque_nm == pytest.approx(0.03, rel=0.05)
    assert operator.torque_gain == pytest.approx(0.5, rel=0.02)
    weak = operator.strength_nm[0][operator.yield_rad < 2.5e-3].sum()
    assert weak == pytest.approx(0.01, rel=0.25)
    unseen = target[1] - operator.predict(columns[1])
    # Neither stop's displacement is one of the grid's.
    assert np.sqrt(np.mean(unseen**2)) < 0.045 * np.sqrt(np.mean(target[1] ** 2))


def test_ideal_stops_alone_do_not_describe_a_contact_that_yields_gradually(found):
    assert found.stops_alone.torque_rms_nm > 2 * found.operator_prediction.torque_rms_nm


def test_the_operator_is_least_squares_under_bounds(experiment, result):
    """Against scipy's own bounded least squares on the same columns."""
    stretches = align(signals(experiment, TICK_S, Use.IDENTIFY)[-1:], result.motion_delay_s)
    columns = operator_columns(stretches)
    target = usable_of(stretches, [each.torque_nm for each in stretches])
    low = np.full(len(columns), -np.inf)
    low[COMMAND_TICKS + 2 :] = 0.0
    scale = np.linalg.norm(columns, axis=1)
    scale[scale == 0] = 1.0
    every = slice(None, None, 3)
    expected = lsq_linear((columns[:, every] / scale[:, None]).T, target[every], bounds=(low, np.inf), method="bvls")
    operator = fit_operator(Normal.of(columns[:, every], target[every]))
    cost = float(np.sum((target[every] - operator.predict(columns[:, every])) ** 2))
    assert cost == pytest.approx(2 * expected.cost, rel=1e-3)
    assert operator.strength_nm.shape == (2, ELEMENTS)


def test_the_table_holds_the_steady_torque(found):
    """Against the closed form of steady sliding: Km·Ka·c − B·ω − τc·sgn ω."""
    truth, table = Truth(), found.table
    command, velocity = np.meshgrid(table.command, table.velocity_rad_s, indexing="ij")
    expected = truth.torque_gain * command - truth.viscous_damping * velocity - truth.coulomb_torque * np.sign(velocity)
    assert table.torque_nm.shape == (3, 6)
    assert table.empty == 0
    np.testing.assert_allclose(table.torque_nm, expected, atol=0.5e-3)
    assert np.mean(np.abs(table.torque_nm - expected) < table.half_width_nm + 0.1e-3) > 0.8
    assert table.left_out_rms_nm() < 0.5e-3


def test_the_table_knows_steady_motion_only_and_its_figure_says_so(found):
    assert found.table_prediction.torque_relative > 3 * found.operator_prediction.torque_relative


def grid(torque):
    return ImpedanceTable(np.array([-1.0, 1.0]), np.array([-4.0, -1.0, 1.0, 4.0]), torque, 0 * torque, 1 + 0 * torque)


def test_between_cells_the_table_is_bilinear_on_each_side_of_rest():
    command, velocity = np.meshgrid([-1.0, 1.0], [-4.0, -1.0, 1.0, 4.0], indexing="ij")
    table = grid(2 * command - 0.5 * velocity - 3 * np.sign(velocity))
    for c, v in ((0.3, 2.0), (-0.9, -3.0), (1.0, 4.0), (-1.0, -1.0)):
        assert table.torque(c, v) == pytest.approx(2 * c - 0.5 * v - 3 * np.sign(v))
    assert table.torque(0.0, 0.1) == table.torque(0.0, 1.0)


def test_what_was_not_measured_is_not_made_up():
    torque = np.arange(8.0).reshape(2, 4)
    torque[0, 3] = np.nan
    table = grid(torque)
    assert table.empty == 1
    assert np.isnan(table.torque([0.0, 2.0, 0.0, 0.0], [2.0, 1.0, 5.0, 0.0])).all()
    assert table.torque(1.0, 2.0) == pytest.approx(6 + 1 / 3)


def test_an_empty_cell_is_found_empty(experiment, result):
    """Without the last grid segment's second half some cells were never visited."""
    last = [each for each in experiment.segments if each.name.startswith("grid")][-1]
    middle_ns = (last.start_ns + last.end_ns) // 2
    segments = tuple(replace(each, end_ns=middle_ns) if each is last else each for each in experiment.segments)
    cut = replace(experiment, segments=segments)
    table = impedance_table(align(signals(cut, TICK_S, Use.IDENTIFY), result.motion_delay_s), segments, 0.0)
    assert table.empty in (2, 3)


def test_no_grid_gives_no_table_and_no_torque_nothing(experiment, without_torque, result):
    stretches = signals(experiment, TICK_S, Use.IDENTIFY)
    assert impedance_table(align(stretches, 0.0), (), 0.0) is None
    assert without_model(result, signals(without_torque, TICK_S, Use.IDENTIFY), (), experiment.segments) is None


def test_nothing_unseen_leaves_the_predictions_out(experiment, result):
    found = without_model(result, signals(experiment, TICK_S, Use.IDENTIFY), (), experiment.segments)
    assert found.operator is not None
    assert found.operator_prediction is None
