"""Every derived figure against the motor simulated for what it says, by scipy: never its own formula."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from math import exp, log, pi, sin, sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from norton_bench.models.derived import DERIVED, Figure, OperatingPoint, derived, interval_of
from norton_bench.models.drawn_motor import DRAWS, drawn_networks
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import PredictionError, Status
from norton_bench.models.terms import NetworkTerm

KM_KA, BETA, IM, B, TAU_C, SIGMA_0, SIGMA_1 = 0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01
NAMES = (
    "torque_gain",
    "amplifier_bandwidth",
    "inertia",
    "viscous_damping",
    "coulomb_torque",
    "presliding_stiffness",
    "presliding_damping",
)
VALUES = (KM_KA, BETA, IM, B, TAU_C, SIGMA_0, SIGMA_1)
COMMAND, VELOCITY = 0.08, 40.0
POINT = OperatingPoint("here", COMMAND, VELOCITY)
SEEN = PredictionError(1e-4, 0.1, 0.95, {"command": (-0.1, 0.1), "velocity": (-50.0, 50.0)})


def network(relative: float = 0.01, **changed: float) -> NortonNetwork:
    """With independent deviations of that share of each value."""
    values = dict(zip(NAMES, VALUES, strict=True)) | changed
    covariance = np.diag([(relative * value) ** 2 for value in values.values()])
    rows = tuple(map(tuple, covariance.tolist()))
    return NortonNetwork.of_parameters(values, "N*m", covariance_names=NAMES, covariance=rows, prediction=SEEN)


def uncertain_damping(relative: float) -> NortonNetwork:
    """All else is known."""
    variances = np.zeros((7, 7))
    variances[3, 3] = (relative * B) ** 2
    return replace(network(), covariance=tuple(map(tuple, variances.tolist())))


def figure(name: str, of: NortonNetwork | None = None) -> Figure:
    return next(each for each in derived(of or network(), (POINT,)) if each.row.name == name)


def friction(velocity: float | np.ndarray, phi: float | np.ndarray) -> tuple:
    """Dahl's torque and the rate of its state (paper, section IV.D), written here once more."""
    rate = velocity - SIGMA_0 / TAU_C * abs(velocity) * phi
    return SIGMA_0 * phi + SIGMA_1 * rate, rate


def integrated(rates: Callable[[float, np.ndarray], list[float]], start: list[float], end_s: float, **more):
    return solve_ivp(rates, (0.0, end_s), start, method="LSODA", rtol=1e-10, atol=1e-13, **more)


def free(end_s: float, command: Callable[[float], float], port_nm: Callable[[float], float], **more):
    """States: motor torque, deflection, velocity, position; what the shaft exerts on its load is given."""
    speed = more.pop("speed", 0.0)

    def rates(t: float, state: np.ndarray) -> list[float]:
        motor, phi, velocity, _ = state
        held, rate = friction(velocity, phi)
        return [BETA * (KM_KA * command(t) - motor), rate, (motor - port_nm(t) - held - B * velocity) / IM, velocity]

    return integrated(rates, [KM_KA * command(0.0), 0.0, speed, 0.0], end_s, **more)


def imposed(command: float, velocity: Callable[[float], float], rate: Callable[[float], float], times: np.ndarray):
    """Torque at the port under a motion that is imposed, at those times; and the motor's own."""

    def rates(t: float, state: np.ndarray) -> list[float]:
        return [BETA * (KM_KA * command - state[0]), friction(velocity(t), state[1])[1]]

    found = integrated(rates, [0.0, 0.0], float(times[-1]), t_eval=times, max_step=float(times[-1]) / 200)
    held = np.array([friction(velocity(t), phi)[0] for t, phi in zip(times, found.y[1], strict=True)])
    moving = np.array([B * velocity(t) + IM * rate(t) for t in times])
    return found.y[0] - held - moving, found.y[0]


def steady(command: float, velocity_rad_s: float) -> tuple[float, float]:
    """Torque at the port, and the motor's own, once everything has settled."""
    torque, motor = imposed(
        command, lambda _: velocity_rad_s, lambda _: 0.0, np.array([0.0, 0.5 + 1.0 / abs(velocity_rad_s)])
    )
    return float(torque[-1]), float(motor[-1])


