"""The controller's parts, each against something that is not ours."""

from dataclasses import replace
from math import exp

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from norton_bench.arrays import FloatArray
from norton_bench.control import core
from norton_bench.control.admittance import FeedForward, VirtualBody, between, continued
from norton_bench.control.design import TorqueGains, nominal_bench
from norton_bench.control.preview import (
    LONGEST_STEP_S,
    delayed,
    expected_error_nm,
    foreseeing,
    in_phase,
    mending_rad_s,
    trusted,
    with_preview,
)
from norton_bench.control.regulator import COMMAND, look_back, sampled
from norton_bench.control.torque_loop import TorqueLoop, settles_s
from norton_bench.errors import ExperimentError
from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import NetworkTerm
from norton_bench.sample import Target
from norton_bench.segments import PRESCRIBED_MOTION, Admittance, LoadMode, Segment, Use
from tests.bench.control.plant import PlantSettings
from tests.bench.control.runs import network_of

TICK_S = 1e-3
SETTINGS = PlantSettings()
CALIBRATION = SETTINGS.calibration()


@given(st.floats(-0.008, 0.008), st.floats(-0.02, 0.02), st.floats(1.0, 50.0))
def test_the_contact_slides_as_dahl_has_it(force: float, displacement: float, stiffness: float) -> None:
    coulomb = 0.008
    slid = core.slide(force, displacement, coulomb, stiffness)
    sign = np.sign(displacement)
    flow = solve_ivp(
        lambda _x, f: stiffness * (1 - sign * f / coulomb) * sign,
        (0, abs(displacement)),
        [force],
        rtol=1e-9,
        atol=1e-12,
    )
    assert slid == pytest.approx(flow.y[0, -1], abs=1e-8)
    assert abs(slid) <= coulomb * (1 + 1e-12)


@pytest.mark.long
@given(st.floats(-0.008, 0.008), st.floats(-3.0, 3.0), st.floats(1.0, 200.0), st.floats(0.0, 0.2))
def test_friction_over_a_tick_is_its_mean_and_bounded(
    force: float, velocity: float, stiffness: float, damper: float
) -> None:
    viscous, coulomb = 1e-3, 0.008
    law = np.array([viscous, coulomb, stiffness, damper])
    mean = core.friction_over(force, velocity, TICK_S, law)

    def rates(_t: float, state: FloatArray) -> list[float]:
        slip = velocity - abs(velocity) * state[0] / coulomb
        return [stiffness * slip, (state[0] + damper * slip + viscous * velocity) / TICK_S]

    flow = solve_ivp(rates, (0, TICK_S), [force, 0.0], method="Radau", rtol=1e-9, atol=1e-12)
    assert mean == pytest.approx(flow.y[1, -1], rel=1e-6, abs=1e-8)
    built_up = damper / stiffness * 2 * coulomb / TICK_S  # all that the contact can change by
    assert abs(mean - viscous * velocity) <= coulomb + built_up + 1e-12


@pytest.mark.long
@given(st.floats(0.0, 2.5e-3), st.floats(0.05, 0.95))
def test_the_sampled_bench_is_the_continuous_one(delay_s: float, share: float) -> None:
    """A command changes once, on its way for ``delay_s``; the state within a later tick against scipy."""
    a, b = replace(nominal_bench(CALIBRATION, TICK_S), damping_nms_rad=0.05).matrices()
    model = sampled(a, b, TICK_S, delay_s)
    commands = [0.0] * (model.whole + 1) + [0.1, 0.1, -0.05, -0.05]
    state = np.zeros(5)
    ticks = 3
    for tick in range(ticks):
        before, now = commands[tick], commands[tick + 1]
        state = model.flow(TICK_S) @ np.concatenate([state, [before, now, 0.0, 0.0]])
    inputs = [commands[ticks], commands[ticks + 1], 0.0, 0.0]
    state = model.flow(share * TICK_S) @ np.concatenate([state, inputs])

    # From arrival to arrival, so that the solver never steps over a change.
    exact, now_s, end_s = np.zeros(5), 0.0, (ticks + share) * TICK_S
    for sent, command in enumerate(commands):
        until_s = min(sent * TICK_S + model.fraction_s, end_s)
        if until_s > now_s:
            push = b[:, COMMAND] * command
            flow = solve_ivp(lambda _t, x, push=push: a @ x + push, (now_s, until_s), exact, rtol=1e-9, atol=1e-14)
            exact, now_s = flow.y[:, -1], until_s
    assert state == pytest.approx(exact, rel=1e-5, abs=1e-9)


