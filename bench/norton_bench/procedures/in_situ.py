"""In situ (paper, sections V and VI.E): the motion source of an actuator that stays assembled to its load.

The assembly is shaken first, to identify load and actuator separately. Then one movement is repeated. In most trials
the load drive gives the load the torque that it needs to follow, so that the actuator exerts no torque and its motion
is the motion source. In some trials, chosen at random, the load is not driven; they show the scatter of movements. The
torque of the actuator is computed from the motion and the load; no torque sensor is used. Between trials the drives
are idle.

The load's torque is learned through a model of the actuator, where it has one: a motor's friction is too sudden for
anything else. Any other actuator is learned from its measured response.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError, RigError
from norton_bench.identification.assembly import Trial
from norton_bench.identification.in_situ import (
    EXPLAINED,
    IN_SITU,
    PUSHED,
    Exerted,
    converged,
    figures,
    pushed_segments,
    why_not_settled,
)
from norton_bench.identification.trials import TRIAL, diverge, trial_segments
from norton_bench.procedures.assembly import assembly_of
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.excitations import travel_left_rad
from norton_bench.procedures.knowledge import VELOCITY_SHARE, Decision, Knowledge, Plan
from norton_bench.procedures.learning import Assembly, InSitu, Models, correction, next_load_torque
from norton_bench.procedures.measured_response import load_torque_towards_source
from norton_bench.procedures.options import CalibrateOptions, InSituOptions
from norton_bench.procedures.pushes import best_of, push_nm
from norton_bench.procedures.tare import greatest_load_torque
from norton_bench.procedures.waves import SLOWLY, back, coasting, hold, multisine, pushed, ramp, staircase
from norton_bench.records import LOAD_TAKEN, Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment, Use

REST_S = 0.3
# Before each trial the load is pushed this many times harder than its friction, with ramps of this duration.
PUSH, PUSH_S = 2.0, 0.1
# An actuator without a model may return by itself: the load swings, at first with this many times its friction.
SWING, SWINGS, SWING_S = 3.0, 8, 1.0
# The rest after the way back from a movement that was too fast, or from the middle of the commands.
BACK_S = 1.0
BACK_LASTS_S = (1.0 + SLOWLY) * BACK_S
# To the middle of commands that are not the same to both sides.
LEAD_S = 1.0
# The first trial is not driven, for comparison; the first two driven ones show whether the trials converge.
FIRST = (False, True, True)
HALVINGS = 20
NO_PUSHES = (
    "it is not pushed off its path: the torque of the load drive or the velocity limit leaves no room for that; set a "
    "smaller amplitude of the step"
)
# How the segments are called in which the movement grows; their share of the greatest one follows.
SIZE = "size "
# The first share; how many there may be, each at most twice the last; and the speed that is enough, as a share of what
# is allowed. Friction makes speed grow faster than the command, so what is aimed at is less than all.
FIRST_SHARE, SIZES, ENOUGH, AIM = 0.05, 7, 0.6, 0.8
# Of the way that is left within the position limit, a movement may take this share.
TRAVEL_SHARE = 0.8


class _Shaking(CalibrateProcedure):
    """Shakes as the calibration does, under the name of this step: a session that resumes looks for that name."""

    name: ClassVar[str] = IN_SITU


def _shaking(options: InSituOptions) -> _Shaking:
    return _Shaking(CalibrateOptions(duration_s=options.shake_s))


@dataclass(frozen=True)
class Shake:
    """Load and actuator are shaken independently, and identified separately."""

    options: InSituOptions
    name: ClassVar[str] = IN_SITU

    def require(self, rig: Rig) -> None:
        """Checked before."""

    def duration_s(self, rig: Rig) -> float:
        return _shaking(self.options).duration_s(rig)

    def plan(self, known: Knowledge) -> Plan:
        yield from _shaking(self.options).plan(known)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        assembly = assembly_of(known, measured, self.options)
        return replace(known, in_situ=_planned(self.options, assembly, known))

    def recorded_event(self, known: Knowledge) -> tuple[str, str]:
        """The load's values."""
        assert known.in_situ is not None
        return LOAD_TAKEN, known.in_situ.load.as_text()


