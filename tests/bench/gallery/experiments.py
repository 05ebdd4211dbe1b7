"""The gallery's experiments as they are run, at one seed, in fewer rounds."""

from bench.gallery.catalogue import CATALOGUE
from bench.gallery.claim import Experiment
from bench.gallery.gravity_experiments import TwoPorts
from bench.gallery.motor_experiments import FreeLevels, SlowStops, SteadySpeeds
from bench.gallery.muscle_experiments import MuscleSweeps
from bench.gallery.paper import measure
from bench.rig.load import load_rig
from tests.bench.half_rate import RIGS, half_rate

# As few as still tell a plant from one that differs by what the tests have it differ.
FEWER = {
    "motor": (FreeLevels(rounds=4), SteadySpeeds(rounds=3), SlowStops()),
    "muscle": (MuscleSweeps(rounds=3),),
    "arms": (TwoPorts(rounds=3),),
}
SLOW = ("muscle", "spring", "in situ")


def measured(name: str, seed: int) -> Experiment:
    """Through frames and bytes: half a minute of bench time."""
    rig_name = CATALOGUE[name].rig
    rig = half_rate(rig_name) if name in SLOW else load_rig(RIGS / f"{rig_name}.toml", backend="simulated")
    return measure(name, rig, seed, FEWER.get(name))