def stalled() -> float:
    """The shaft comes to rest from a driven velocity, ever more slowly."""
    torque, _ = imposed(
        COMMAND, lambda t: 5.0 * exp(-t / 0.05), lambda t: -100.0 * exp(-t / 0.05), np.linspace(0, 1.0, 50)
    )
    return float(torque[-1])


def no_load(command: float = COMMAND) -> float:
    return float(free(1.0, lambda _: command, lambda _: 0.0).y[2, -1])


@cache
def strongest() -> tuple[float, float]:
    """Power and efficiency at the velocity of greatest power, looked for among many."""
    velocity = np.linspace(2.0, VELOCITY, 39)

    def rates(_: float, state: np.ndarray) -> np.ndarray:
        return np.array([BETA * (KM_KA * COMMAND - state[0]), *friction(velocity, state[1:])[1]])

    motor, *phi = integrated(rates, [0.0] * 40, 1.0).y[:, -1]
    torque = motor - friction(velocity, np.array(phi))[0] - B * velocity
    best = np.argmax(torque * velocity)
    return float(torque[best] * velocity[best]), float(torque[best] / motor)


@cache
def sliding_free() -> tuple[float, float]:
    """Acceleration where sliding starts and time constant, from how acceleration falls with velocity."""
    found = free(0.2, lambda _: COMMAND, lambda _: 0.0, t_eval=np.linspace(0.03, 0.2, 800))
    velocity = found.y[2]
    acceleration = np.gradient(velocity, found.t)[2:-2]
    slope, start = np.polyfit(velocity[2:-2], acceleration, 1)
    return float(start), float(-1.0 / slope)


def breaking(by_command: bool) -> float:
    """A slow ramp of command or of torque at the port, until the shaft runs."""
    level = 1.3 * TAU_C / (KM_KA if by_command else 1.0)

    def ramp(t: float) -> float:
        return level * t / 20.0

    def runs(t: float, state: np.ndarray) -> float:
        return abs(state[2]) - 0.05

    runs.terminal = True  # type: ignore[attr-defined]
    none = lambda _: 0.0  # noqa: E731
    found = free(20.0, ramp if by_command else none, none if by_command else lambda t: -ramp(t), events=runs)
    return ramp(float(found.t[-1]))


def slow_loop() -> tuple[np.ndarray, np.ndarray]:
    """Position and torque of a port that is moved slowly to and fro, without a command."""
    reach, rate = 0.03, 2 * pi * 0.05
    times = np.linspace(20.0, 40.0, 4001)
    torque, _ = imposed(
        0.0, lambda t: reach * rate * np.cos(rate * t), lambda t: -reach * rate**2 * sin(rate * t), times
    )
    return reach * np.sin(rate * times), torque


def hysteresis() -> float:
    position, torque = slow_loop()
    middle = np.abs(position) < 1e-3
    falling = np.gradient(position) < 0.0
    return float(np.mean(torque[middle & falling]) - np.mean(torque[middle & ~falling]))


def presliding() -> float:
    """Where a first push has built up 1 − 1/e of what it ends at."""
    times = np.linspace(0.0, 20.0, 8001)
    torque, _ = imposed(0.0, lambda _: 1e-3, lambda _: 0.0, times)
    built = -(torque + B * 1e-3) / TAU_C - SIGMA_1 * 1e-3 / TAU_C * np.exp(-SIGMA_0 / TAU_C * 1e-3 * times)
    return float(1e-3 * np.interp(1.0 - exp(-1.0), built, times))


def lost_motion() -> float:
    """The port's torque goes slowly up and down; where the position is when it passes zero."""
    rate = 2 * pi / 20.0
    times = np.linspace(20.0, 40.0, 4001)
    found = free(40.0, lambda _: 0.0, lambda t: 0.5 * TAU_C * sin(rate * t), t_eval=times, max_step=0.1)
    torque, position = np.sin(rate * times), found.y[3]
    up = np.interp(0.0, torque[:1000], position[:1000])
    down = np.interp(0.0, -torque[1000:3000], position[1000:3000])
    return float(abs(up - down))


