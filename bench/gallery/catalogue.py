"""Which experiments there are, on which rigs, and what each of them shows."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bench.gallery import motor_claims
from bench.gallery.claim import Experiment, Shown
from bench.gallery.motor_experiments import FreeLevels, SlowStops, SteadySpeeds
from bench.procedures.calibrate import CalibrateProcedure
from bench.procedures.knowledge import Procedure
from bench.procedures.tare import TareProcedure


@dataclass(frozen=True)
class Entry:
    """The shipped rig's name, what is done on it, and the claims that follow."""

    rig: str
    procedures: tuple[Procedure, ...]
    claims: Callable[[Experiment], tuple[Shown, ...]]


CATALOGUE: Mapping[str, Entry] = {
    "motor": Entry(
        "sim-odrive",
        (TareProcedure(), CalibrateProcedure(), FreeLevels(), SteadySpeeds(), SlowStops()),
        motor_claims.claims,
    ),
}
