"""The static source: the rest position of the free port under each command (paper, section IV.B.1)."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError, RigError
from norton_bench.identification.averages import velocity_of
from norton_bench.identification.source_table import LEAVE
from norton_bench.procedures.knowledge import Knowledge, Plan, require_load
from norton_bench.procedures.options import TabulateSourceOptions
from norton_bench.procedures.waves import coasting, hold, ramp, zero_torque
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import READ, TABULATE_SOURCE, Segment, Use

MOVE_S = 0.5
PIECE_S = 0.25
# A shaft that reaches this share of the velocity limit does not come to rest.
RUNS_SHARE = 0.5
# Fewer ticks give no velocity.
LEAST_READINGS = 3

# Makes a segment of a name, a use and commands (ticks,).
Maker = Callable[[str, Use, FloatArray], Segment]


@dataclass(frozen=True)
class Patience:
    """Wait until the shaft is measured to be at rest, instead of for a fixed time.

    At rest means slower than ``below_rad_s``; the longest wait is ``at_most_s``.
    """

    below_rad_s: float
    at_most_s: float


def settle(
    make: Maker, known: Knowledge, start: float, stop: float, patience: Patience
) -> Generator[Segment, Measured, None]:
    """The command goes from ``start`` to ``stop``, and stays until the shaft rests, or the longest wait is over.

    Raises ExperimentError where the shaft runs away.
    """
    yield from _watched(make("move", Use.PREPARE, ramp(start, stop, MOVE_S, known.tick_s)), known)
    waited_s = 0.0
    while waited_s < patience.at_most_s:
        measured = yield from _watched(make("settle", Use.PREPARE, hold(stop, PIECE_S, known.tick_s)), known)
        motion = measured.motion
        if len(motion) >= LEAST_READINGS and abs(velocity_of(motion)) < patience.below_rad_s:
            return
        waited_s += PIECE_S


def _watched(segment: Segment, known: Knowledge) -> Generator[Segment, Measured, Measured]:
    """A segment that ends before the shaft becomes too fast."""
    fast_rad_s = RUNS_SHARE * known.rig.limits.velocity_rad_s
    measured = yield replace(segment, stop_at_velocity_rad_s=fast_rad_s)
    speeds_rad_s = np.abs(measured.ticks["velocity_rad_s"])
    if len(speeds_rad_s) < segment.ticks and float(np.max(speeds_rad_s, initial=0.0)) >= fast_rad_s:
        raise ExperimentError(
            f"{segment.procedure}: the shaft reached {fast_rad_s:g} rad/s under a command of {segment.command[-1]:.3g} "
            f"{known.rig.command.unit} with nothing at the port: its source may be a velocity, which the step 'free' "
            "measures; else narrow lowest and highest"
        )
    return measured


@dataclass(frozen=True)
class TabulateSourceProcedure:
    """Rising commands, then falling ones; each is held until the shaft rests, then the position is read.

    At the port of the actuator the torque is controlled to zero: the load drive moves the load. At the external port
    the load drive is off, and the actuator moves the load (section IV.C).
    """

    options: TabulateSourceOptions = field(default_factory=TabulateSourceOptions)
    name: ClassVar[str] = TABULATE_SOURCE

    def require(self, rig: Rig) -> None:
        if self.options.port == "external":
            require_load(rig, self.name, "which moves with the external port")
        if rig.wiring.load is None and rig.wiring.shaft != "free":
            raise RigError(
                f"{rig.place}: step '{self.name}' needs a shaft that can turn; [rig] shaft is \"{rig.wiring.shaft}\""
            )

    def duration_s(self, rig: Rig) -> float:
        each_s = MOVE_S + 0.5 * self.options.at_most_s + self.options.read_s
        return (2 * self.options.levels - 1) * each_s + MOVE_S

    def plan(self, known: Knowledge) -> Plan:
        options, before = self.options, 0.0
        make, patience = self._maker(known.rig), Patience(options.settled_rad_s, options.at_most_s)
        levels = levels_between(known.rig, options.lowest, options.highest, options.levels)
        for level in np.concatenate([levels, levels[-2::-1]]):
            yield from settle(make, known, before, level, patience)
            yield make(f"{READ} {options.port}", Use.IDENTIFY, hold(level, options.read_s, known.tick_s))
            before = level
        yield make(LEAVE, Use.PREPARE, ramp(before, 0.0, MOVE_S, known.tick_s))

    def conclude(self, known: Knowledge, measured: Measured) -> Knowledge:
        return known

    def _maker(self, rig: Rig) -> Maker:
        if self.options.port == "external":
            return partial(coasting, self.name)
        return partial(at_zero_torque, self.name, rig)


def at_zero_torque(procedure: str, rig: Rig, name: str, use: Use, command: FloatArray) -> Segment:
    """Zero torque at the port of the actuator."""
    return zero_torque(procedure, name, use, command, rig)


def levels_between(rig: Rig, lowest: float, highest: float, count: int) -> FloatArray:
    """Commands evenly spread between two shares of the greatest, as far as the rig allows; shape (count,)."""
    least, greatest = rig.command.span
    ends = np.clip(np.array([lowest, highest]) * rig.command.limit, least, greatest)
    return np.linspace(ends[0], ends[1], count)
