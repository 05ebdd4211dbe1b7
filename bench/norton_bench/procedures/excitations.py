"""Excitations (stretches of command and imposed motion), as large as the rig, its load and the network allow.

Every excitation begins and ends at rest in the same place, with zero command, so that they can follow in any order.

Plans are made smaller until they keep to every limit of the rig, by what has been measured so far."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control.calibration import LoadCalibration
from norton_bench.identification.expansion import Excitation
from norton_bench.models.network import NortonNetwork
from norton_bench.procedures.calibrate import first_inertia_kgm2
from norton_bench.procedures.knowledge import Knowledge, why_no_basis
from norton_bench.procedures.waves import (
    Motion,
    highest_hz,
    hold,
    multisine,
    multisine_motion,
    sine_motion,
    velocity_steps,
)
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig

DURATION_S = 2.0
# A plan may reach this share of any limit: the shaft overshoots a little, and the network is an estimate.
SHARE = 0.8
# The motion alone may reach this share of a limit, which leaves room for a command.
MOTION_SHARE = 0.5
CLIPPINGS = 50
# Above this the velocity's spectrum falls with frequency, so that acceleration, and with it torque, stays bounded.
HIGHEST_MOTION_HZ = 60.0
# The load drive may spend this share of its torque on accelerating the two inertias.
TORQUE_SHARE = 0.4
CHANGE_S = 0.15
DWELL_S = 0.35
# The load holds against a command up to about this frequency; above, both inertias swing, and the spring of the torque
# sensor between them lets the actuator's swing by so much more.
HELD_TO_HZ = 10.0
SPRING = 1.5
# Each try is smaller by this factor; an excitation that never fits is left out.
CANDIDATE_SHRINKS = 0.8
MOST_TRIES = 40
# A command that changes in less than this share of its ticks is a staircase.
STEPS_SHARE = 0.5

CRUISE_SHARES = (0.05, 0.3, 1.0)
COMMAND_BANDS_HZ = ((0.5, 30.0), (5.0, 100.0), (20.0, 200.0))
# Loops' amplitudes in presliding lengths τc/σ0, and their frequencies.
LOOP_LENGTHS = (1.0, 3.0, 10.0)
LOOP_HZ = (2.0, 8.0, 25.0)
LOOP_LEAST_S = 1.0


@dataclass(frozen=True)
class Candidate:
    """A possible excitation; command and motion have shape (ticks,)."""

    name: str
    command: FloatArray
    motion: Motion

    @property
    def ticks(self) -> int:
        return len(self.command)


Bounded = tuple[FloatArray, float]  # values, and the limit of their size


@dataclass(frozen=True)
class PlanBounds:
    """The limits of the rig for a plan, computed with the network and the load as they are known.

    ``travel_rad`` is how far the shaft may move from its present position.
    """

    rig: Rig
    network: NortonNetwork
    load: LoadCalibration
    travel_rad: float

    def swing_rad_s(self, command: FloatArray, motion: Motion) -> FloatArray:
        """The velocity that the command gives to the shaft although the load holds it, shape (ticks,): a velocity
        commanded gives none where the shaft has it."""
        servo = self.network.servo
        if servo is not None and not servo.holds_position:
            command = command - motion.velocity_rad_s
        hold_rad_s, tick_s = 2 * np.pi * HELD_TO_HZ, self.rig.tick_s
        motor_nm = self.network.torque_gain * _lagged(command, self.network.amplifier_bandwidth_rad_s, tick_s)
        inertia_kgm2 = self.network.inertia_kgm2 + self.load.inertia_kgm2
        return _lagged(motor_nm, hold_rad_s, tick_s) / (inertia_kgm2 * hold_rad_s)

    def excitation(self, candidate: Candidate) -> Excitation:
        """The expected motion with the candidate: the imposed one, and what the command adds."""
        tick_s = self.rig.tick_s
        swing_rad = np.cumsum(self.swing_rad_s(candidate.command, candidate.motion)) * tick_s
        return Excitation(tick_s, candidate.command, candidate.motion.position_rad + swing_rad)

    def allow(self, command: FloatArray, motion: Motion, share: float) -> bool:
        """Whether command, its rate, motion, port torque and power and load torque stay within ``share`` of each."""
        load = self.load
        port_nm = self.network.torque(command, motion.position_rad, self.rig.tick_s)
        friction_nm = load.viscous_damping_nms_rad * np.abs(motion.velocity_rad_s) + load.coulomb_torque_nm
        load_nm = (np.abs(load.inertia_kgm2 * motion.acceleration_rad_s2 - port_nm) + friction_nm) / load.torque_gain
        velocity_rad_s = np.abs(motion.velocity_rad_s) + SPRING * np.abs(self.swing_rad_s(command, motion))
        moved = self._moved(command, motion, velocity_rad_s, port_nm)
        return _within((*moved, (load_nm, self.rig.limits.load_torque_nm)), share)

    def allow_pushed(self, command: FloatArray, motion: Motion, share: float) -> bool:
        """The same of a ``motion`` that is the answer to a torque of the load, which is itself within its limit."""
        port_nm = self.network.torque(command, motion.position_rad, self.rig.tick_s)
        return _within(self._moved(command, motion, motion.velocity_rad_s, port_nm), share)

    def _moved(
        self, command: FloatArray, motion: Motion, velocity_rad_s: FloatArray, port_nm: FloatArray
    ) -> tuple[Bounded, ...]:
        """Each with its limit, for a shaft that moves at such velocities."""
        rig, limits = self.rig, self.rig.limits
        rate_per_s = np.diff(command, prepend=0.0, append=0.0) / rig.tick_s
        return (
            (command, rig.command.limit),
            (rate_per_s, limits.command_rate_per_s),
            (velocity_rad_s, limits.velocity_rad_s),
            (motion.position_rad, self.travel_rad),
            (port_nm, limits.torque_nm),
            (port_nm * velocity_rad_s, limits.power_w),
        )

    def pushed_motion(self, load_nm: FloatArray, command: FloatArray) -> Motion:
        """How the shaft of a servo moves with a torque of the load [N m] and a command, (ticks,) each.

        Of the linear network: friction, which would hold it back, is left out, and so is the servo's limit.
        """
        servo, network, tick_s = self.network.servo, self.network, self.rig.tick_s
        assert servo is not None
        size = 2 * load_nm.size  # the second half at rest: what is periodic here does not return to the beginning
        s = 2j * np.pi * np.fft.rfftfreq(size, tick_s)
        driven = network.torque_gain / (1.0 + s / network.amplifier_bandwidth_rad_s)
        inertia_kgm2 = network.inertia_kgm2 + self.load.inertia_kgm2
        damping_nms_rad = network.viscous_damping_nms_rad + self.load.viscous_damping_nms_rad
        held = driven * np.exp(-s * servo.delay_s) * (servo.of_angle + servo.of_velocity * s)
        stiffness = inertia_kgm2 * s**2 + damping_nms_rad * s + held
        torque = self.load.torque_gain * np.fft.rfft(load_nm, size) + driven * np.fft.rfft(command, size)
        # A servo of velocity has no place of its own: the mean of its angle is anywhere.
        angle = np.divide(torque, stiffness, out=np.zeros_like(torque), where=stiffness != 0.0)
        position, velocity, acceleration = (np.fft.irfft(s**order * angle, size)[: load_nm.size] for order in range(3))
        return Motion(position - position[0], velocity, acceleration)

    def allow_free(self, command: FloatArray, share: float) -> bool:
        """Whether command, its rate, the free motion and the torque for the load to follow stay within ``share``.

        At the steps of a staircase the torque of the load and the rate of the command are not checked: a load at its
        limit lags by some milliseconds, which is over long before the level is evaluated.
        """
        rig, limits, load, tick_s = self.rig, self.rig.limits, self.load, self.rig.tick_s
        position_rad, velocity_rad_s, acceleration_rad_s2 = self.network.free_motion(command, tick_s)
        friction_nm = load.viscous_damping_nms_rad * np.abs(velocity_rad_s) + load.coulomb_torque_nm
        load_nm = (np.abs(load.inertia_kgm2 * acceleration_rad_s2) + friction_nm) / load.torque_gain
        rate_per_s = np.diff(command, prepend=command[0]) / tick_s
        steps = bool(np.count_nonzero(rate_per_s) < STEPS_SHARE * command.size)
        pairs = (
            (command, rig.command.limit),
            (velocity_rad_s, limits.velocity_rad_s),
            (position_rad, self.travel_rad),
            *(() if steps else ((rate_per_s, limits.command_rate_per_s), (load_nm, limits.load_torque_nm))),
        )
        return _within(pairs, share)


def _within(pairs: Iterable[Bounded], share: float) -> bool:
    return all(bool(np.max(np.abs(values)) <= share * bound) for values, bound in pairs)


def candidates(bounds: PlanBounds, seed: int) -> tuple[Candidate, ...]:
    """All excitations within ``bounds``; another ``seed`` gives other multisines."""
    ideas = (*_still(bounds, seed), *_cruises(bounds, seed), *_loops(bounds), *_shaken(bounds, seed))
    fitted = (_fitted(idea, bounds) for idea in ideas)
    return tuple(candidate for candidate in fitted if candidate is not None)


def _still(bounds: PlanBounds, seed: int) -> Iterator[Candidate]:
    """The shaft held, with a large command: for gain, bandwidth of the amplifier, delay of the command."""
    ticks = len(hold(0.0, DURATION_S, bounds.rig.tick_s))
    for band_hz in _bands(bounds):
        command = _command(bounds, band_hz, DURATION_S, seed)
        yield Candidate(f"command to {band_hz[1]:.0f} Hz, held", command, _rest(ticks))


def _cruises(bounds: PlanBounds, seed: int) -> Iterator[Candidate]:
    """Steady turning both ways, without command and with one: viscous damping and Coulomb torque; and gain and
    bandwidth without the influence of a friction contact at rest."""
    tick_s = bounds.rig.tick_s
    for share in CRUISE_SHARES:
        velocity_rad_s = share * bounds.rig.limits.velocity_rad_s
        motion = velocity_steps(np.array([velocity_rad_s, -velocity_rad_s]), CHANGE_S, DWELL_S, tick_s)
        # The pause at the end is as long as a dwell; the rest of the time is divided between the two directions.
        ticks = len(motion.position_rad)
        yield Candidate(f"cruise at {share:.0%}", np.zeros(ticks), motion)
        for band_hz in _bands(bounds):
            command = _command(bounds, band_hz, ticks * tick_s, seed)
            yield Candidate(f"cruise at {share:.0%}, command to {band_hz[1]:.0f} Hz", command, motion)


def _loops(bounds: PlanBounds) -> Iterator[Candidate]:
    """Turning back and forth within a few presliding lengths: stiffness and damping of the friction contact."""
    length_rad = bounds.network.coulomb_torque_nm / bounds.network.presliding_stiffness_nm_rad
    for frequency_hz in LOOP_HZ:
        cycles = max(3, round(LOOP_LEAST_S * frequency_hz))
        for lengths in LOOP_LENGTHS:
            motion = sine_motion(lengths * length_rad, frequency_hz, cycles, bounds.rig.tick_s)
            name = f"loops of {lengths:g} presliding lengths at {frequency_hz:g} Hz"
            yield Candidate(name, np.zeros(len(motion.position_rad)), motion)


def _shaken(bounds: PlanBounds, seed: int) -> Iterator[Candidate]:
    """A multisine motion, wide and fast, alone and with a command: for inertia, and for all parameters together."""
    tick_s, greatest_rad_s = bounds.rig.tick_s, bounds.rig.limits.velocity_rad_s
    for low_hz, slope in ((0.5, -0.6), (3.0, 0.0), (15.0, 0.0)):
        motion = multisine_motion(
            DURATION_S, tick_s, low_hz=low_hz, high_hz=HIGHEST_MOTION_HZ, seed=seed, slope=slope
        ).scaled(greatest_rad_s)
        yield Candidate(f"shaken from {low_hz:g} Hz", np.zeros(len(motion.position_rad)), motion)
        command = _command(bounds, COMMAND_BANDS_HZ[0], DURATION_S, seed + 1)
        yield Candidate(f"shaken from {low_hz:g} Hz, command to {COMMAND_BANDS_HZ[0][1]:.0f} Hz", command, motion)


def _bands(bounds: PlanBounds) -> list[tuple[float, float]]:
    """The bands that are possible at the rate of the loop."""
    most_hz = highest_hz(bounds.rig.tick_s)
    return [(low, min(high, most_hz)) for low, high in COMMAND_BANDS_HZ if 2 * low < most_hz]


def _command(bounds: PlanBounds, band_hz: tuple[float, float], duration_s: float, seed: int) -> FloatArray:
    low_hz, high_hz = band_hz
    wave = multisine(
        duration_s, bounds.rig.tick_s, low_hz=low_hz, high_hz=high_hz, seed=seed, lines=30, clippings=CLIPPINGS
    )
    return bounds.rig.command.limit * wave


def _rest(ticks: int) -> Motion:
    return Motion(np.zeros(ticks), np.zeros(ticks), np.zeros(ticks))


def _lagged(values: FloatArray, bandwidth_rad_s: float, tick_s: float) -> FloatArray:
    from norton_bench.models import network_steps  # noqa: PLC0415  (compiled: slow to import)

    decay = float(np.exp(-bandwidth_rad_s * tick_s))
    return np.asarray(network_steps.lagged(np.ascontiguousarray(values), decay, 0.0))


def _fitted(idea: Candidate, bounds: PlanBounds) -> Candidate | None:
    """``idea`` made smaller until it keeps to ``bounds``: first its motion alone, then the command with it."""
    nothing = np.zeros(idea.ticks)
    moves, commands = bool(np.any(idea.motion.position_rad)), bool(np.any(idea.command))
    share = MOTION_SHARE if commands else SHARE
    motion = idea.motion
    for _ in range(MOST_TRIES):
        if not moves or bounds.allow(nothing, motion, share):
            break
        motion = motion.scaled(CANDIDATE_SHRINKS)
    else:
        return None
    if not commands:
        return Candidate(idea.name, nothing, motion)
    command = idea.command
    for _ in range(MOST_TRIES):
        if bounds.allow(command, motion, SHARE):
            return Candidate(idea.name, command, motion)
        command = command * CANDIDATE_SHRINKS
    return None


# A plan is not made smaller than this, because it would give no information; then the guard is the only protection.
LEAST = 0.05
# Each try is smaller by this factor.
PLAN_SHRINKS = 0.95
# A plan below this share of its size is reported as made smaller.
REPORTED_BELOW = 0.99


@dataclass(frozen=True)
class Sized:
    """A plan at ``share`` of its usual size: command and motion, both of shape (ticks,)."""

    command: FloatArray
    motion: Motion
    share: float


@dataclass(frozen=True)
class SizedPush:
    """Torque of the load [N m] and command, (ticks,) each, at ``share`` of their usual size."""

    load_nm: FloatArray
    command: FloatArray
    share: float


def bounds_of(known: Knowledge) -> PlanBounds | None:
    """The limits of the rig with the calibration and the first fit of the actuator; None where one is missing."""
    fit = known.actuator
    if known.calibration is None or fit is None or first_inertia_kgm2(fit) is None:
        return None
    if why_no_basis(replace(fit, converged=True), "the actuator") is not None:
        return None
    return PlanBounds(
        known.rig, fit.network.dissipative(), known.calibration, travel_left_rad(known.records, known.rig)
    )


def travel_left_rad(records: Sequence[Measured], rig: Rig) -> float:
    """How far the shaft may move either way from its present position, within the limit about its first position."""
    limit_rad = rig.limits.position_rad
    if not records or not np.isfinite(limit_rad):
        return limit_rad
    position_rad = np.concatenate([records[0].ticks["position_rad"], records[-1].ticks["position_rad"]])
    stood_rad = position_rad[np.isfinite(position_rad)]
    return limit_rad - abs(float(stood_rad[-1] - stood_rad[0]))


def _shrunk(allowed: Callable[[float], bool]) -> float:
    """The share of a plan's size that is ``allowed``; the least one where none is."""
    share = 1.0
    while share > LEAST and not allowed(share):
        share *= PLAN_SHRINKS
    return share


