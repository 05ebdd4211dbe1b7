"""A step under modulations: each of its segments held there, ramps between them, and what a rig cannot do refused."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from norton_bench.errors import RigError
from norton_bench.procedures.imposed import ImposedProcedure
from norton_bench.procedures.iterate import IterateProcedure
from norton_bench.procedures.knowledge import Adaptive, Knowledge
from norton_bench.procedures.modulated import RAMP_S, ModulatedProcedure, modulated
from norton_bench.procedures.options import RestOptions, TabulateImpedanceOptions
from norton_bench.procedures.tabulate_impedance import TabulateImpedanceProcedure
from norton_bench.procedures.tare import RestProcedure
from norton_bench.rig.load import load_rig
from norton_bench.session.dry_run import segments_of

RIGS = Path(__file__).parents[3] / "rigs"
RIG = load_rig(RIGS / "sim-variable-stiffness.toml")


def test_every_segment_is_held_at_its_modulation_and_ramps_lead_between_them():
    inner = TabulateImpedanceProcedure(TabulateImpedanceOptions(commands=1, steps=1, shake_rad=0.0))
    procedure = ModulatedProcedure(inner, (1.0, 3.0))
    segments = list(segments_of(procedure, Knowledge(RIG)))
    alone = list(segments_of(inner, Knowledge(RIG)))
    assert len(segments) == 2 * len(alone) + 3
    modulation = np.concatenate([segment.modulation for segment in segments])
    assert len(modulation) == sum(segment.ticks for segment in segments)
    assert modulation[0] == pytest.approx(0.0, abs=1e-3)
    assert modulation[-1] == 0.0
    assert np.abs(np.diff(modulation)).max() < 3.5 / (RAMP_S * 1e3) * np.pi / 2  # nowhere a step
    held = [segment for segment in segments if segment.name != "modulate"]
    assert [float(np.ptp(segment.modulation)) for segment in held] == [0.0] * len(held)
    assert [float(segment.modulation[0]) for segment in held] == [1.0] * len(alone) + [3.0] * len(alone)
    for first, second in zip(held, [*alone, *alone], strict=True):
        assert np.array_equal(first.command, second.command)


def test_the_actuators_command_goes_back_to_zero_before_the_next_modulation():
    """A plan that ends under a command."""
    segments = list(segments_of(ModulatedProcedure(ImposedProcedure(), (1.0, 2.0)), Knowledge(RIG)))
    for before, way in pairwise(segments):
        if way.name == "modulate":
            assert way.command[0] == pytest.approx(before.command[-1], abs=2e-3)
            assert way.command[-1] == 0.0


def test_it_takes_as_long_as_it_says():
    inner = RestProcedure(RestOptions(duration_s=2.0))
    procedure = ModulatedProcedure(inner, (0.0, 1.0, 2.0))
    ticks = sum(segment.ticks for segment in segments_of(procedure, Knowledge(RIG)))
    assert procedure.duration_s(RIG) == pytest.approx(ticks * 1e-3)
    assert procedure.name == "rest"


def test_a_step_that_is_decided_as_it_goes_is_modulated_in_each_of_its_parts():
    steps = modulated(IterateProcedure(), (2.0,))
    assert isinstance(steps, Adaptive)
    assert steps.name == IterateProcedure.name
    assert steps.duration_s(RIG) == IterateProcedure().duration_s(RIG)


@pytest.mark.parametrize(
    ("rig", "modulation", "words"),
    [
        (load_rig(RIGS / "sim-series-elastic.toml"), 1.0, r"step 'rest' names a modulation, but no drive sets the "),
        (RIG, 4.5, r"step 'rest' asks for a modulation of 4.5 N\*m/rad, outside of \[modulator.command\] from 0 to 4 "),
        (RIG, -0.5, r"a modulation of -0.5 N\*m/rad, outside"),
    ],
)
def test_what_the_rig_cannot_do_is_refused_in_a_sentence(rig, modulation, words):
    with pytest.raises(RigError, match=words):
        modulated(RestProcedure(), (modulation,)).require(rig)


def test_what_the_step_itself_needs_is_still_needed():
    without = replace(RIG, wiring=replace(RIG.wiring, load=None))
    with pytest.raises(RigError, match="needs a load drive"):
        modulated(TabulateImpedanceProcedure(), (1.0,)).require(without)
