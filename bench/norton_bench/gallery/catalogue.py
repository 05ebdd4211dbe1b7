"""Which experiments there are, on which rigs, and what each of them shows."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from norton_bench.gallery import gravity_claims, in_situ_claims, motor_claims, muscle_claims, spring_claims
from norton_bench.gallery.claim import Experiment, Shown
from norton_bench.gallery.gravity_experiments import TwoPorts
from norton_bench.gallery.motor_experiments import FreeLevels, SlowStops, SteadySpeeds
from norton_bench.gallery.muscle_experiments import MuscleSweeps
from norton_bench.procedures.knowledge import Adaptive, Procedure


@dataclass(frozen=True)
class Entry:
    """The shipped rig's name, what is done on it once it is calibrated, and the claims that follow."""

    rig: str
    procedures: tuple[Procedure | Adaptive, ...]
    claims: Callable[[Experiment], tuple[Shown, ...]]


CATALOGUE: Mapping[str, Entry] = {
    "motor": Entry(
        "sim-odrive",
        (FreeLevels(), SteadySpeeds(), SlowStops()),
        motor_claims.claims,
    ),
    "muscle": Entry("sim-pneumatic", (MuscleSweeps(),), muscle_claims.claims),
    "arms": Entry("sim-gravity", (TwoPorts(),), gravity_claims.claims),
    "spring": Entry("sim-variable-stiffness", (spring_claims.EXPERIMENT,), spring_claims.claims),
    "in situ": Entry("sim-odrive", (in_situ_claims.EXPERIMENT,), in_situ_claims.claims),
}