@cache
def contact() -> tuple[float, float]:
    """Natural frequency [Hz] and damping ratio of a swing so small that nothing slides."""
    found = free(0.05, lambda _: 0.0, lambda _: 0.0, speed=1e-5, t_eval=np.linspace(0.0, 0.05, 20001), first_step=1e-7)
    velocity = found.y[2]
    peaks = np.flatnonzero(np.diff(np.sign(np.diff(velocity))) != 0)[:3] + 1
    decrement = log(abs(velocity[peaks[0]] / velocity[peaks[2]]))
    ratio = decrement / sqrt(4 * pi**2 + decrement**2)
    damped_hz = 1.0 / (found.t[peaks[2]] - found.t[peaks[0]])
    return float(damped_hz / sqrt(1.0 - ratio**2)), ratio


def torque_swings(frequencies_hz: np.ndarray) -> np.ndarray:
    """Amplitude of the motor's torque over what it is at rest, under commands that swing."""
    swing = 2 * pi * frequencies_hz
    times = np.linspace(0.1, 0.1 + 4 / frequencies_hz[0], 2000)
    start = [0.0] * len(swing)
    found = integrated(lambda t, y: BETA * (np.sin(swing * t) - y), start, float(times[-1]), t_eval=times)
    return np.ptp(found.y, axis=1) / 2


def bandwidth() -> float:
    frequencies = np.linspace(60.0, 140.0, 17)
    return float(np.interp(-sqrt(0.5), -torque_swings(frequencies), frequencies))


def rise() -> float:
    times = np.linspace(0.0, 0.02, 4001)
    found = integrated(lambda _, y: [BETA * (1.0 - y[0])], [0.0], 0.02, t_eval=times)
    ten, ninety = np.interp([0.1, 0.9], found.y[0], times)
    return float(ninety - ten)


# What is simulated, and how near to it the figure must be: slow motions are not infinitely slow.
SIMULATED: dict[str, tuple[Callable[[], float], float]] = {
    "stall_torque": (stalled, 1e-3),
    "holding_torque": (lambda: steady(COMMAND, -1e-2)[0], 1e-3),
    "no_load_speed": (no_load, 1e-3),
    "greatest_power": (lambda: strongest()[0], 2e-3),
    "mechanical_efficiency": (lambda: strongest()[1], 0.03),  # of the grid of velocities, flat though the top is
    "free_speed_per_command": (lambda: (no_load() - no_load(COMMAND / 2)) / (COMMAND / 2), 1e-3),
    "starting_acceleration": (lambda: sliding_free()[0], 1e-2),
    "mechanical_time_constant": (lambda: sliding_free()[1], 1e-2),
    "backdriving_torque": (lambda: -steady(0.0, VELOCITY)[0], 1e-3),
    "breakaway_torque": (lambda: breaking(by_command=False), 1e-2),
    "breakaway_command": (lambda: breaking(by_command=True), 1e-2),
    "hysteresis": (hysteresis, 1e-2),
    "presliding_displacement": (presliding, 1e-2),
    "lost_motion": (lost_motion, 1e-2),
    "contact_resonance": (lambda: contact()[0], 1e-2),
    "contact_damping_ratio": (lambda: contact()[1], 2e-2),
    "torque_bandwidth": (bandwidth, 1e-2),
    "torque_rise_time": (rise, 1e-3),
}


@pytest.mark.parametrize("row", DERIVED, ids=lambda row: row.name)
def test_a_figure_is_what_the_simulated_motor_does(row) -> None:
    simulated, tolerance = SIMULATED[row.name]
    assert figure(row.name).value == pytest.approx(simulated(), rel=tolerance)


def test_a_ratio_has_the_interval_of_what_stands_below() -> None:
    """A monotonic function of one uncertain parameter: its interval's ends are the function of that one's."""
    low, high = figure("mechanical_time_constant", uncertain_damping(0.2)).interval
    # The ends lie where 2.5 % ± 0.25 % of the draws do, three times over.
    assert low == pytest.approx(IM / (B * (1 + 1.96 * 0.2)), rel=0.03)
    assert high == pytest.approx(IM / (B * (1 - 1.96 * 0.2)), rel=0.07)


