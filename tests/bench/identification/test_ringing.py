"""Ringing between motor and load that readings fold down is taken off, or named; where there is none, nothing is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, linalg, signal

from norton_bench.identification.bootstrap import Readings
from norton_bench.identification.coupling import Coupling, Prior
from norton_bench.identification.departures import departures
from norton_bench.identification.expansion import Expansion
from norton_bench.identification.fit import result_of, solution_of
from norton_bench.identification.judged_fit import fit
from norton_bench.identification.live import LiveIdentifier
from norton_bench.identification.loops import oscillator_with_contact
from norton_bench.identification.model_error import folded_ringing
from norton_bench.identification.motor_values import physical
from norton_bench.identification.ringing import Ringing, left_uncertain, parts_of_ringing, remark_on, without_ringing
from norton_bench.identification.separable import solve_again
from norton_bench.identification.signals import FINE, sent_at_s, signals
from norton_bench.identification.simulated_bench import FINEST, PORT, SUBSTEPS, Contact, across_step, even_grid
from norton_bench.segments import Use
from tests.bench.identification import synthetic
from tests.bench.identification.live.phases import feed
from tests.bench.identification.synthetic import TICK_S, Bench, Truth

RESONANCE_HZ, LOAD_KGM2 = 1015.0, 1.2e-4
MOBILITY = 1.0 / Truth().inertia + 1.0 / LOAD_KGM2


@pytest.fixture(scope="module")
def brief():
    return synthetic.brief(1, multisine_s=20.0)


@pytest.fixture(scope="module")
def result_of_brief(brief):
    """Of its simulated records only the bench that makes them is used."""
    return fit(brief, command_unit="N*m", tick_s=TICK_S, draws=2)


def coupling(resonance_hz=RESONANCE_HZ):
    """The load is told three waves, in steps of a tick. The damping is far too great, as it is found where the twist
    hardly tells it."""
    stiffness = (2 * np.pi * resonance_hz) ** 2 / MOBILITY
    sent_s = np.arange(0.0, 120.0, TICK_S)
    told_nm = sum(0.05 * np.sin(2 * np.pi * frequency_hz * sent_s) for frequency_hz in (7.3, 23.1, 61.7))
    return Coupling(stiffness, 0.02 * stiffness, 0.5, 0.05, LOAD_KGM2, 1.0, 1000.0, 0.0, sent_s, told_nm)


def simulation(result, spring):
    bench = result.simulated.bench
    return replace(bench, readings=replace(bench.readings, coupling=spring))


def ringing(result, spring):
    """What is folded down of it over what was fitted."""
    bench = simulation(result, spring)
    return folded_ringing(bench, result, bench.stretches)


def shaken(experiment, result, spring):
    """The same readings of a torque that this spring has shaken."""
    bench = simulation(result, None)
    torque = experiment.torque.copy()
    torque["torque_nm"] += Ringing.of(bench, spring, bench.stretches).of_spring(spring)
    return replace(experiment, torque=torque)


def ringing_at(experiment, result, resonance_hz, ratio):
    """The equation about the same network, of readings that a spring of this resonance and damping has shaken."""
    readings = shaken(experiment, result, coupling(resonance_hz).damped(ratio, Truth().inertia))
    return Expansion.of(result, signals(readings, TICK_S, Use.IDENTIFY), ())


@pytest.mark.long
@pytest.mark.parametrize(("off", "ratio"), [(1.0, 0.02), (0.985, 0.05), (1.01, 0.02)])
def test_ringing_is_named_whatever_stiffness_and_damping_are_within_what_is_known(experiment, result, off, ratio):
    at = ringing_at(experiment, result, off * RESONANCE_HZ, ratio)
    found = departures(at, others=ringing(result, coupling()))
    assert found[0].kind.name == "ringing"
    assert "at some 1015 Hz, and it is read at 1000 Hz" in found[0].kind.cause


@pytest.mark.long
def test_where_nothing_rings_nothing_is_named(experiment, result):
    at = Expansion.of(result, signals(experiment, TICK_S, Use.IDENTIFY), ())
    assert departures(at, others=ringing(result, coupling())) == ()


def test_validation_may_follow_what_was_fitted_without_a_pause(experiment, result):
    """Both then lie in one span of time, of which each has its own samples."""
    fitted = signals(experiment, TICK_S, Use.IDENTIFY)
    half = fitted[-1].time_s > np.median(fitted[-1].time_s)
    early = (*fitted[:-1], replace(fitted[-1], usable=fitted[-1].usable & ~half))
    unseen = (replace(fitted[-1], usable=fitted[-1].usable & half),)
    bench = simulation(result, coupling()).over(unseen)
    ((_, _, columns),) = folded_ringing(bench, result, (*early, *unseen))
    assert columns.shape[1] == Expansion.of(result, early, unseen).residual.size
    assert np.all(np.any(columns != 0.0, axis=1))


@pytest.mark.parametrize("resonance_hz", [400.0, 700.0, 1300.0, 1500.0])
def test_ringing_that_is_not_folded_into_the_band_is_not_looked_for(result, resonance_hz):
    assert ringing(result, coupling(resonance_hz)) == ()


def test_without_a_calibration_no_spring_is_known(result):
    assert ringing(result, None) == ()


def found_in(measured, result, spring):
    """Readings, signals and solution without the ringing, where the calibration told this ``spring``."""
    stretches = signals(measured, TICK_S, Use.IDENTIFY)
    readings = replace(result.simulated.bench.readings, measured=measured, coupling=spring)
    return without_ringing(readings, stretches, solve_again(stretches, result.simulated.bench.solution))


# At exactly the rate of the readings stiffer and softer springs look alike: the prior decides there.
@pytest.mark.long
@pytest.mark.parametrize(("off", "ratio", "within"), [(1.0, 0.02, 0.01), (0.985, 0.06, 0.03)])
def test_the_readings_tell_the_spring_where_the_calibration_does_not(experiment, result, off, ratio, within):
    """Its damping could be anything, its stiffness is known to 2 %, and the load is 150 µs later than was told."""
    true = replace(coupling(off * RESONANCE_HZ).damped(ratio, Truth().inertia), load_extra_delay_s=1.5e-4)
    measured = shaken(experiment, result, true)
    quiet, _, _ = found_in(measured, result, replace(coupling(), damping_std_nms_rad=1.0))
    told = quiet.coupling
    assert told.stiffness_nm_rad == pytest.approx(true.stiffness_nm_rad, rel=within)
    assert told.damping_nms_rad == pytest.approx(true.damping_nms_rad, rel=0.2)
    assert told.damping_std_nms_rad < 0.1 * told.damping_nms_rad
    delay_std_s = np.linalg.norm(told.covariance_root[3])
    assert delay_std_s < 3.5e-5
    assert told.load_extra_delay_s == pytest.approx(1.5e-4, abs=delay_std_s)
    # What was taken off is what was put in.
    put_in = measured.torque["torque_nm"] - experiment.torque["torque_nm"]
    left = quiet.measured.torque["torque_nm"] - experiment.torque["torque_nm"]
    assert np.std(left) < 0.2 * np.std(put_in)


@pytest.mark.long
@pytest.mark.parametrize(
    ("resonance_hz", "presliding_damping", "calibrated"),
    [
        pytest.param(1200.0, 0.01, 1.33, id="far from what was calibrated"),
        pytest.param(1050.0, 0.03, 1.03, id="held by a strong contact"),
    ],
)
def test_parameters_biased_by_ringing_are_corrected(resonance_hz, presliding_damping, calibrated):
    """A bench that is simulated in steps of 10 µs; the calibration took its spring for stiffer, and the load for a
    quarter of a millisecond quicker than it is."""
    stiffness = (2 * np.pi * resonance_hz) ** 2 / MOBILITY
    truth = Truth(presliding_damping=presliding_damping)
    bench = Bench(stiffness=stiffness, damping=0.01, noise_nm=3e-4)
    measured = synthetic.brief(3, truth, bench, multisine_s=20.0)
    stretches, ticks = signals(measured, TICK_S, Use.IDENTIFY), measured.ticks
    sent_s = sent_at_s(ticks, int(ticks["tick_ns"][0]))
    told_nm = np.ascontiguousarray(ticks["load_torque_nm"])
    off, load, delay_s = calibrated - 1.0, (LOAD_KGM2, 0.95, 1000.0), bench.serial_delay_s
    spring = Coupling(calibrated * stiffness, off * stiffness, 0.0, 0.01, *load, delay_s, sent_s, told_nm)
    before = solution_of(stretches)
    readings = Readings(measured, TICK_S, Use.IDENTIFY, coupling=spring)
    quiet, stretches, after = without_ringing(readings, stretches, before)
    assert quiet.coupling.stiffness_nm_rad == pytest.approx(stiffness, abs=3.0 * quiet.coupling.stiffness_std_nm_rad)
    assert "oscillate on the torque sensor's spring" in remark_on(quiet, Truth().inertia)[0]

    def worst_error(solution):
        """In deviations that the residual gives: they hold nothing of the spring's."""
        values, covariance = physical(solution)
        return np.max(np.abs(values[:7] - truth.array()) / np.sqrt(np.diag(covariance))[:7])

    assert worst_error(before) > 10.0
    assert worst_error(after) < 5.0
    off = np.sqrt(np.diag(quiet.ringing_covariance))
    moved = np.abs(physical(after)[0] - physical(before)[0])
    # It was searched in all of so short a record: nothing else tells the amplitudes. Of one, it would be 0.58.
    assert 0.3 < np.median(off / moved) < 0.7
    result = result_of(stretches, after, command_unit="N*m", readings=replace(quiet, draws=2))
    for estimate, true, least in zip(result.estimates, truth.array(), off, strict=False):
        assert abs(estimate.value - true) < 3.0 * estimate.std
        assert estimate.std > least