def imposed_within(bounds: PlanBounds | None, command: FloatArray, motion: Motion) -> Sized:
    """Command and imposed motion, made smaller until the limits allow them."""
    share = _shrunk(lambda share: bounds is None or bounds.allow(share * command, motion.scaled(share), SHARE))
    return Sized(share * command, motion.scaled(share), share)


def held_within(bounds: PlanBounds | None, command: FloatArray, motion: Motion) -> Sized:
    """The same for a small motion: only the command is made smaller."""
    share = _shrunk(lambda share: bounds is None or bounds.allow(share * command, motion, SHARE))
    return Sized(share * command, motion, share)


def free_within(bounds: PlanBounds | None, command: FloatArray) -> float:
    """The share of ``command`` (ticks,) for which the free motion, and the torque for the load to follow, stay
    inside."""
    return _shrunk(lambda share: bounds is None or bounds.allow_free(share * command, SHARE))


def pushed_within(bounds: PlanBounds | None, load_nm: FloatArray, command: FloatArray) -> SizedPush:
    """A torque of the load and a command for a servo, made smaller until the limits allow what they make of it."""
    if bounds is None:
        return SizedPush(load_nm, command, 1.0)
    motion = bounds.pushed_motion(load_nm, command)
    share = _shrunk(lambda share: bounds.allow_pushed(share * command, motion.scaled(share), SHARE))
    return SizedPush(share * load_nm, share * command, share)


