"""A command held until the shaft is seen to rest, rather than for a time after which it should."""

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.tables.means import velocity_of
from norton_bench.procedures.knowledge import Knowledge
from norton_bench.procedures.waves import hold, ramp
from norton_bench.records import Measured
from norton_bench.segments import Segment, Use

MOVE_S = 0.5
PIECE_S = 0.25
# A shaft that reaches this share of the velocity limit does not come to rest.
RUNS_SHARE = 0.5
# Fewer tell no velocity.
LEAST_READINGS = 3

# Makes a segment of a name, a use and commands (ticks,).
Maker = Callable[[str, Use, FloatArray], Segment]


@dataclass(frozen=True)
class Patience:
    """The shaft rests once it moves more slowly than ``below_rad_s``; ``at_most_s`` is waited for that."""

    below_rad_s: float
    at_most_s: float


def settle(
    make: Maker, known: Knowledge, start: float, stop: float, patience: Patience
) -> Generator[Segment, Measured, None]:
    """The command goes from ``start`` to ``stop``, and stays until the shaft rests, or nobody waits any longer.

    Raises ExperimentError where it runs instead.
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
    """A segment that ends before the shaft has gained too much speed."""
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