@pytest.mark.long
def test_how_well_subtracted_amplitudes_are_known_is_told_by_what_is_left(brief, result_of_brief):
    """A fifth too much is subtracted of all of it: values are off by what the covariance says."""
    spring = coupling(0.985 * RESONANCE_HZ).damped(0.02, Truth().inertia)
    bench = simulation(result_of_brief, spring)
    ringing = Ringing.of(bench, spring, bench.stretches)

    def uncertain(too_much):
        less = replace(brief, torque=brief.torque.copy())
        less.torque["torque_nm"] -= too_much * ringing.of_spring(spring)
        solution = solve_again(signals(less, TICK_S, Use.IDENTIFY), bench.solution)
        parts = parts_of_ringing(ringing, spring, ringing.of_spring(spring), solution)
        covariance = left_uncertain(parts, solution, np.empty(0))
        return physical(solution)[0], np.sqrt(np.diag(covariance))

    (right, known), (wrong, off) = uncertain(0.0), uncertain(0.2)
    error = np.abs(wrong - right)
    moved = error > 3.0 * known
    assert np.any(moved)
    assert off[moved] == pytest.approx(error[moved], rel=0.3)


@pytest.mark.long
def test_a_bench_that_does_not_ring_stays_as_it_was_read(brief, result_of_brief):
    quiet, stretches, _ = found_in(brief, result_of_brief, coupling())
    assert quiet.measured is brief
    assert quiet.ringing_nm is None
    assert quiet.coupling is not None
    assert stretches[0].torque_nm is not None
    assert remark_on(quiet, Truth().inertia) == ()