def test_correlated_parameters_make_a_narrower_interval_of_their_difference() -> None:
    together = np.diag([1e-4**2, 0, 0, 0, 1e-4**2, 0, 0])
    together[0, 4] = together[4, 0] = 0.9 * 1e-8
    motor = NortonNetwork(*VALUES, "N*m", covariance_names=NAMES, covariance=tuple(map(tuple, together.tolist())))
    stall = next(f for f in derived(motor, (POINT,)) if f.row.name == "stall_torque")
    std = sqrt((COMMAND * 1e-4) ** 2 + 1e-4**2 - 2 * COMMAND * 0.9 * 1e-8)
    assert np.diff(stall.interval)[0] == pytest.approx(2 * 1.96 * std, rel=0.06)


def test_what_the_draws_do_not_tell_has_an_open_end() -> None:
    """A damping that may as well be none: no greatest velocity follows."""
    interval = figure("no_load_speed", uncertain_damping(0.8)).interval
    assert interval[0] > 0.0
    assert interval[1] == np.inf


def test_a_figure_is_as_good_as_the_worst_parameter_in_it() -> None:
    statuses = dict.fromkeys(NAMES, Status.VALID) | {"viscous_damping": Status.INADEQUATE}
    found = {each.row.name: each for each in derived(network(), (POINT,), statuses=statuses)}
    assert found["no_load_speed"].status is Status.INADEQUATE
    assert not found["no_load_speed"].settled
    assert found["stall_torque"].settled


def test_beyond_what_was_seen_is_extrapolated() -> None:
    far = OperatingPoint("far", 0.5, 80.0)
    found = {each.key: each for each in derived(network(), (POINT, far))}
    assert not found["stall_torque (here)"].extrapolated
    assert found["stall_torque (far)"].extrapolated
    assert found["backdriving_torque (far)"].extrapolated
    assert found["no_load_speed (here)"].extrapolated, "52 rad/s, seen to 50"
    assert not found["torque_bandwidth"].extrapolated


def test_ratios_alone_give_what_needs_no_torque_scale() -> None:
    found = {each.row.name for each in derived(network().with_provenance({"scale": "ratios"}), (POINT,))}
    assert "mechanical_time_constant" in found
    assert not found & {"stall_torque", "greatest_power", "breakaway_torque"}


def test_a_common_factor_leaves_ratios_valid_and_nothing_else() -> None:
    statuses = dict.fromkeys(NAMES, Status.RATIO_ONLY)
    found = {each.row.name: each.status for each in derived(network(), (POINT,), statuses=statuses)}
    assert found["mechanical_time_constant"] is Status.VALID
    assert found["stall_torque"] is Status.RATIO_ONLY


def test_without_a_covariance_there_is_no_interval() -> None:
    (constant,) = (each for each in derived(NortonNetwork(*VALUES, "N*m"), ()) if each.row.name == "torque_rise_time")
    assert constant.value == pytest.approx(log(9.0) / BETA)
    assert np.isnan(constant.interval).all()


def test_the_interval_holds_95_percent_of_the_draws() -> None:
    draws = np.random.default_rng(1).standard_normal(DRAWS)
    low, high = interval_of(draws)
    assert np.mean((draws >= low) & (draws <= high)) == pytest.approx(0.95, abs=3 / DRAWS)


TERMS = (
    NetworkTerm("stribeck", (0.008, 2.0)),
    NetworkTerm("load", (0.1,)),
    NetworkTerm("saturation", (20.0,)),
    NetworkTerm("drag", (2e-5,)),
    NetworkTerm("cogging", (0.002, 0.001), 8),
)


def motor_with_terms(relative: float = 0.01) -> NortonNetwork:
    plain = network(relative)
    own = {name: value for term in TERMS if term.name != "cogging" for name, value in term.named().items()}
    covariance = np.diag([*np.diag(plain.covariance), *((0.1 * value) ** 2 for value in own.values())])
    return replace(
        plain,
        terms=TERMS,
        covariance_names=(*NAMES, *own),
        covariance=tuple(map(tuple, covariance.tolist())),
    )