@dataclass(frozen=True, eq=False)
class Size:
    """Looks for the greatest movement, where no model predicts it: from a small one on, with the load not driven."""

    options: InSituOptions
    state: InSitu
    name: ClassVar[str] = IN_SITU

    def require(self, rig: Rig) -> None:
        """Checked before."""

    def duration_s(self, rig: Rig) -> float:
        return _size_s(self.options, rig)

    def plan(self, known: Knowledge) -> Plan:
        rig, share = known.rig, FIRST_SHARE
        for _ in range(SIZES):
            command = _command(self.options, rig, share)
            if command[0]:
                lead = _lead(rig, _fastest_rad_s(self.options, rig))
                measured = yield lead
                if len(measured.ticks) < len(lead.command):
                    yield back(self.name, "rest", rig, measured, BACK_S)
                    return
            measured = yield coasting(
                self.name,
                f"{SIZE}{share!r}",
                Use.PREPARE,
                command,
                stop_at_velocity_rad_s=_fastest_rad_s(self.options, rig),
            )
            yield back(self.name, "rest", rig, measured, BACK_S)
            used = self._used(measured, known)
            if share == 1.0 or used > ENOUGH:
                return
            share = min(share * min(2.0, AIM / max(used, AIM / 2.0)), 1.0)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        share = 0.0
        for segment in measured.segments:
            if segment.name.startswith(SIZE):
                used = self._used(measured.between(segment.start_ns, segment.end_ns), known)
                share = float(segment.name.removeprefix(SIZE)) if used < 1.0 else share
        if not share:
            raise ExperimentError(
                "in_situ: the smallest movement about the middle of the commands is faster than "
                f"{_fastest_rad_s(self.options, known.rig):.3g} rad/s, or goes too far; set a lower [actuator.command] "
                "limit, or a greater amplitude of the step"
            )
        command = _command(self.options, known.rig, share)
        return replace(known, in_situ=replace(self.state, command=command, sized=True))

    def _used(self, measured: Measured, known: Knowledge) -> float:
        """The greater share of what is allowed of speed and of way."""
        position_rad = measured.ticks["position_rad"]
        velocity_rad_s = np.nanmax(np.abs(measured.ticks["velocity_rad_s"]), initial=0.0)
        way_rad = np.nanmax(np.abs(position_rad - position_rad[0]), initial=0.0)
        speed = velocity_rad_s / _fastest_rad_s(self.options, known.rig)
        return float(max(speed, way_rad / (TRAVEL_SHARE * travel_left_rad(known.records, known.rig))))


def _fastest_rad_s(options: InSituOptions, rig: Rig) -> float:
    """The greatest speed that a movement may have."""
    return min(options.amplitude, VELOCITY_SHARE) * rig.limits.velocity_rad_s


def _size_s(options: InSituOptions, rig: Rig) -> float:
    """The greatest duration of the search for the movement; 0 where a model predicts it."""
    if rig.is_motor:
        return 0.0
    return SIZES * (LEAD_S + len(_command(options, rig, 1.0)) * rig.tick_s + BACK_LASTS_S)


def _lead(rig: Rig, fastest_rad_s: float) -> Segment:
    """To the middle of the commands; it ends early where that turns the shaft fast."""
    command = ramp(0.0, _middle_and_reach(rig)[0], LEAD_S, rig.tick_s)
    return coasting(IN_SITU, "lead", Use.PREPARE, command, stop_at_velocity_rad_s=fastest_rad_s)


@dataclass(frozen=True, eq=False)
class InSituTrial:
    """One trial; ``load_torque_nm`` (ticks,) is zero where the load is left alone. With ``is_pushed`` it is one that is
    pushed off the path."""

    number: int
    driven: bool
    load_torque_nm: FloatArray
    state: InSitu
    is_pushed: bool = False
    name: ClassVar[str] = Shake.name

    def require(self, rig: Rig) -> None:
        """Checked before the first."""

    def duration_s(self, rig: Rig) -> float:
        return _trial_s(len(self.load_torque_nm), rig)

    def plan(self, known: Knowledge) -> Plan:
        middle, tick_s = float(self.state.command[0]), known.tick_s
        if middle:
            yield _lead(known.rig, np.inf)  # the movement was tried there
        greatest_nm = greatest_load_torque(known.rig)
        past_nm = np.clip(self._same_past_nm(tick_s), -greatest_nm, greatest_nm)
        yield pushed(self.name, "same past", Use.PREPARE, past_nm, np.full(len(past_nm), middle))
        yield coasting(self.name, "settle", Use.PREPARE, hold(middle, REST_S, tick_s))
        name = f"{PUSHED if self.is_pushed else TRIAL}{self.number}"
        measured = yield pushed(self.name, name, Use.PREPARE, self.load_torque_nm, self.state.command)
        if middle:
            yield back(self.name, "rest", known.rig, measured, BACK_S)

    def _same_past_nm(self, tick_s: float) -> FloatArray:
        """A torque after which the friction contacts are always in the same state.

        A motor stays where it is pushed: both contacts are bent to the same side. What returns by itself, as a spring
        does, is swung to and fro, less and less: it ends near its rest, with contacts that are hardly bent.
        """
        assert self.state.assembly is not None
        load, actuator = self.state.assembly.load.network, self.state.assembly.actuator
        if actuator is None:
            top_nm = SWING * load.coulomb_torque_nm / load.torque_gain
            time_s = np.arange(1, round(SWING_S / tick_s) + 1) * tick_s
            return np.asarray(top_nm * (1.0 - time_s / SWING_S) * np.sin(2 * np.pi * SWINGS / SWING_S * time_s))
        coulomb_nm = load.coulomb_torque_nm + actuator.network.coulomb_torque_nm
        top_nm = PUSH * coulomb_nm / load.torque_gain
        return np.concatenate([ramp(0.0, top_nm, PUSH_S, tick_s), ramp(top_nm, 0.0, PUSH_S, tick_s)])

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        before = self.state
        segments = pushed_segments(measured) if self.is_pushed else trial_segments(measured, self.name)
        trial = Trial.of(measured, segments[-1], before.load, known.tick_s)
        if self.is_pushed:
            return replace(known, in_situ=replace(before, pushed=(*before.pushed, trial)))
        exerted = Exerted.of(self.number, self.driven, trial, before.load, known.tick_s)
        after = replace(before, trials=(*before.trials, exerted), readings=(*before.readings, trial))
        return replace(known, in_situ=after)