@given(st.floats(0.0, 4e-3))
def test_looking_back_finds_the_instant(delay_s: float) -> None:
    back, after_s = look_back(delay_s, TICK_S)
    assert back >= 1
    assert -1e-9 <= after_s <= TICK_S
    assert back * TICK_S - after_s == pytest.approx(delay_s, abs=1e-11)


@given(st.floats(200.0, 2000.0), st.floats(0.0, 0.99), st.integers(0, 2), st.integers(1, 10**6))
def test_feed_forward_makes_the_amplifier_deliver(bandwidth: float, share: float, whole: int, seed: int) -> None:
    """A lagging amplifier, fed what was asked for, has the wanted torque whenever the next command arrives."""
    feed = FeedForward(0.9, bandwidth, TICK_S, share * TICK_S, whole, limit_nm=1e6)
    wanted = np.cumsum(np.random.default_rng(seed).normal(0, 0.01, 40))
    core.begin_feed(feed.shares, feed.delivered, feed.lag, 0.0)
    delivered = 0.0
    for torque_nm in wanted:
        core.ask(feed.shares, feed.delivered, feed.lag, torque_nm)
        delivered += (1 - exp(-bandwidth * TICK_S)) * (0.9 * feed.shares[0] - delivered)
        assert delivered == pytest.approx(torque_nm, abs=1e-9)
        feed.advance()


def test_a_virtual_body_answers_a_step_as_in_the_textbook() -> None:
    law = Admittance(mass_kgm2=2e-4, damping_nms_rad=2e-3, stiffness_nm_rad=0.1)
    body = VirtualBody(law, 1e-5)
    body.begin(0.0, 0.0)
    positions = np.array([body.step(0.02, Target()).position_rad for _ in range(20_000)])
    omega, zeta = np.sqrt(0.1 / 2e-4), 2e-3 / (2 * np.sqrt(0.1 * 2e-4))
    t = 1e-5 * np.arange(1, 20_001)
    damped = omega * np.sqrt(1 - zeta**2)
    closed = 0.2 * (1 - np.exp(-zeta * omega * t) * (np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t)))
    assert np.max(np.abs(positions - closed)) < 2e-4


@given(st.floats(0, 1e4), st.floats(0, 1e5))
def test_a_virtual_body_is_stable_however_stiff(damping: float, stiffness: float) -> None:
    body = VirtualBody(Admittance(1e-4, damping, stiffness), TICK_S)
    body.begin(1.0, 0.0)
    assert max(abs(body.step(0.0, Target()).position_rad) for _ in range(200)) <= 1.0 + 1e-9


def test_a_body_becomes_another_one_without_a_jump() -> None:
    """It goes on where it is; a spring that it gets is drawn tight within GLIDE_S."""
    before, after = Admittance(5e-4, 2e-2), Admittance(1e-3, 3e-2, 1.0)
    body = VirtualBody(before, TICK_S)
    body.begin(0.1, 2.0)
    first = body.step(0.05, Target())
    body.become(after)
    body.become(after)
    moves = [body.step(0.05, Target()) for _ in range(3000)]
    accelerations = np.array([move.acceleration_rad_s2 for move in (first, *moves)])
    # A law that changed at once would change it by 0.1 N m / 1e-3 kg m².
    assert np.max(np.abs(np.diff(accelerations))) < 0.02 * 100.0
    velocities = np.array([move.velocity_rad_s for move in (first, *moves)])
    assert np.diff(velocities) == pytest.approx(TICK_S * accelerations[1:])
    alone = VirtualBody(after, TICK_S)
    alone.begin(moves[499].position_rad, moves[499].velocity_rad_s)
    assert moves[-1].position_rad == pytest.approx([alone.step(0.05, Target()).position_rad for _ in range(2500)][-1])


