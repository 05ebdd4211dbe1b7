"""A variable-stiffness actuator through its own rig file: a session, short, and its steps at another seed."""

import json
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import pytest

from norton_bench.cli.output import to_json
from norton_bench.cli.results import identification
from norton_bench.identification.exertion_table import exertion_table
from norton_bench.identification.modulation import Modulated, modulated, modulator_places
from norton_bench.procedures.modulated import ModulatedProcedure
from norton_bench.procedures.options import (
    CalibrateOptions,
    RestOptions,
    TabulateImpedanceOptions,
    TabulateSourceOptions,
    TareOptions,
)
from norton_bench.procedures.tabulate_impedance import TabulateImpedanceProcedure
from norton_bench.procedures.tare import RestProcedure
from norton_bench.report.facts_tables import modulator_sentence
from norton_bench.result import Result
from norton_bench.session.conclusion import conclude_recording
from norton_bench.session.engine import record_procedures, run_session
from norton_bench.session.schema import Session, Step, WrittenFault
from norton_bench.units import Units
from norton_sim.truth import Truth, read_truth
from tests.bench.half_rate import low_rate

pytestmark = pytest.mark.long

RIG = low_rate("sim-variable-stiffness")
ENDS = ("0 N*m/rad", "4 N*m/rad")
SOURCE = TabulateSourceOptions(levels=2, lowest=0.0, highest=0.5, read_s=0.2)
IMPEDANCE = TabulateImpedanceOptions(
    commands=1, lowest=0.5, highest=0.5, steps=2, hold_s=0.3, shake_rad=0.0, sweep_rad_s=0.0
)
STEPS = (
    Step("tare", TareOptions(duration_s=0.5)),
    Step("calibrate", CalibrateOptions(duration_s=4.0)),
    Step("tabulate_impedance", IMPEDANCE, modulations=ENDS),
    Step("tabulate_source", SOURCE, modulations=ENDS),
)
SEEDS = (1, 2)


@cache
def result() -> Result:
    return run_session(RIG, Session(STEPS, "short"), out=Path(mkdtemp()), seed=SEEDS[0], live=False)


@cache
def found_on(seed: int) -> Modulated:
    """What a session concludes; at another seed, from its last step alone, on the bench that it has got to know."""
    source, exertion = result().source, result().exertion
    if seed != SEEDS[0]:
        again = ModulatedProcedure(TabulateImpedanceProcedure(IMPEDANCE), (0.0, 4.0))
        recorded = record_procedures(
            RIG, Session((), "again"), (again,), out=Path(mkdtemp()), known=result().knowledge, seed=seed, live=False
        )
        source, exertion = None, exertion_table(recorded.measured, RIG.tick_s)
    found = modulated(source, exertion)
    assert found is not None
    return found


def truth() -> Truth:
    return read_truth(
        RIG.simulated,
        seed=None,
        place=RIG.place,
        command_unit=RIG.command.unit,
        modulation_unit=RIG.wiring.modulation_unit,
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_stiffness_goes_with_the_modulation_as_the_closed_form_says(seed):
    true, found = truth(), found_on(seed)
    assert found.stiffens
    for row in found.stiffness:
        expected = true.actuator.port_stiffness_nm_rad(true.modulator.angle_rad(row.modulation))
        # Once more as wide: intervals cover 95 %, and these are from few places.
        assert row.stiffness.value == pytest.approx(expected, abs=2 * row.stiffness.half_width)
        assert row.stiffness.half_width < 0.1


@pytest.mark.parametrize("seed", SEEDS)
def test_the_source_stays_where_it_is(seed):
    shift = found_on(seed).shift
    assert shift is not None
    assert abs(shift.shift.value) < 2 * shift.shift.half_width < 3e-3


def test_exertion_is_told_by_command_modulation_and_displacement():
    true, told = truth(), json.loads(to_json(identification(result())))["tables"]
    for held in told["exertion"]["held"]:
        place_rad = true.actuator.source_rad(held["command"]) + held["displacement_rad"]
        angle_rad = true.modulator.angle_rad(held["modulation"])
        expected_nm = true.actuator.exertion_nm(held["command"], place_rad, angle_rad)
        friction_nm = true.actuator.motor.coulomb_torque_nm
        assert held["torque_nm"]["value"] == pytest.approx(expected_nm, abs=friction_nm + 2e-3)
    assert {row["modulation"] for row in told["source"]} == {0.0, 4.0}
    assert [row["modulation"] for row in told["modulation"]["stiffness"]] == [0.0, 4.0]
    assert told["modulation"]["stiffens"]


def test_a_recording_tells_the_same_again_and_the_report_says_it(tmp_path):
    again = conclude_recording(result().recording, tmp_path)
    assert again.source == result().source
    assert again.exertion == result().exertion
    page = again.report_file.read_text()
    assert "What the modulation changes" in page
    assert "The modulation changes the impedance: from 0 to 4.00 N·m/rad the stiffness at the source goes from" in page
    assert "The modulation does not move the source: the largest difference" in page
    assert "modulation [N·m/rad]" in page
    assert "modulator motion" in page


def test_its_second_drive_went_where_it_was_sent_and_the_result_says_so():
    found = result().modulator
    assert found is not None
    assert found.followed
    travel = truth().modulator.angle_rad
    for stood in found.stood:
        assert len(stood.places_rad) >= 2
        assert stood.places_rad == pytest.approx([travel(stood.modulation)] * len(stood.places_rad), abs=2e-3)
    assert "reached its commanded positions: one for each modulation" in result().report_file.read_text()


def test_one_that_slips_on_its_way_is_named():
    """Its encoder jumps between two visits to one modulation, as that of a drive which has lost its place."""
    slip = WrittenFault({"kind": "encoder-jump", "on": "modulator", "at": "4 s", "by": "0.1 rad"}, "rest")
    rest = ModulatedProcedure(RestProcedure(RestOptions(duration_s=1.5)), (1.0, 3.0, 1.0))
    session = Session((), "slips", faults=(slip,))
    recorded = record_procedures(
        RIG, session, (rest,), out=Path(mkdtemp()), known=result().knowledge, seed=3, live=False
    )
    found = modulator_places(recorded.measured)
    assert found.stray is not None
    assert found.stray.modulation == 1.0
    assert found.stray.apart_rad == pytest.approx(0.1, abs=5e-3)
    said = modulator_sentence(found, Units("rad", "N*m/rad"))
    assert said.startswith("The modulator did not reach its commanded position: at 1.00 N·m/rad it was at 0.25")
