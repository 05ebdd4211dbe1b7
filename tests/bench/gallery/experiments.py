"""The gallery's experiments as they are run, at one seed, in fewer rounds and with less waiting."""

from collections.abc import Sequence
from functools import partial

import pytest

from norton_bench.gallery import gravity, muscle, paper
from norton_bench.gallery.claim import PaperExperiment
from norton_bench.gallery.dynamic_source import SwungCommand
from norton_bench.gallery.gravity import TwoPorts
from norton_bench.gallery.impedances import PortImpedances
from norton_bench.gallery.motor_experiments import FreeLevels, SameDeviation, SlowStops, SteadySpeeds
from norton_bench.gallery.muscle import MuscleSweeps
from norton_bench.gallery.paper import CATALOGUE, measure
from norton_bench.gallery.spring import MODULATIONS, TABULATION, MovingSource
from norton_bench.procedures import modulated
from norton_bench.procedures.calibrate import CalibrateProcedure
from norton_bench.procedures.in_situ import InSituProcedure
from norton_bench.procedures.knowledge import Adaptive, Procedure
from norton_bench.procedures.modulated import ModulatedProcedure
from norton_bench.procedures.options import CalibrateOptions, InSituOptions, TareOptions
from norton_bench.procedures.tare import TareProcedure
from tests.bench.half_rate import low_rate

SPRING = ModulatedProcedure(TABULATION, 3 * MODULATIONS)
# As few as still tell a plant from one that differs by what the tests have it differ.
FEWER = {
    "motor": (FreeLevels(rounds=4), SteadySpeeds(rounds=3), SameDeviation(rounds=4), SlowStops()),
    "muscle": (MuscleSweeps(rounds=3), SwungCommand(rounds=3)),
    "arms": (TwoPorts(rounds=3), PortImpedances(rounds=3)),
    "spring": (SPRING, MovingSource(rounds=3)),
    "in situ": (InSituProcedure(InSituOptions(trials=7, duration_s=2.5)),),
}
# The ways are quicker, and the waiting shorter: each row's interval, from its own repetitions, tells what that costs.
QUICKER = (
    (gravity, {"FORGET_S": 2.5, "SPEED_RAD_S": 1.0, "EASING_S": 0.6, "SETTLE_S": 0.6, "LEAVE_S": 0.5}),
    (muscle, {"SPEED_RAD_S": 0.6, "REFERENCES": 3}),
    (modulated, {"RAMP_S": 0.5}),
    (paper, {"TareProcedure": partial(TareProcedure, TareOptions(duration_s=0.5))}),
    (paper, {"CalibrateProcedure": partial(CalibrateProcedure, CalibrateOptions(duration_s=4.0))}),
)


def measured(name: str, seed: int, procedures: Sequence[Procedure | Adaptive] = ()) -> PaperExperiment:
    """Through frames and bytes, at a low rate: a minute and a half of bench time, or ``procedures`` alone."""
    with pytest.MonkeyPatch.context() as patch:
        for module, constants in QUICKER:
            for constant, value in constants.items():
                patch.setattr(module, constant, value)
        return measure(name, low_rate(CATALOGUE[name].rig), seed, procedures or FEWER.get(name))