@pytest.mark.parametrize(
    ("wall_rad", "turned_rad", "deflected_rad"),
    [(0.1, 0.3, 0.2), (0.1, 0.1, 0.0), (0.1, -0.3, 0.0), (-0.1, -0.3, -0.2), (-0.1, 0.3, 0.0), (0.0, 0.3, 0.3)],
)
def test_a_wall_is_on_one_side(wall_rad: float, turned_rad: float, deflected_rad: float) -> None:
    law = Admittance(stiffness_nm_rad=1.0, wall_rad=wall_rad)
    assert law.deflection_rad(turned_rad) == pytest.approx(deflected_rad)
    assert law.deflection_rad(np.array([turned_rad, wall_rad])) == pytest.approx([deflected_rad, 0.0])


@pytest.mark.parametrize(
    ("law", "why"),
    [
        (Admittance(5e-4, 2e-2, 2.0, wall_rad=-0.1), ""),
        (PRESCRIBED_MOTION, ""),
        (Admittance(5e-4, 2e-2, float("inf")), "finite numbers"),
        (Admittance(5e-4, 2e-2, 2.0, wall_rad=float("nan")), "finite numbers"),
        (Admittance(5e-4, -2e-2), "no negative mass"),
        (Admittance(5e-4, 2e-2, wall_rad=0.1), "a wall needs a stiffness"),
    ],
)
def test_what_is_no_law_says_why(law: Admittance, why: str) -> None:
    assert why in law.shortcoming
    assert bool(why) == bool(law.shortcoming)


def test_half_way_between_two_laws_is_half_of_both() -> None:
    law = between(Admittance(1e-3, 0.0, 2.0), Admittance(3e-3, 0.1), 0.5)
    assert law.values == pytest.approx((2e-3, 0.05, 1.0))


def test_the_torque_loop_is_bold_only_once_the_shaft_has_slid() -> None:
    loop = TorqueLoop(TorqueGains(0.0, 100.0, 3.0, 0.0), TICK_S, turn_rad=0.01, play_rad=1e-4)
    loop.begin(0.0, 0.0, 0.0)
    loop._torque_nm = 0.01
    at_rest = loop.change_nm(0.01, 0.0, 0.0, bold=True)
    sliding = loop.change_nm(0.01, 1.0, 0.0, bold=True)
    foreseen = loop.change_nm(0.01, 1.0, 0.0, bold=False)
    noise = loop.change_nm(0.01, 1.0 - 5e-5, 0.0, bold=True)
    turned = loop.change_nm(0.01, 1.0 - 2e-4, 0.0, bold=True)
    assert (at_rest, sliding, foreseen) == pytest.approx((1e-3, 3e-3, 1e-3))
    assert noise == pytest.approx(3e-3)
    assert turned == pytest.approx(1e-3, rel=0.05)


def test_the_torque_loop_takes_over_a_turning_shaft_without_a_bump() -> None:
    loop = TorqueLoop(TorqueGains(0.0, 0.0, 1.0, 0.02), TICK_S, turn_rad=0.01, play_rad=1e-4)
    loop.begin(0.0, 7.0, 48.0)
    changes_nm = [loop.change_nm(0.0, 7.0 + 48.0 * TICK_S * tick, 48.0, bold=True) for tick in range(1, 20)]
    assert max(np.abs(changes_nm)) < 1e-9


def test_the_torque_loop_damps_only_what_sticks() -> None:
    loop = TorqueLoop(TorqueGains(0.0, 0.0, 1.0, 0.02), TICK_S, turn_rad=0.01, play_rad=1e-4)
    loop.begin(0.0, 0.0, 0.0)
    assert loop.change_nm(0.0, 0.0, 1.0, bold=True) == pytest.approx(-0.02)
    assert loop.change_nm(0.0, 1.0, 1.0, bold=True) == pytest.approx(0.02, abs=1e-9)


