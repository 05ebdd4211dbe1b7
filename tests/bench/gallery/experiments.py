"""The gallery's experiments as they are run, at one seed, in fewer rounds."""

from pathlib import Path

from bench.gallery.claim import Experiment
from bench.gallery.gravity_experiments import TwoPorts
from bench.gallery.motor_experiments import FreeLevels, SlowStops, SteadySpeeds
from bench.gallery.muscle_experiments import MuscleSweeps
from bench.gallery.paper import measure, rigs_in

RIGS = Path(__file__).parents[3] / "rigs"
# As few as still tell a plant from one that differs by what the tests have it differ.
FEWER = {
    "motor": (FreeLevels(rounds=4), SteadySpeeds(rounds=3), SlowStops()),
    "muscle": (MuscleSweeps(rounds=3),),
    "arms": (TwoPorts(rounds=2),),
}


def measured(name: str, seed: int) -> Experiment:
    """Through frames and bytes: half a minute of bench time."""
    return measure(name, rigs_in(RIGS)[name], seed, FEWER.get(name))
