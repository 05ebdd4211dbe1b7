"""The gallery's experiments as they are run, at one seed, in fewer rounds."""

from norton_bench.gallery.claim import PaperExperiment
from norton_bench.gallery.gravity import TwoPorts
from norton_bench.gallery.motor_experiments import FreeLevels, SlowStops, SteadySpeeds
from norton_bench.gallery.muscle import MuscleSweeps
from norton_bench.gallery.paper import CATALOGUE, measure
from norton_bench.gallery.spring import MODULATIONS, TABULATION
from norton_bench.procedures.in_situ import InSituProcedure
from norton_bench.procedures.modulated import ModulatedProcedure
from norton_bench.procedures.options import InSituOptions
from tests.bench.half_rate import half_rate

SPRING = ModulatedProcedure(TABULATION, 3 * MODULATIONS)
# As few as still tell a plant from one that differs by what the tests have it differ.
FEWER = {
    "motor": (FreeLevels(rounds=4), SteadySpeeds(rounds=3), SlowStops()),
    "muscle": (MuscleSweeps(rounds=3),),
    "arms": (TwoPorts(rounds=3),),
    "spring": (SPRING,),
    "in situ": (InSituProcedure(InSituOptions(trials=7, duration_s=4.0)),),
}


def measured(name: str, seed: int) -> PaperExperiment:
    """Through frames and bytes, at half the rate: one to two minutes of bench time."""
    return measure(name, half_rate(CATALOGUE[name].rig), seed, FEWER.get(name))