def test_an_unknown_future_goes_on_along_its_slope() -> None:
    before, now = Target(0.0, 0.0, 10.0), Target(0.0, 1.0, 12.0)
    ahead = continued(now, before, 2, TICK_S)
    assert ahead.acceleration_rad_s2 == pytest.approx(16.0)
    assert ahead.velocity_rad_s == pytest.approx(1.0 + 2e-3 * 14.0)


def test_preview_is_the_free_motion_when_the_command_takes_effect() -> None:
    network = network_of(SETTINGS, 0.0)
    command = 0.2 * np.sin(0.03 * np.arange(500))
    segment = Segment("free", "sine", Use.IDENTIFY, command, LoadMode.ADMITTANCE)
    seen = with_preview(segment, network, CALIBRATION, 2e-3, TICK_S)
    velocity = network.free_motion(command, TICK_S, longest_step_s=LONGEST_STEP_S)[1]
    assert seen.velocity_rad_s[2:] == pytest.approx(velocity[:-2])
    assert seen.preview


def test_preview_of_a_shaft_in_steady_motion_begins_without_a_jerk() -> None:
    network = network_of(SETTINGS, 0.0)
    velocity = float(network.source_velocity(0.1))
    segment = Segment("free", "goes on", Use.IDENTIFY, np.full(50, 0.1), LoadMode.ADMITTANCE)
    seen = with_preview(segment, network, CALIBRATION, 0.0, TICK_S, velocity_rad_s=velocity, command=0.1)
    assert seen.velocity_rad_s == pytest.approx(np.full(50, velocity))
    assert seen.acceleration_rad_s2 == pytest.approx(np.zeros(50), abs=1e-3 * velocity / TICK_S)


COGGING = NetworkTerm("cogging", (0.004, 0.003), 8)


def test_preview_begins_where_the_shaft_stands() -> None:
    """Cogging at the true place; the reference is relative to the start, and the start does not move by itself."""
    network = replace(network_of(SETTINGS, 0.0), terms=(COGGING, NetworkTerm("stribeck", (0.005, 2.0))))
    command = 0.04 * np.sin(0.05 * np.arange(300))
    segment = Segment("free", "sine", Use.IDENTIFY, command, LoadMode.ADMITTANCE)
    held_nm = COGGING.values[0] * np.cos(8 * 1.3) + COGGING.values[1] * np.sin(8 * 1.3)
    seen = with_preview(segment, network, CALIBRATION, 0.0, TICK_S, position_rad=1.3)
    options = {"longest_step_s": LONGEST_STEP_S, "friction_torque_nm": held_nm}
    position, velocity, _ = network.free_motion(command, TICK_S, position_rad=1.3, **options)
    assert seen.position_rad == pytest.approx(position - 1.3)
    assert seen.velocity_rad_s == pytest.approx(velocity)
    elsewhere = with_preview(segment, network, CALIBRATION, 0.0, TICK_S, position_rad=0.0)
    assert np.abs(elsewhere.velocity_rad_s - velocity).max() > 0.05 * np.abs(velocity).max()
    still = Segment("free", "rests", Use.IDENTIFY, np.zeros(100), LoadMode.ADMITTANCE)
    rests = with_preview(still, network, CALIBRATION, 0.0, TICK_S, position_rad=1.3)
    assert np.abs(rests.velocity_rad_s).max() == pytest.approx(0.0, abs=1e-6)


def test_preview_leaves_out_what_its_drift_would_have_at_the_wrong_place() -> None:
    """1 % of the travel, times 8 periods a turn, is beyond π/3 from 13.1 rad on."""
    network = replace(network_of(SETTINGS, 0.0), terms=(COGGING, NetworkTerm("asymmetry", (0.1,))))
    assert in_phase(network, 13.0) == network
    assert [term.name for term in in_phase(network, 13.2).terms] == ["asymmetry"]


@pytest.mark.parametrize(
    "segment",
    [
        Segment("free", "coast", Use.IDENTIFY, np.zeros(3)),
        Segment("imposed", "grid", Use.IDENTIFY, np.zeros(3), LoadMode.ADMITTANCE, PRESCRIBED_MOTION),
    ],
)
def test_preview_leaves_other_segments_alone(segment: Segment) -> None:
    assert with_preview(segment, network_of(SETTINGS, 0.0), CALIBRATION, 0.0, TICK_S) is segment


