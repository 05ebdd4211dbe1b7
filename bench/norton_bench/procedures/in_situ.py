"""In situ (paper, sections V and VI.E): the motion source of an actuator that stays assembled to its load.

The assembly is shaken first, to identify load and actuator separately. Then one movement is repeated. In most trials
the load drive gives the load the torque that it needs to follow, so that the actuator exerts no torque and its motion
is the motion source. In some trials, chosen at random, the load is not driven; they show the scatter of movements. The
torque of the actuator is computed from the motion and the load; no torque sensor is used. Between trials the drives
are idle.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError, RigError
from norton_bench.identification.in_situ import (
    IN_SITU,
    Exerted,
    Machine,
    Trial,
    actuator_behind,
    figures,
    load_by_twist,
    why_not_settled,
)
from norton_bench.identification.trials import TRIAL, diverge, settled
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import HALF_INTERVAL
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.knowledge import Decision, Knowledge, Plan, refuse_servo, why_no_basis
from norton_bench.procedures.learning import Assembly, InSitu, Models, correction, next_load_torque
from norton_bench.procedures.options import CalibrateOptions, InSituOptions
from norton_bench.procedures.waves import coasting, hold, multisine, pushed, ramp
from norton_bench.records import LOAD_TAKEN, Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

REST_S = 0.3
# Before each trial the load is pushed this many times harder than its friction, with ramps of this duration.
PUSH, PUSH_S = 2.0, 0.1
# The first trial is not driven, for comparison; the first two driven ones show whether the trials converge.
FIRST = (False, True, True)
SCALINGS = 20
# A given inertia of the load is ignored if it differs from the measured one by more than both of these.
DEVIATIONS, SHARE = 3.0, 0.01


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
        load, said = _load(known, measured, self.options)
        actuator = actuator_behind(measured, load, known.tick_s, known.rig.command.unit)
        fault = why_no_basis(actuator, "the actuator behind its load")
        if fault is not None:
            raise ExperimentError(f"in_situ: {fault}; shake it more, or see that the load drive's torque moves it")
        models = Models(Machine.of_fit(actuator), load)
        return replace(known, in_situ=_planned(self.options, Assembly(models, said), known))

    def recorded_event(self, known: Knowledge) -> tuple[str, str]:
        """The load's values."""
        assert known.in_situ is not None
        return LOAD_TAKEN, known.in_situ.load.as_text()


@dataclass(frozen=True, eq=False)
class InSituTrial:
    """One trial; ``load_torque_nm`` (ticks,) is zero where the load is left alone."""

    number: int
    driven: bool
    load_torque_nm: FloatArray
    state: InSitu
    name: ClassVar[str] = Shake.name

    def require(self, rig: Rig) -> None:
        """Checked before the first."""

    def duration_s(self, rig: Rig) -> float:
        return len(self.load_torque_nm) * rig.tick_s + REST_S + 2 * PUSH_S

    def plan(self, known: Knowledge) -> Plan:
        yield pushed(self.name, "same past", Use.PREPARE, self._push_nm(known.tick_s))
        yield coasting(self.name, "settle", Use.PREPARE, hold(0.0, REST_S, known.tick_s))
        yield pushed(self.name, f"{TRIAL}{self.number}", Use.PREPARE, self.load_torque_nm, self.state.command)

    def _push_nm(self, tick_s: float) -> FloatArray:
        """A push that bends both friction contacts to the same side, so that every trial starts from the same state."""
        assert self.state.assembly is not None
        models = self.state.assembly.models
        coulomb_nm = sum(each.network.coulomb_torque_nm for each in (models.actuator, models.load))
        top_nm = PUSH * coulomb_nm / models.load.network.torque_gain
        return np.concatenate([ramp(0.0, top_nm, PUSH_S, tick_s), ramp(top_nm, 0.0, PUSH_S, tick_s)])

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        before, tick_s = self.state, known.tick_s
        assert before.assembly is not None
        trial = Trial.of(measured, measured.segments[-1], before.load, tick_s)
        taught = correction(
            before.assembly.models, before.command, trial.load_torque_nm, trial.seen, trial.torque_nm, tick_s
        )
        exerted = Exerted.of(self.number, self.driven, trial, tick_s)
        after = replace(before, trials=(*before.trials, exerted), corrections=(*before.corrections, taught))
        return replace(known, in_situ=after)