@pytest.mark.parametrize("spring", [None, coupling(400.0)], ids=["not calibrated", "slower than the readings"])
def test_nothing_is_looked_for_where_nothing_can_be_aliased(experiment, result, spring):
    assert found_in(experiment, result, spring)[0].measured is experiment


@pytest.mark.long
def test_nothing_is_subtracted_where_the_loads_commands_follow_the_torque(experiment, result):
    """The same ringing, in steps of torque feedback alone."""
    measured = shaken(experiment, result, coupling().damped(0.02, Truth().inertia))
    fed_back = replace(measured, segments=tuple(replace(each, procedure="free") for each in measured.segments))
    assert found_in(fed_back, result, replace(coupling(), damping_std_nms_rad=1.0))[0].measured is fed_back


def test_no_motor_drives_the_spring_with_forty_times_its_torque():
    prior = Prior.of(coupling(), Truth().inertia)
    assert not prior.implausible(replace(coupling(), load_amplitude=2.0, motor_amplitude=0.5))
    assert prior.implausible(replace(coupling(), load_amplitude=40.0))
    assert prior.implausible(replace(coupling(), motor_amplitude=0.3))


@pytest.mark.parametrize(("highest_hz", "finer"), [(400.0, 1), (1300.0, 2), (1e5, FINEST)])
def test_a_grid_is_as_fine_as_the_spring_needs_and_no_finer_than_its_bound(highest_hz, finer):
    at_s = even_grid(2.0, 4.0, TICK_S, highest_hz)
    assert np.diff(at_s) == pytest.approx(TICK_S / FINE / finer)
    assert at_s[0] == 2.0
    assert 4.0 <= at_s[-1] < 4.2