def test_a_delay_of_part_of_a_tick_is_interpolated() -> None:
    assert delayed(np.array([0.0, 1.0, 2.0]), TICK_S, 0.5e-3) == pytest.approx([0.0, 0.5, 1.5])


@pytest.mark.parametrize(
    ("field", "value", "word"),
    [
        ("inertia_kgm2", 0.0, "inertia_kgm2 is 0"),
        ("torque_noise_nm", float("nan"), "is nan"),
        ("torque_gain", -0.9, "direction"),
    ],
)
def test_an_impossible_calibration_is_refused(field: str, value: float, word: str) -> None:
    with pytest.raises(ExperimentError, match=word):
        replace(CALIBRATION, **{field: value})


def test_only_relative_delays_matter() -> None:
    """Counted from the torque reading, or as they are: the same once in the controller's frame, but for the origin."""
    counted = replace(CALIBRATION, command_delay_s=6.5e-4, measurement_delay_s=0.0, motion_delay_s=-1.5e-4)
    assert counted.position_delay_s == pytest.approx(0.0)
    assert counted.torque_delay_s - counted.position_delay_s == pytest.approx(1.5e-4)
    assert counted.drive_delay_s + counted.torque_delay_s == pytest.approx(6.5e-4)


def dated(arrived_s: FloatArray, counts: FloatArray | None = None) -> FloatArray:
    """When each reading would have arrived without jitter; NaN where that is not known."""
    clock = np.array([0.0, TICK_S, 0.0, 0.0, 0.0])
    counts = np.ones(len(arrived_s)) if counts is None else counts
    known = zip(arrived_s, counts, strict=True)
    return np.array([clock[0] if core.steady_arrival(clock, at, count) else np.nan for at, count in known])


@pytest.mark.long
@given(st.integers(0, 1000), st.floats(0.9e-3, 1.1e-3), st.lists(st.integers(300, 1900), max_size=20, unique=True))
def test_a_steady_device_is_dated_without_its_jitter(seed: int, period_s: float, lost: list[int]) -> None:
    """Against the instants themselves; what is lost leaves a gap, and a late burst does not bend the clock."""
    taken_s = np.delete(0.3 + period_s * np.arange(2000), lost)
    arrived_s = taken_s + np.random.default_rng(seed).uniform(-5e-5, 5e-5, taken_s.size)
    # Of n readings 2 sigma/sqrt(n) remains: 29 µs become 4 µs, and five deviations of that are rare.
    dated_s = dated(arrived_s)
    assert np.nanmax(np.abs(dated_s - taken_s)[200:]) < 2.1e-5
    assert np.count_nonzero(np.isnan(dated_s)) <= len(lost), "of each gap one reading at most is not placed"


@given(st.integers(0, 1000), st.floats(0.1, 0.9), st.lists(st.integers(300, 1800), min_size=1, max_size=20))
def test_what_is_held_up_on_its_way_does_not_bend_the_clock(seed: int, late: float, held_up: list[int]) -> None:
    """A computer that stands still for three periods finds them all at once, and the last of them late as well."""
    taken_s = 0.3 + 1e-3 * np.arange(2000)
    arrived_s, counts = taken_s + np.random.default_rng(seed).uniform(0, 1e-4, taken_s.size), np.ones(taken_s.size)
    seen = np.ones(taken_s.size, bool)
    for at in held_up:
        if seen[at - 3 : at + 1].all() and np.all(counts[at - 3 : at + 1] == 1):
            seen[at - 3 : at], counts[at] = False, 4
            arrived_s[at] = taken_s[at] + 1e-3 * late
    # Half a period may pass for jitter, and a tenth of that stays at most.
    wrong_s = np.abs(dated(arrived_s[seen], counts[seen]) - taken_s[seen] - 5e-5)[200:]
    assert np.nanmax(wrong_s) < 1e-4