@dataclass(frozen=True)
class InSituProcedure:
    """Shakes once, then repeats trials until only the scatter of movements is left, or until trials do not help."""

    options: InSituOptions = field(default_factory=InSituOptions)
    name: ClassVar[str] = Shake.name

    def require(self, rig: Rig) -> None:
        refuse_servo(rig, self.name)
        if rig.wiring.load is None:
            raise RigError(
                f"{rig.place}: step 'in_situ' needs a load drive to give the load what it needs; "
                "add a [load] section or leave the step out"
            )

    def duration_s(self, rig: Rig) -> float:
        trial_s = self.options.duration_s + 3 * REST_S
        return _shaking(self.options).duration_s(rig) + self.options.trials * trial_s

    def following(self, known: Knowledge) -> Decision:
        state = known.in_situ
        if state is None or state.finished:
            sentence = "the assembly is shaken, to identify load and actuator separately"
            return Decision(replace(known, in_situ=None), Shake(self.options), sentence)
        trials = figures(state.trials)
        if settled(trials) or diverge(trials) or len(trials) >= self.options.trials:
            return _done(known, state)
        return _next(known, state)


def _next(known: Knowledge, state: InSitu) -> Decision:
    assert state.assembly is not None
    number = len(state.trials) + 1
    driven = state.order[number - 1]
    load_torque_nm = np.zeros(len(state.command))
    if driven:
        models = state.assembly.models
        load_torque_nm = next_load_torque(models, state.command, state.corrections, 0.0, known.tick_s)
    how = "with the load driven" if driven else "with the load not driven"
    before = in_words(state) if state.trials else "; ".join(state.assembly.said)
    return Decision(known, InSituTrial(number, driven, load_torque_nm, state), f"{before}; trial {number} {how}")


def _done(known: Knowledge, state: InSitu) -> Decision:
    end = (
        "; ".join(why_not_settled(figures(state.trials)))
        or "converged: what is left is no more than the scatter of movements"
    )
    return Decision(replace(known, in_situ=replace(state, finished=True)), None, f"{in_words(state)}; {end}")


def in_words(state: InSitu) -> str:
    """The result of the last trial."""
    trials = figures(state.trials)
    first, last = trials[0], trials[-1]
    below = f", {last.below_db(first):.0f} dB below the first" if last.driven else ""
    return f"trial {last.number}: the actuator exerted {1e3 * last.with_noise_nm:.2f} mN*m{below}"


def _planned(options: InSituOptions, assembly: Assembly, known: Knowledge) -> InSitu:
    """The movement there and back, so that every trial begins at nearly the same position."""
    half_s = options.duration_s / 2
    wave = multisine(half_s, known.tick_s, low_hz=0.2, high_hz=options.highest_hz, seed=options.seed, slope=-0.25)
    rest = hold(0.0, REST_S, known.tick_s)
    command = np.concatenate([rest, wave, -wave, rest])
    fastest_rad_s = options.amplitude * known.rig.limits.velocity_rad_s
    scale = _scale(assembly.models.actuator.network, command, fastest_rad_s, known)
    return InSitu(assembly, scale * command, _order(options))


def _order(options: InSituOptions) -> tuple[bool, ...]:
    """Which trials are driven: chosen at random, except the first ones."""
    left = options.trials - len(FIRST)
    alone = max(1, round(options.left_alone * left))
    shuffled = np.random.default_rng(options.seed).permutation(left) >= alone
    return (*FIRST, *shuffled.tolist())


