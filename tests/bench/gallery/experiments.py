"""The gallery's experiments as they are run, at one seed."""

from pathlib import Path

from bench.gallery.claim import Experiment
from bench.gallery.paper import measure, rigs_in

RIGS = Path(__file__).parents[3] / "rigs"


def measured(name: str, seed: int) -> Experiment:
    """Through frames and bytes: about a minute of bench time."""
    return measure(name, rigs_in(RIGS)[name], seed)
