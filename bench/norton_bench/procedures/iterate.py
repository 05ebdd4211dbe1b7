"""Iterated zero torque: one movement is repeated, and the load torque learned until only noise is left.

Each trial is an ordinary procedure. The shaft moves back to its first position, always from the same side, so that
friction starts from the same state. Then the command runs with the learned load torque and without feedback, because
feedback would bring the noise of the sensor to the port. The correction is computed between trials, with idle drives.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.assembly import Machine
from norton_bench.identification.at_ticks import readings_at_ticks
from norton_bench.identification.trials import TRIAL, figures_of
from norton_bench.procedures.free import command_multisine
from norton_bench.procedures.knowledge import (
    Decision,
    Knowledge,
    Plan,
    refuse_servo,
    require_load,
    require_model,
    why_no_basis,
)
from norton_bench.procedures.learning import Iteration, Models, correction, next_load_torque
from norton_bench.procedures.options import IterateOptions
from norton_bench.procedures.waves import Motion, coasting, from_velocity, hold, imposed, pushed
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use

REST_S = 0.3  # the pause before and after the movement, and to read the position of the shaft
# The way back: its speed as a share of the velocity limit, and its last part, longer than any friction contact.
BACK_SHARE = 0.4
LEAST_BACK_S = 0.3
LAST_RAD = 0.1


@dataclass(frozen=True, eq=False)
class MovementTrial:
    """One movement; ``load_torque_nm`` (ticks,) is what the load drive does meanwhile."""

    number: int
    command: FloatArray
    load_torque_nm: FloatArray
    start_rad: float
    models: Models
    name: ClassVar[str] = "iterate_zero_torque"

    def require(self, rig: Rig) -> None:
        """Checked before the first."""

    def duration_s(self, rig: Rig) -> float:
        return len(self.command) * rig.tick_s + 2 * REST_S + 2 * LEAST_BACK_S

    def plan(self, known: Knowledge) -> Plan:
        measured = yield coasting(self.name, "look", Use.PREPARE, hold(0.0, REST_S, known.tick_s))
        away_rad = self.start_rad - float(measured.ticks["load_position_rad"][-1])
        for name, way_rad in (("back", away_rad - LAST_RAD), ("last piece", LAST_RAD)):
            motion = way(way_rad, BACK_SHARE * known.rig.limits.velocity_rad_s, known.tick_s)
            yield imposed(self.name, name, Use.PREPARE, np.zeros(len(motion.position_rad)), motion)
        yield coasting(self.name, "settle", Use.PREPARE, hold(0.0, REST_S, known.tick_s))
        yield pushed(self.name, f"{TRIAL}{self.number}", Use.IDENTIFY, self.load_torque_nm, self.command)

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        before, tick_s = known.iteration, known.tick_s
        assert before is not None
        motion = readings_at_ticks(measured, measured.segments[-1], len(self.command), tick_s)
        assert motion.torque_nm is not None
        learned = correction(self.models, self.command, self.load_torque_nm, motion, motion.torque_nm, tick_s)
        figures = figures_of(self.number, motion.torque_nm, motion.torque_noise_nm, tick_s)
        return replace(known, iteration=before.after(figures, learned))


@dataclass(frozen=True)
class IterateProcedure:
    """Repeats trials until only noise is left, until their number is reached, or until they do not converge."""

    options: IterateOptions = field(default_factory=IterateOptions)
    name: ClassVar[str] = MovementTrial.name

    def require(self, rig: Rig) -> None:
        require_model(rig, self.name)
        refuse_servo(rig, self.name)
        require_load(rig, self.name, "to go along with the actuator")

    def duration_s(self, rig: Rig) -> float:
        return self.options.trials * (self.options.duration_s + 4 * REST_S + 2 * LEAST_BACK_S)

    def following(self, known: Knowledge) -> Decision:
        so_far = known.iteration
        if so_far is None or so_far.finished:
            so_far = Iteration(self._command(known), _stands_rad(known))
        fault = _no_basis(known)
        if fault is not None:
            return _done(known, so_far.ended(fault))
        if so_far.settled and (so_far.averaged or len(so_far.trials) >= self.options.trials):
            return _done(known, so_far.ended())
        if so_far.diverges:
            reason = "it does not converge: two trials in a row were worse than one before them"
            return _done(known, so_far.ended(reason))
        if len(so_far.trials) >= self.options.trials:
            reason = f"after {len(so_far.trials)} trials more than noise is left"
            return _done(known, so_far.ended(reason))
        return _next(known, so_far)

    def _command(self, known: Knowledge) -> FloatArray:
        options = self.options
        wave = command_multisine(known, known.span(), options.duration_s, options.seed, options.highest_hz)
        rest = hold(0.0, REST_S, known.tick_s)
        return np.concatenate([rest, wave, rest])


def way(distance_rad: float, fastest_rad_s: float, tick_s: float) -> Motion:
    """From rest to rest over ``distance_rad``, at no more than ``fastest_rad_s``."""
    duration_s = max(2 * abs(distance_rad) / fastest_rad_s, LEAST_BACK_S)
    phase = np.arange(1, round(duration_s / tick_s) + 1) * (2 * np.pi * tick_s / duration_s)
    return from_velocity(distance_rad / duration_s * (1 - np.cos(phase)), tick_s)


def _next(known: Knowledge, so_far: Iteration) -> Decision:
    assert known.actuator is not None
    assert known.calibration is not None
    models = Models(Machine.of_fit(known.actuator), Machine.of_load(known.calibration))
    number = len(so_far.trials) + 1
    load_torque_nm = np.zeros(len(so_far.command))
    if so_far.trials:
        noise_nm = known.calibration.torque_noise_nm
        load_torque_nm = next_load_torque(models, so_far.command, so_far.corrections, noise_nm, known.tick_s)
    trial = MovementTrial(number, so_far.command, load_torque_nm, so_far.start_rad, models)
    return Decision(replace(known, iteration=so_far), trial, _sentence(so_far))


def _sentence(so_far: Iteration) -> str:
    if not so_far.trials:
        return "trial 1: the load not driven, for comparison"
    return f"{in_words(so_far)}; trial {len(so_far.trials) + 1} with the learned load torque"


def in_words(so_far: Iteration) -> str:
    """The result of the last trial."""
    first, last = so_far.trials[0], so_far.trials[-1]
    floor = ", the noise floor" if last.at_floor else ""
    below = f", {last.below_db(first):.0f} dB below the first{floor}" if last is not first else ""
    return f"trial {last.number}: {1e3 * last.with_noise_nm:.2f} mN*m at the port{below}"


def _done(known: Knowledge, so_far: Iteration) -> Decision:
    end = "converged" if so_far.converged else "; ".join(so_far.reasons)
    said = "; ".join([in_words(so_far), end]) if so_far.trials else end
    return Decision(replace(known, iteration=so_far), None, said)


def _no_basis(known: Knowledge) -> str | None:
    assert known.actuator is not None
    fault = why_no_basis(known.actuator, "the actuator in its calibration")
    return None if fault is None else f"no load torque can be learned: {fault}"


def _stands_rad(known: Knowledge) -> float:
    position_rad = known.records[-1].ticks["load_position_rad"]
    return float(position_rad[np.isfinite(position_rad)][-1])
