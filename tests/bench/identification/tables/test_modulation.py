"""What a modulation is said to change: stiffness and source, from made-up tables."""

import numpy as np
import pytest

from norton_bench.identification.averages import Mean, Setting
from norton_bench.identification.exertion_table import ExertionTable, Held
from norton_bench.identification.modulation import modulated
from norton_bench.identification.source_table import SourceLevel, SourceTable
from norton_bench.report.facts_tables import modulation_sentences
from norton_bench.units import Units

UNITS = Units("rad", "N*m/rad")


def exertion(stiffness: dict[float, float], commands: tuple[float, ...] = (-0.1, 0.1)) -> ExertionTable:
    """A spring by modulation, a little stiffer at the greater command."""
    random, held = np.random.default_rng(1), []
    for modulation, k in stiffness.items():
        for place, command in enumerate(commands):
            for away in np.linspace(-0.05, 0.05, 9):
                torque_nm = -(k + 0.1 * place) * away + 1e-4 * random.standard_normal()
                torque, setting = Mean(torque_nm, 1e-4), Setting(command, modulation)
                held += [Held(setting, away, rising, torque) for rising in (True, False)]
    sources = {Setting(command, modulation): Mean(command, 1e-4) for command in commands for modulation in stiffness}
    return ExertionTable(tuple(held), (), sources)


def source(places: dict[tuple[float, float | None], float]) -> SourceTable:
    """Where the port rests by command and modulation, from either side, ± 1 mrad."""
    levels = (
        SourceLevel("actuator", Setting(*at), rising, Mean(place, 1e-3), Mean(0.0, 1e-3), 0.0, True, 0.1)
        for at, place in places.items()
        for rising in (True, False)
    )
    return SourceTable(tuple(levels))


def test_stiffness_is_told_by_modulation_and_what_commands_differ_by_is_in_its_interval():
    found = modulated(None, exertion({0.0: 1.0, 2.0: 3.0, 4.0: 5.0}))
    assert found is not None
    assert [row.modulation for row in found.stiffness] == [0.0, 2.0, 4.0]
    assert [row.stiffness.value for row in found.stiffness] == pytest.approx([1.05, 3.05, 5.05], abs=0.005)
    assert all(0.05 <= row.stiffness.half_width < 0.06 for row in found.stiffness)
    assert found.stiffens
    (stiffens, stays) = modulation_sentences(found, UNITS)
    assert stiffens == (
        "The modulation changes the impedance: from 0 to 4.00 N·m/rad the stiffness at the source goes from "
        "1.05 ± 0.05 to 5.05 ± 0.05 N·m/rad."
    )
    assert stays.startswith("The modulation does not move the source")


def test_a_source_that_moves_further_than_its_intervals_is_told():
    places = {(-0.1, 0.0): -0.1, (-0.1, 4.0): -0.1005, (0.1, 0.0): 0.1, (0.1, 4.0): 0.104}
    found = modulated(source(places), None)
    assert found is not None
    assert found.shift is not None
    assert (found.shift.command, found.shift.low, found.shift.high) == (0.1, 0.0, 4.0)
    assert found.shift.shift.value == pytest.approx(4e-3)
    assert found.shift.shift.half_width == pytest.approx(2e-3)
    (said,) = modulation_sentences(found, UNITS)
    assert said == (
        "The modulation also moves the source, most at a command of 0.100 rad by 4 ± 2 mrad, "
        "from 0 to 4.00 N·m/rad: modulation and source are coupled."
    )


def test_a_stiffness_that_stays_is_not_called_changed():
    found = modulated(None, exertion({0.0: 2.0, 4.0: 2.02}))
    assert found is not None
    assert not found.stiffens
    assert modulation_sentences(found, UNITS)[0].startswith("The modulation does not change the impedance")


@pytest.mark.parametrize(
    ("source_table", "exertion_table"),
    [
        (None, None),
        (None, exertion({2.0: 3.0})),
        (source({(0.1, None): 0.1, (0.2, None): 0.2}), None),
        (source({(0.1, 0.0): 0.1, (0.2, 4.0): 0.2}), None),
    ],
)
def test_one_modulation_tells_nothing_of_what_it_changes(source_table, exertion_table):
    assert modulated(source_table, exertion_table) is None
