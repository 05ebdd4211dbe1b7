"""A dry run: every step is checked against the rig, with its greatest commands and its duration, before anything runs.

No port is opened and nothing is simulated. The plans of the steps get made-up measurements, chosen so that the plans
become as large as they can. What depends on real measurements is left to the guard during the session.
"""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from math import inf

import numpy as np

from norton_bench.errors import RigError
from norton_bench.events import PlannedStep, Prompt
from norton_bench.procedures.knowledge import Adaptive, Knowledge, Procedure
from norton_bench.records import NO_DEVICE_TIME, TICK, TORQUE, Measured, SegmentInfo
from norton_bench.rig.rig import Rig
from norton_bench.segments import Segment
from norton_bench.session.items import Session
from norton_bench.session.program import Made, make_program, rehearsed
from norton_bench.session.script import Ask
from norton_drivers.registry import load_backend

# Limits are written in decimal.
ROUNDING = 1.0 + 1e-9


@dataclass(frozen=True)
class Peaks:
    """The greatest values that a step commands: the command in its unit; torque, velocity and travel of the load."""

    command: float = 0.0
    load_torque_nm: float = 0.0
    velocity_rad_s: float = 0.0
    travel_rad: float = 0.0

    def or_greater(self, other: "Peaks") -> "Peaks":
        return Peaks(*(max(own, its) for own, its in zip(self.all(), other.all(), strict=True)))

    def all(self) -> tuple[float, float, float, float]:
        return self.command, self.load_torque_nm, self.velocity_rad_s, self.travel_rad


@dataclass(frozen=True)
class DryStep:
    """One step of the plan: its latest begin [s of bench time], and the greatest values that it commands.

    ``segments`` is the number of its segments, 0 for an adaptive step.
    """

    planned: PlannedStep
    begins_s: float
    segments: int
    peaks: Peaks


@dataclass(frozen=True)
class DryRun:
    """All steps, as if every condition held, and the prompts to the operator."""

    steps: tuple[DryStep, ...]
    prompts: tuple[Prompt, ...]

    @property
    def at_most_s(self) -> float:
        return sum(step.planned.duration_s for step in self.steps)

    @property
    def at_least_s(self) -> float:
        return sum(step.planned.duration_s for step in self.steps if step.planned.certain)


def dry_run(session: Session, rig: Rig, *, seed: int | None = None) -> DryRun:
    """Raises RigError, UsageError and WiringError as the session would; and RigError where a step exceeds a limit."""
    program = make_program(session, rig)
    _check_simulated(session, rig, seed)
    every = list(program.every_turn())
    asked = {action: _asked(action, rig) for action in {made.action for made in every} if not isinstance(action, Ask)}
    problems = [
        f"{_place(session, made)}: {problem}"
        for made in every
        if not isinstance(made.action, Ask)
        for problem in beyond(asked[made.action][1], rig)
    ]
    if problems:
        raise RigError("\n".join(dict.fromkeys(problems)))
    steps, begins_s = [], 0.0
    for planned, made in zip(program.plan, every, strict=True):
        segments, peaks = (0, Peaks()) if isinstance(made.action, Ask) else asked[made.action]
        steps.append(DryStep(planned, begins_s, segments, peaks))
        begins_s += planned.duration_s
    prompts = dict.fromkeys(made.action.prompt for made in every if isinstance(made.action, Ask))
    return DryRun(tuple(steps), tuple(prompts))


def _check_simulated(session: Session, rig: Rig, seed: int | None) -> None:
    """Check what a simulation reads before it starts: its true values, and the faults."""
    with closing(load_backend(rig.backend)(rig.wiring, rig.simulated, seed=seed, place=rig.place)) as backend:
        rehearsed(session, backend)


def _asked(action: Procedure | Adaptive, rig: Rig) -> tuple[int, Peaks]:
    if isinstance(action, Adaptive):  # the velocities that the step chooses keep to the limits
        return 0, Peaks()
    segments = tuple(segments_of(action, Knowledge(rig)))
    return len(segments), peaks_of(segments)