@given(st.integers(0, 1000), st.floats(2.0, 60.0), st.integers(1, 30))
def test_what_a_stalled_bus_hands_over_late_is_never_taken_for_new(seed: int, stalled_ms: float, at_first: int) -> None:
    """A part of it at one tick, the rest at the next, and nothing in either says how old it is."""
    taken_s, until = 0.3 + 1e-3 * np.arange(1000), 501 + int(stalled_ms)
    first = min(499 + at_first, until - 1)
    last = np.concatenate([np.arange(500), [first, until], np.arange(until + 1, 1000)])
    arrived_s = taken_s[last] + np.random.default_rng(seed).uniform(-5e-5, 5e-5, last.size)
    arrived_s[500] = taken_s[500] + 1e-3 * stalled_ms
    assert np.nanmax(np.abs(dated(arrived_s, np.diff(last, prepend=-1)) - taken_s[last])[200:]) < 1e-4


def test_a_clock_that_lost_its_device_begins_anew() -> None:
    returned_s = 0.4992 + 1.0007 + 1e-3 * np.arange(500)
    dated_s = dated(np.concatenate([1e-3 * np.arange(500), returned_s]))[500:]
    assert np.isnan(dated_s[0])
    assert dated_s[1:] == pytest.approx(returned_s[1:], abs=2e-5)


GAINS = TorqueGains(0.3, 300.0, 1.0, 0.01)


def slow_loop(rate_rad_s: float) -> TorqueLoop:
    whole_s = settles_s(GAINS, CALIBRATION)
    return TorqueLoop(GAINS, TICK_S, turn_rad=0.01, play_rad=1e-4, slow=rate_rad_s * whole_s, settles_s=whole_s)


def test_slow_feedback_takes_a_standing_torque_away_at_its_rate_and_lets_less_noise_in() -> None:
    """A shaft that has slid and then stands: the port sees the whole command. Noise makes the torque wander by
    σ √(ω T / 2)."""
    rate_rad_s, noise_nm, random = 10.0, 1e-3, np.random.default_rng(2)
    loop = slow_loop(rate_rad_s)
    loop.begin(0.0, 0.0, 0.0)
    for _ in range(200):
        loop.change_nm(0.0, 1.0, 0.0, bold=False)
    command, torque = 0.0, []
    for noise in random.normal(0.0, noise_nm, 20_000):
        torque.append(0.01 - CALIBRATION.torque_gain * command)
        command += loop.change_nm(torque[-1] + noise, 1.0, 0.0, bold=False)
    assert torque[100] == pytest.approx(0.01 * np.exp(-1.0), abs=1e-3)
    # So many times the memory of 0.1 s that the deviation is known to a tenth or so.
    wander_nm = noise_nm * np.sqrt(0.5 * rate_rad_s * TICK_S)
    assert np.std(torque[1000:]) == pytest.approx(wander_nm, rel=0.3)
    assert abs(np.mean(torque[1000:])) < 4 * noise_nm / np.sqrt(19_000)


def test_slow_feedback_is_as_quick_as_designed_until_the_contacts_have_slid_and_then_averages() -> None:
    slow, quick = slow_loop(1.0), TorqueLoop(GAINS, TICK_S, turn_rad=0.01, play_rad=1e-4)
    for loop in (slow, quick):
        loop.begin(0.0, 0.0, 0.0)
        for _ in range(100):
            first = loop.change_nm(1e-3, 0.0, 0.0, bold=False)
        assert first == pytest.approx(GAINS.integral_per_s * TICK_S * 1e-3)
    for _ in range(100):
        standing = slow.change_nm(1e-3, 1.0, 0.0, bold=False) / (TICK_S * 1e-3 * CALIBRATION.torque_gain**-1)
    whole_s = settles_s(GAINS, CALIBRATION)
    assert standing == pytest.approx(1 / (whole_s + 0.1), rel=1e-3)


def test_the_more_noise_the_slower_what_is_foreseen_is_mended() -> None:
    error_nm = 2e-4 * np.sign(np.sin(10 * TICK_S * np.arange(4000)))
    quiet, usual, noisy = (mending_rad_s(error_nm, noise_nm, TICK_S) for noise_nm in (0.1e-3, 1e-3, 10e-3))
    assert quiet > 2 * usual > 4 * noisy