def test_figures_have_the_terms_in_them():
    """Each against what the network's own torque, motion and thresholds give; cogging at its mean, which is none."""
    with_terms = motor_with_terms()
    smooth = replace(with_terms, terms=TERMS[:-1])
    value = {each.row.name: each.value for each in derived(with_terms, (POINT,))}
    free_rad_s = float(smooth.source_velocity(COMMAND))
    assert value["no_load_speed"] == pytest.approx(free_rad_s)
    assert smooth.free_motion(np.full(3000, COMMAND), 1e-3)[1][-1] == pytest.approx(free_rad_s, rel=1e-4)
    assert value["breakaway_command"] == pytest.approx(with_terms.thresholds[1])
    assert value["starting_acceleration"] == pytest.approx((KM_KA * COMMAND / (1 + 20 * COMMAND**2) - 0.028) / IM)

    def slides(command: float, velocity: float) -> float:
        position = velocity * 1e-3 * np.arange(2000)
        start = {"motor_torque_nm": KM_KA * command, "friction_torque_nm": np.sign(velocity) * TAU_C}
        return float(smooth.torque(np.full(2000, command), position, 1e-3, **start)[-10])

    assert value["backdriving_torque"] == pytest.approx(-slides(0.0, VELOCITY), rel=1e-4)
    assert value["stall_torque"] == pytest.approx(slides(COMMAND, 2e-2), rel=2e-3)
    assert value["holding_torque"] == pytest.approx(slides(COMMAND, -2e-2), rel=2e-3)
    speeds = np.linspace(0.02, 1.0, 50) * min(free_rad_s, VELOCITY)
    powers = [slides(COMMAND, speed) * speed for speed in speeds]
    assert value["greatest_power"] == pytest.approx(max(powers), rel=1e-3)
    driven = KM_KA * COMMAND / (1 + 20 * COMMAND**2)
    at_most = slides(COMMAND, speeds[int(np.argmax(powers))]) / driven
    assert value["mechanical_efficiency"] == pytest.approx(at_most, rel=0.05)


def test_intervals_hold_what_is_not_known_of_the_terms():
    exact, vague = (figure("stall_torque", motor_with_terms(0.0 if plain else 0.01)) for plain in (True, False))
    low, high = exact.interval
    # 10 % of 8 mN m of Stribeck torque, 10 % of the load's share and of saturation are all that is vague.
    assert 0.5e-3 < high - exact.value < 3e-3
    assert 0.5e-3 < exact.value - low < 3e-3
    assert np.ptp(vague.interval) > np.ptp(exact.interval)


def test_networks_are_drawn_as_the_covariance_has_them_and_none_that_no_machine_is() -> None:
    """A damping that is known to 10 %, over 300 draws: its deviation is known to 4 %, three times that; and one that is
    known to 60 % would be below zero in one draw of twenty."""
    values = np.array([each.viscous_damping_nms_rad for each in drawn_networks(uncertain_damping(0.1), 300, 0)])
    assert values.size == 300
    assert np.std(values) == pytest.approx(0.1 * B, rel=0.12)
    assert np.mean(values) == pytest.approx(B, abs=3 * 0.1 * B / np.sqrt(300))
    assert all(each.viscous_damping_nms_rad > 0.0 for each in drawn_networks(uncertain_damping(0.6), 300, 0))
    assert drawn_networks(replace(network(), covariance_names=(), covariance=()), 3, 0) == ()
    joint = NetworkTerm("compliance", (5.0, 1e-4, 1e-5))
    uncertain = replace(network(), terms=(joint,), covariance_names=("joint_damping",), covariance=((1e-6,),))
    with_gain = replace(uncertain, covariance_names=("joint_damping", "inertia"), covariance=((1e-6, 0.0), (0.0, 0.0)))
    assert all(each.terms[0].values[1] >= 0.0 for each in drawn_networks(with_gain, 300, 0))