def words_for(what: str, share: float) -> tuple[str, ...]:
    """A sentence about a smaller ``what``, and the cost; none where it was hardly made smaller."""
    if share > REPORTED_BELOW:
        return ()
    return (
        f"{what} at {share:.0%} of its usual size, to stay within {SHARE:.0%} of every limit: in the same time "
        f"intervals become {1 / share:.1f} times wider; higher [limits] or a longer step would avoid that",
    )


def imposed_multisine(known: Knowledge, amplitude: float, duration_s: float, seed: int) -> Motion:
    """A multisine motion as large as the velocity limit's share ``amplitude`` and the load's torque allow."""
    motion = multisine_motion(duration_s, known.tick_s, low_hz=0.3, high_hz=HIGHEST_MOTION_HZ, seed=seed, slope=-0.6)
    factor = amplitude * known.rig.limits.velocity_rad_s
    if known.calibration is not None:
        # The inertia of the actuator is not known yet: assume that of the load.
        inertia_kgm2 = 2 * known.calibration.inertia_kgm2
        torque_nm = inertia_kgm2 * float(np.max(np.abs(motion.acceleration_rad_s2)))
        available_nm = TORQUE_SHARE * min(known.rig.limits.load_torque_nm, known.rig.limits.torque_nm)
        factor = min(factor, available_nm / torque_nm)
    return motion.scaled(factor)