def test_the_prior_is_the_calibration_or_what_joints_have():
    """The damping is believed where the calibration tells it better than joints do; else joints are."""
    told = replace(coupling(), damping_nms_rad=0.10, damping_std_nms_rad=0.02)
    prior = Prior.of(told, Truth().inertia)
    assert prior.centre is told
    assert prior.std[:2] == pytest.approx([0.02, 0.2])
    assert prior.cost(told.moved(np.array([0.02, 0.0, 0.0, 0.0, 0.0, 0.0]))) == pytest.approx(0.5)
    untold = Prior.of(replace(told, damping_std_nms_rad=0.5), Truth().inertia)
    assert untold.centre.damping_nms_rad == pytest.approx(told.damped(0.028, Truth().inertia).damping_nms_rad)


def test_ringing_is_what_two_inertias_on_a_spring_do(result):
    """Integrated exactly between the commands' steps, less what passes the port's low-pass; without friction."""
    bench, spring = result.simulated.bench, coupling(1300.0).damped(0.03, Truth().inertia)
    truth, inertia = bench.truths[0], abs(bench.solution.linear[1])
    fine_s = TICK_S / 32
    span_s = (truth.time_s[0] + 20.0, truth.time_s[0] + 21.0)
    time_s = np.arange(span_s[0] - 0.2, span_s[1] + 0.2, fine_s)
    driving = np.zeros(time_s.size)
    shape, stretch, gain_nm = bench.solution.shape, truth.stretch, bench.solution.linear[0]
    for acts_s, command, bandwidth, gain in (
        (stretch.sent_s + shape.command_delay_s, stretch.command, shape.bandwidth_rad_s, gain_nm / inertia),
        (spring.sent_s, spring.command_nm, 1000.0, -1.0 / LOAD_KGM2),
    ):
        held = command[np.clip(np.searchsorted(acts_s, time_s, side="right") - 1, 0, None)]
        driving += gain * signal.lfilter([1 - np.exp(-bandwidth * fine_s)], [1, -np.exp(-bandwidth * fine_s)], held)
    mobility = 1 / inertia + 1 / LOAD_KGM2
    system = signal.StateSpace(
        [[0.0, 1.0], [-spring.stiffness_nm_rad * mobility, -spring.damping_nms_rad * mobility]],
        [[0.0], [1.0]], [[spring.stiffness_nm_rad, spring.damping_nms_rad]], [[0.0]],
    )  # fmt: skip
    torque = signal.lsim(system, driving, time_s - time_s[0])[1]
    offsets = np.arange(-24 * 32, 24 * 32 + 1) / 32
    slow = np.convolve(torque, PORT.taps(offsets, 0, exact_to=3), "same")
    middle = (time_s > span_s[0] + 0.3) & (time_s < span_s[1] - 0.3)
    expected = (torque - slow)[middle]
    driving = bench.driving_within(span_s, truth, spring, np.zeros(stretch.sent_s.size))
    slips = replace(driving.contact, stiffness_nm_rad=0.0, damping_nms_rad=0.0)
    driving = replace(driving, friction=np.zeros_like(driving.friction), contact=slips)
    found = driving.ringing_at(time_s[middle], spring)
    assert np.std(found - expected) < 0.03 * np.std(expected)


def test_a_contact_that_comes_out_below_nothing_holds_nothing(result):
    """A coarse encoder may leave a presliding damping below zero: with it the spring would ring ever more."""
    bench, spring = result.simulated.bench, coupling(1300.0).damped(0.03, Truth().inertia)
    linear = bench.solution.linear.copy()
    linear[4] = -0.03
    truth = bench.truths[0]
    other = replace(bench, solution=replace(bench.solution, linear=linear)).driving(truth, spring)
    assert other.contact.damping_nms_rad == 0.0
    own = bench.driving(truth, spring).ringing_at(truth.time_s, spring)
    assert np.std(other.ringing_at(truth.time_s, spring)) < 3 * np.std(own)