@dataclass(frozen=True)
class InSituProcedure:
    """Shakes once, then repeats trials until only the scatter of movements is left, or until trials do not help; then,
    if asked for, trials that are pushed off the path."""

    options: InSituOptions = field(default_factory=InSituOptions)
    name: ClassVar[str] = Shake.name

    def require(self, rig: Rig) -> None:
        if rig.wiring.load is None:
            raise RigError(
                f"{rig.place}: step 'in_situ' needs a load drive to give the load what it needs; "
                "add a [load] section or leave the step out"
            )
        if not rig.may_be_a_spring and _middle_and_reach(rig)[1] <= 0.0:
            raise RigError(
                f"{rig.place}: step 'in_situ' moves to and fro, and the commands of this actuator turn it to one side "
                "only; give [actuator.command] a lowest below zero, or leave the step out"
            )
        if self.options.hold_s is not None and rig.servo is not None:
            raise RigError(
                f"{rig.place}: step 'in_situ': hold is for an actuator that reaches by itself; a servo would jump from "
                "level to level: leave hold out"
            )

    def duration_s(self, rig: Rig) -> float:
        trial_s = _trial_s(len(_command(self.options, rig, 1.0)), rig)
        trials = self.options.trials + self.options.pushes
        return _shaking(self.options).duration_s(rig) + _size_s(self.options, rig) + trials * trial_s

    def following(self, known: Knowledge) -> Decision:
        state = known.in_situ
        if state is None or state.finished:
            sentence = "the assembly is shaken, to identify load and actuator separately"
            return Decision(replace(known, in_situ=None), Shake(self.options), sentence)
        if not state.sized:
            return Decision(
                known, Size(self.options, state), "the greatest movement that is not too fast is looked for"
            )
        trials = figures(state.trials)
        if not (converged(trials) or diverge(trials) or len(trials) >= self.options.trials):
            return _next(known, state)
        if len(state.pushed) == self.options.pushes:
            return _done(known, state)
        push = _push_nm(known, state)
        return _push(known, state, push) if push.any() else _done(known, state, NO_PUSHES)


def _next(known: Knowledge, state: InSitu) -> Decision:
    assert state.assembly is not None
    number = len(state.trials) + 1
    driven = state.order[number - 1]
    greatest_nm = greatest_load_torque(known.rig)
    learned_nm = _load_torque_nm(state, known) if driven else np.zeros(len(state.command))
    load_torque_nm = np.clip(learned_nm, -greatest_nm, greatest_nm)
    how = "with the load driven" if driven else "with the load not driven"
    before = in_words(state) if state.trials else "; ".join(state.assembly.said)
    return Decision(known, InSituTrial(number, driven, load_torque_nm, state), f"{before}; trial {number} {how}")


def _push_nm(known: Knowledge, state: InSitu) -> FloatArray:
    greatest_nm = greatest_load_torque(known.rig)
    return push_nm(state.load.machine, state.readings, state.pushed, greatest_nm, REST_S, known.rig)