def test_a_standing_error_is_gone_from_the_mean_of_a_segment_however_short() -> None:
    """What decays within the segment leaves no more in its mean than the noise of its readings would hide."""
    standing_nm, lasts_s = 2e-4, 0.4
    rate_rad_s = mending_rad_s(np.full(400, standing_nm), 1e-3, TICK_S)
    mean_nm = standing_nm * (1 - np.exp(-rate_rad_s * lasts_s)) / (rate_rad_s * lasts_s)
    assert mean_nm <= 1e-3 / np.sqrt(400)


def test_the_error_expected_of_a_preview_is_what_the_networks_miss_of_their_own_equations() -> None:
    """Against networks drawn from their covariances, along a motion that slides."""
    velocity, acceleration = np.array([20.0, -5.0, 30.0]), np.array([100.0, -300.0, 0.0])
    load, random = CALIBRATION.network, np.random.default_rng(4)
    known = np.array([0.9, 5e-5, 1e-3, 0.02])
    needed = known[1] * acceleration + known[2] * velocity + known[3] * np.sign(velocity)
    drawn = known * (1 + 0.005 * random.standard_normal((4000, 4)))
    missed = drawn[:, :1] / known[0] * needed - (
        drawn[:, 1:2] * acceleration + drawn[:, 2:3] * velocity + drawn[:, 3:] * np.sign(velocity)
    )
    expected = expected_error_nm(SURE, load, velocity, acceleration)
    np.testing.assert_allclose(np.abs(expected), missed.std(axis=0), rtol=5 / np.sqrt(2 * 4000))
    assert np.all(np.sign(expected) == np.sign(velocity))


NETWORK = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, command_unit="N*m")


def known_to(*shares: float) -> NortonNetwork:
    """With these relative deviations of gain, inertia, damping and friction."""
    names = ("torque_gain", "inertia", "viscous_damping", "coulomb_torque")
    rows = np.diag((np.array([0.9, 5e-5, 1e-3, 0.02]) * np.array(shares)) ** 2).tolist()
    return replace(NETWORK, covariance_names=names, covariance=tuple(map(tuple, rows)))


SURE, UNSURE = known_to(0.005, 0.005, 0.005, 0.005), known_to(0.005, 0.005, 0.02, 0.005)


def test_a_network_is_trusted_by_its_own_deviations() -> None:
    assert trusted(SURE)
    assert not trusted(UNSURE)
    assert not trusted(NETWORK)


@pytest.mark.parametrize(
    ("first", "live", "knows_friction", "expected"),
    [
        (SURE, None, True, SURE),
        (SURE, UNSURE, False, SURE),
        (UNSURE, SURE, True, SURE),
        (UNSURE, NETWORK, False, NETWORK),
        (UNSURE, NETWORK, True, None),
        (UNSURE, None, False, None),
    ],
)
def test_a_motion_is_foreseen_by_what_is_trusted_or_else_by_the_best_there_is(
    first: NortonNetwork, live: NortonNetwork | None, knows_friction: bool, expected: NortonNetwork | None
) -> None:
    assert foreseeing(first, live, knows_friction=knows_friction) == expected


def test_a_shaft_at_rest_is_foreseen_to_stay_there_although_its_contact_was_fitted_without_damping() -> None:
    """Fitted behind a coarse encoder, a presliding damping came out at seven times its value, and negative."""
    fitted = replace(SURE, presliding_damping_nms_rad=-7.0 * SURE.presliding_damping_nms_rad)
    barely = np.full(200, 0.05 * fitted.coulomb_torque_nm / fitted.torque_gain)
    assert not np.max(np.abs(fitted.free_motion(barely, 1e-3)[1])) < 1.0
    foreseen = foreseeing(fitted, None, knows_friction=True)
    assert foreseen is not None
    assert np.max(np.abs(foreseen.free_motion(barely, 1e-3)[1])) < 0.1