@pytest.mark.parametrize("ratio", [0.01, 0.5, 1.0, 1.5])
def test_an_oscillator_is_taken_exactly_across_a_step(ratio):
    """As the exponential of its matrix does, the acceleration a line in time."""
    rings, step_s = 2 * np.pi * 900.0, 1.25e-4
    flow = np.zeros((4, 4))
    flow[0, 1], flow[1, :3], flow[2, 3] = 1.0, (-(rings**2), -2 * ratio * rings, 1.0), 1.0 / step_s
    over = linalg.expm(flow * step_s)[:2]
    exact = np.column_stack([over[:, :2], over[:, 2] - over[:, 3], over[:, 3]])
    np.testing.assert_allclose(across_step(rings**2, 2 * ratio * rings, step_s), exact, rtol=1e-9)


@pytest.mark.long
def test_a_friction_contact_holds_what_oscillates_after_a_turn():
    """Dahl's law along a slow motion and a quick one, integrated by LSODA, less what it gives along the slow one alone:
    once the shaft slides, after a turn, the contact no longer damps the oscillation."""
    step_s, s_per_rad, rings, damping = 2.5e-4, 700.0, 2 * np.pi * 900.0, 2 * 0.01 * 2 * np.pi * 900.0
    stiffness, contact_damping = 3e5, 900.0  # over the mass
    time_s = np.arange(0.0, 0.4, step_s)
    push = 1e-3 * np.random.default_rng(1).standard_normal(time_s.size)

    def sliding(velocity, h):
        return velocity * s_per_rad * (1.0 - h * np.sign(velocity))

    def slow(t):
        return 0.02 * 2 * np.pi * 5.0 * np.cos(2 * np.pi * 5.0 * t)

    def rates(t, state):
        place, speed, h, slow_h = state
        with_quick, alone = sliding(slow(t) + speed, h), sliding(slow(t), slow_h)
        held = (stiffness * (h - slow_h) + contact_damping * (with_quick - alone)) / s_per_rad
        pushed = np.interp(t, time_s, push) - held
        return speed, pushed - damping * speed - rings**2 * place, with_quick, alone

    exact = integrate.solve_ivp(
        rates, (0.0, time_s[-1]), np.zeros(4), "LSODA", time_s, rtol=1e-8, atol=1e-15, max_step=step_s / 4
    ).y
    sticking, slip = 1.0 - exact[3] * np.sign(slow(time_s)), s_per_rad * np.abs(slow(time_s))
    across = across_step(rings**2, damping, step_s / SUBSTEPS)

    def error(of_contact):
        contact = Contact(sticking, slip, *of_contact).within(0.5 * step_s / SUBSTEPS, 1.0)
        found = oscillator_with_contact(push, across, contact, SUBSTEPS)
        return np.std(found[0] - exact[0]) / np.std(exact[0])

    assert error((stiffness, contact_damping)) < 0.03
    assert error((0.0, 0.0)) > 0.3


@pytest.mark.long
def test_live_values_are_not_biased_by_ringing_either():
    """Of a calibration and imposed motion, on a spring that oscillates at 1200 Hz."""
    bench = Bench(stiffness=(2 * np.pi * 1200.0) ** 2 / MOBILITY, damping=0.01, noise_nm=3e-4)
    random, truth = np.random.default_rng([3, 5]), Truth()
    top_nm = 6 * (bench.load.coulomb_torque + truth.coulomb_torque)
    own, load_nm = (share * top_nm * synthetic.multisine(random, 8.0, 0.5, 200, -0.25) for share in (0.55, 1.0))
    plan = synthetic.Plan().add("calibrate", "rest", Use.PREPARE, np.zeros(300), synthetic.PUSHED)
    plan.add("calibrate", "shake", Use.CALIBRATE, own, synthetic.PUSHED, load_nm)
    plan.add("calibrate", "rest", Use.PREPARE, np.zeros(300), synthetic.PUSHED)
    measured = synthetic.run(synthetic.imposed_parts(plan, truth, random, 10.0), truth, bench, 3)
    # Two fits with simulated records, and a last one that what these told of the ringing corrects.
    for estimate in feed(LiveIdentifier("N*m", TICK_S), measured, 12.0)[-1].estimates:
        assert abs(estimate.value - getattr(truth, estimate.name)) < 4.0 * estimate.std, estimate