def _scale(network: NortonNetwork, command: FloatArray, fastest_rad_s: float, known: Knowledge) -> float:
    """The greatest scale of the command, up to the rig's limit, with the predicted source within ``fastest_rad_s``."""
    low, high = 0.0, known.rig.command.limit
    for _ in range(SCALINGS):
        middle = 0.5 * (low + high)
        _, velocity, _ = network.free_motion(middle * command, known.tick_s, longest_step_s=known.tick_s)
        low, high = (middle, high) if np.max(np.abs(velocity)) <= fastest_rad_s else (low, middle)
    return low


def _load(known: Knowledge, measured: Measured, options: InSituOptions) -> tuple[Machine, tuple[str, ...]]:
    """The load: from the twist between the encoders if that is precise enough, else from calibration and options.

    Raises ExperimentError where the data do not separate it from the actuator.
    """
    # The scale of the torque sensor, by which it was calibrated, differs from that of the load's drive.
    calibrated = None if known.calibration is None else Machine.of_load(known.calibration).in_drive_units()
    try:
        by_twist = load_by_twist(measured, known.tick_s)
    except ExperimentError as error:
        if calibrated is None:
            raise ExperimentError(
                "in_situ: load and actuator cannot be separated: the coupling twists too little for their "
                "encoders; run the step 'calibrate' with a torque sensor before it, or join them less stiffly"
            ) from error
        assumed = _with(calibrated, options)
        sentence = (
            f"the load's inertia is assumed to be {_kgm2(assumed)} and cannot be checked, because the coupling twists"
        )
        return assumed, (f"{sentence} too little; an error of it is an error of the source, too",)
    if by_twist.weight_nm > 0.0:
        raise ExperimentError(
            f"in_situ: an arm hangs on the load, with a torque of up to {by_twist.weight_nm:.3g} N*m by position; the "
            "step supplies inertia and friction alone: take the arm off, balance it, or stand its axis upright"
        )
    calibrated_nms_rad = None if calibrated is None else calibrated.network.viscous_damping_nms_rad
    return _by_twist(by_twist.machine, by_twist.inertia_deviation, calibrated_nms_rad, options)


def _by_twist(
    machine: Machine, deviation: float, calibrated_nms_rad: float | None, options: InSituOptions
) -> tuple[Machine, tuple[str, ...]]:
    half = 100 * HALF_INTERVAL * deviation
    sentences = [f"the load's inertia is {_kgm2(machine)} ±{half:.1f} %, by the twist between the encoders"]
    given_kgm2 = options.inertia_kgm2
    if given_kgm2 is not None:
        off = given_kgm2 / machine.network.inertia_kgm2 - 1.0
        if abs(off) > max(DEVIATIONS * deviation, SHARE):
            sentences.append(f"the given value {given_kgm2:.3g} kg*m^2 differs by {100 * off:+.0f} %, and is ignored")
    viscous_nms_rad = options.viscous_damping_nms_rad
    if viscous_nms_rad is None:
        viscous_nms_rad = calibrated_nms_rad
    if viscous_nms_rad is None:
        sentences.append("its viscous damping is computed as if both encoders were read at the same instant")
        return machine, tuple(sentences)
    network = replace(machine.network, viscous_damping_nms_rad=viscous_nms_rad)
    return replace(machine, network=network), tuple(sentences)


def _with(machine: Machine, options: InSituOptions) -> Machine:
    """The machine with the values given in the options."""
    network = machine.network
    if options.inertia_kgm2 is not None:
        network = replace(network, inertia_kgm2=options.inertia_kgm2)
    if options.viscous_damping_nms_rad is not None:
        network = replace(network, viscous_damping_nms_rad=options.viscous_damping_nms_rad)
    return replace(machine, network=network)


def _kgm2(machine: Machine) -> str:
    return f"{machine.network.inertia_kgm2:.4g} kg*m^2"