def _place(session: Session, made: Made) -> str:
    where = f"[{made.step.where}]" if made.step.where else f"step {made.index + 1} '{made.step.do}'"
    return f"{session.place}: {where}"


def segments_of(procedure: Procedure, known: Knowledge) -> Iterator[Segment]:
    """All segments of its plan, with every search going on to its end."""
    plan = procedure.plan(known)
    segment = next(plan, None)
    while segment is not None:
        yield segment
        try:
            segment = plan.send(pretended(segment, known.tick_s))
        except StopIteration:
            return


def pretended(segment: Segment, tick_s: float) -> Measured:
    """A made-up measurement: a shaft that turns as it is pushed, and a sensor that measures the push."""
    ticks = np.zeros(segment.ticks, TICK)
    ticks["tick_ns"] = np.round(np.arange(segment.ticks) * tick_s * 1e9)
    ticks["command"] = segment.command
    ticks["modulation"] = segment.modulation if len(segment.modulation) else 0.0
    load_nm = segment.load_torque_nm if len(segment.load_torque_nm) else np.zeros(segment.ticks)
    ticks["load_torque_nm"] = load_nm
    pushed = segment.stop_at_velocity_rad_s < inf
    direction = float(np.sign(segment.command[-1] or load_nm[-1] or 1.0))
    ticks["velocity_rad_s"] = direction * segment.stop_at_velocity_rad_s if pushed else 0.0
    ticks["position_rad"] = ticks["load_position_rad"] = direction * np.arange(segment.ticks) * tick_s
    torque = np.zeros(segment.ticks, TORQUE)
    torque["arrival_ns"], torque["device_ns"], torque["valid"] = ticks["tick_ns"], NO_DEVICE_TIME, True
    torque["torque_nm"] = segment.command - load_nm
    info = SegmentInfo(
        0, segment.procedure, segment.name, segment.use, segment.mode.value, 0, int(ticks["tick_ns"][-1]) + 1
    )
    return Measured(ticks=ticks, torque=torque, segments=(info,))


def peaks_of(segments: tuple[Segment, ...]) -> Peaks:
    """The greatest values of all segments in sequence; an imposed motion begins where the last one ended."""
    peaks, stands_rad = Peaks(), 0.0
    for segment in segments:
        position_rad = segment.position_rad
        if len(position_rad):
            reached_rad = stands_rad + position_rad
            stands_rad = float(reached_rad[-1])
        else:
            reached_rad, stands_rad = np.zeros(1), 0.0  # where it coasts to is not known beforehand
        peaks = peaks.or_greater(
            Peaks(
                _peak(segment.command), _peak(segment.load_torque_nm), _peak(segment.velocity_rad_s), _peak(reached_rad)
            )
        )
    return peaks


def beyond(peaks: Peaks, rig: Rig) -> Iterator[str]:
    """A sentence for each limit of the rig that is exceeded, with the remedy."""
    limits, unit = rig.limits, rig.command.unit
    for asked, allowed, words, key, unit_text in (
        (peaks.command, rig.command.limit, "commands", "[actuator] command", unit),
        (peaks.load_torque_nm, limits.load_torque_nm, "loads with", "[limits] load torque", "N*m"),
        (peaks.velocity_rad_s, limits.velocity_rad_s, "turns the shaft at", "[limits] velocity", "rad/s"),
        (peaks.travel_rad, limits.position_rad, "turns the shaft as far as", "[limits] position", "rad"),
    ):
        if asked > allowed * ROUNDING:
            yield f"{words} {asked:.3g} {unit_text}, but {key} is {allowed:g} {unit_text}; ask for less, or raise it"


def _peak(values: np.ndarray) -> float:
    return float(np.max(np.abs(values), initial=0.0))