def _push(known: Knowledge, state: InSitu, push: FloatArray) -> Decision:
    number = len(state.pushed) + 1
    load_torque_nm = best_of(state.readings).load_torque_nm + push
    sentence = f"push {number}: off the path with up to {np.max(np.abs(push)):.2g} N*m"
    return Decision(known, InSituTrial(number, True, load_torque_nm, state, is_pushed=True), sentence)


def _load_torque_nm(state: InSitu, known: Knowledge) -> FloatArray:
    """What the load should need to go along with the actuator, by all trials so far."""
    assert state.assembly is not None
    load, actuator, tick_s = state.assembly.load, state.assembly.actuator, known.tick_s
    if actuator is None:
        both = zip(state.readings, state.trials, strict=True)
        readings = [reading for reading, trial in both if trial.driven or trial.number == 1]
        no_faster_rad_s = VELOCITY_SHARE * known.rig.limits.velocity_rad_s
        return load_torque_towards_source(load, readings, no_faster_rad_s, tick_s)
    models = Models(actuator, load)
    corrections = [
        correction(models, state.command, each.load_torque_nm, each.seen, each.torque_nm, tick_s)
        for each in state.readings
    ]
    return next_load_torque(models, state.command, corrections, 0.0, tick_s)


def _done(known: Knowledge, state: InSitu, remark: str = "") -> Decision:
    end = "; ".join(why_not_settled(figures(state.trials))) or f"converged: {EXPLAINED}"
    words = "; ".join(filter(None, [in_words(state), end, remark]))
    return Decision(replace(known, in_situ=replace(state, finished=True)), None, words)


def in_words(state: InSitu) -> str:
    """The result of the last trial."""
    trials = figures(state.trials)
    first, last = trials[0], trials[-1]
    below = f", {last.below_db(first):.0f} dB below the first" if last.driven else ""
    return f"trial {last.number}: the actuator exerted {1e3 * last.with_noise_nm:.2f} mN*m{below}"


def _planned(options: InSituOptions, assembly: Assembly, known: Knowledge) -> InSitu:
    """With the greatest movement that the model allows; without a model, with a small one."""
    rig = known.rig
    if assembly.actuator is None:
        return InSitu(assembly, _command(options, rig, FIRST_SHARE), _order(options), sized=False)
    network, (low, high) = assembly.actuator.network, (0.0, 1.0)
    for _ in range(HALVINGS):
        half = 0.5 * (low + high)
        _, velocity, _ = network.free_motion(_command(options, rig, half), rig.tick_s, longest_step_s=rig.tick_s)
        low, high = (half, high) if np.max(np.abs(velocity)) <= _fastest_rad_s(options, rig) else (low, half)
    return InSitu(assembly, _command(options, rig, low), _order(options))


def _command(options: InSituOptions, rig: Rig, share: float) -> FloatArray:
    """The movement there and back, so that every trial begins at nearly the same position; ``share`` of the greatest.

    It is about the middle of the commands that may be chosen.
    """
    wave, (middle, reach) = _wave(options, rig.tick_s), _middle_and_reach(rig)
    rest = hold(0.0, max(REST_S, options.hold_s or 0.0), rig.tick_s)  # the last reach must end, too
    return np.asarray(middle + share * reach * np.concatenate([rest, wave, -wave, rest]))


def _middle_and_reach(rig: Rig) -> tuple[float, float]:
    """About what the commands move, and how far. What pushes or turns the shaft rests at zero alone."""
    lowest, highest = rig.command.span
    if not rig.may_be_a_spring:
        return 0.0, min(-lowest, highest)
    return 0.5 * (lowest + highest), 0.5 * (highest - lowest)


def _trial_s(ticks: int, rig: Rig) -> float:
    """How long a trial of so many ticks lasts at most, with what is before and after it."""
    return ticks * rig.tick_s + LEAD_S + SWING_S + REST_S + BACK_LASTS_S


def _wave(options: InSituOptions, tick_s: float) -> FloatArray:
    """One half of the movement, with a peak of no more than 1."""
    half_s = options.duration_s / 2
    if options.hold_s is None:
        return multisine(half_s, tick_s, low_hz=0.2, high_hz=options.highest_hz, seed=options.seed, slope=-0.25)
    levels = np.random.default_rng(options.seed).uniform(-1.0, 1.0, int(half_s / options.hold_s))
    return staircase(levels, options.hold_s, tick_s)


def _order(options: InSituOptions) -> tuple[bool, ...]:
    """Which trials are driven: chosen at random, except the first ones."""
    left = options.trials - len(FIRST)
    alone = max(1, round(options.left_alone * left))
    shuffled = np.random.default_rng(options.seed).permutation(left) >= alone
    return (*FIRST, *shuffled.tolist())
