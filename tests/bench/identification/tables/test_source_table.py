"""Where a shaft rests, read from made-up recordings, and the two ports that follow from tables."""

from dataclasses import replace

import numpy as np
import pytest

from norton_bench.errors import ExperimentError
from norton_bench.identification.averages import Mean, Setting
from norton_bench.identification.exertion_table import ExertionTable, Held
from norton_bench.identification.source_table import SourceLevel, SourceTable, source_table
from norton_bench.identification.table_conditions import two_ports
from norton_bench.records import MOTION, TICK, Measured, SegmentInfo, join
from norton_bench.segments import Use

MS = 1_000_000
HELD = Setting(0.1)


def recording(
    levels: list[tuple[float, float]], tau_s: float = 0.05, drift_rad_s: float = 0.0, modulation: float = np.nan
) -> Measured:
    """For each (command, place): half a second of moving, then the shaft approaches its place, then a reading."""
    ticks, motion, segments, here = [], [], [], 0.0
    random = np.random.default_rng(0)
    for command, place in levels:
        for name, count in (("move", 500), ("settle", 400), ("read actuator", 500)):
            start = len(ticks)
            for _ in range(count):
                if name != "move":
                    here = place + (here - place) * np.exp(-1e-3 / tau_s)
                ticks.append((len(ticks) * MS, command, 1e-3 * random.standard_normal()))
                motion.append(
                    (len(motion) * MS, here + drift_rad_s * 1e-3 * len(motion) + 1e-5 * random.standard_normal())
                )
            use = Use.IDENTIFY if name.startswith("read") else Use.PREPARE
            segments.append(
                SegmentInfo(len(segments), "tabulate_source", name, use, "admittance", start * MS, len(ticks) * MS)
            )
    tick_table, motion_table = np.zeros(len(ticks), TICK), np.zeros(len(motion), MOTION)
    tick_table["tick_ns"], tick_table["command"], tick_table["torque_nm"] = np.array(ticks).T
    tick_table["modulation"] = modulation
    motion_table["arrival_ns"], motion_table["position_rad"] = np.array(motion).T
    return Measured(tick_table, motion_table, segments=tuple(segments))


def test_levels_tell_from_which_side_they_were_reached_and_how_long_it_took():
    table = source_table(recording([(-0.1, -1.0), (0.1, 1.0), (-0.1, -1.02)], tau_s=0.05))
    assert [level.rising for level in table.levels] == [False, True, False]
    assert [level.position.value for level in table.levels] == pytest.approx([-1.0, 1.0, -1.02], abs=1e-3)
    assert all(level.settled for level in table.levels)
    # An exponential comes within 2 % after nearly four time constants.
    assert table.levels[1].settling_s == pytest.approx(-0.05 * np.log(0.02), abs=0.01)


def test_what_still_moves_is_not_called_settled():
    table = source_table(recording([(-0.1, -1.0), (0.1, 1.0)], drift_rad_s=0.8))
    assert not any(level.settled for level in table.levels)
    assert table.levels[1].velocity_rad_s == pytest.approx(0.8, rel=0.01)


def test_both_sides_are_taken_together_and_one_alone_is_known_less_well():
    table = source_table(recording([(0.0, 0.0), (0.1, 1.0), (0.2, 2.0), (0.1, 1.1), (0.0, 0.02)]))
    rows = {round(row.setting.command, 3): row for row in table.rows("actuator")}
    assert rows[0.1].position.value == pytest.approx(1.05, abs=2e-3)
    assert rows[0.1].gap_rad == pytest.approx(-0.1, abs=2e-3)
    assert rows[0.1].position.half_width == pytest.approx(0.05, abs=5e-3)
    assert np.isnan(rows[0.2].gap_rad)
    assert rows[0.2].position.half_width == pytest.approx(0.05, abs=5e-3)


def test_levels_under_several_modulations_are_told_apart_and_each_begins_anew_at_rest():
    """The first command of the second modulation is below the last of the first, and reached from zero."""
    parts = [recording([(0.1, 1.0), (0.2, 2.0), (0.1, 1.1)], modulation=each) for each in (0.0, 3.0)]
    leave = SegmentInfo(9, "tabulate_source", "leave", Use.PREPARE, "admittance", 4199 * MS, 4200 * MS)
    table = source_table(join([replace(parts[0], segments=(*parts[0].segments, leave)), later(parts[1])]))
    assert table.modulations == (0.0, 3.0)
    assert [level.rising for level in table.levels] == [True, True, False] * 2
    rows = table.rows("actuator")
    assert [row.setting for row in rows] == [(0.1, 0.0), (0.1, 3.0), (0.2, 0.0), (0.2, 3.0)]
    assert [level.position.value for level in table.branch("actuator", False, 3.0)] == pytest.approx([1.1], abs=1e-3)
    assert source_table(recording([(0.1, 1.0)])).modulations == (None,)


def later(measured: Measured) -> Measured:
    """The same 4.2 s later."""
    by_ns, ticks, motion = 4200 * MS, measured.ticks.copy(), measured.motion.copy()
    ticks["tick_ns"] += by_ns
    motion["arrival_ns"] += by_ns
    segments = tuple(
        replace(each, index=each.index + 10, start_ns=each.start_ns + by_ns, end_ns=each.end_ns + by_ns)
        for each in measured.segments
    )
    return replace(measured, ticks=ticks, motion=motion, segments=segments)


def test_without_readings_there_is_no_table():
    measured = recording([(0.1, 1.0)])
    with pytest.raises(ExperimentError, match="run the step 'tabulate_source'"):
        source_table(replace(measured, segments=()))


def level(port: str, rising: bool, position: float, torque: float) -> SourceLevel:
    return SourceLevel(port, HELD, rising, Mean(position, 1e-3), Mean(torque, 1e-3), 0.0, True, 0.1)


def test_two_ports_agree_where_the_actuator_exerts_what_the_load_asks():
    source = SourceTable(
        tuple(
            level(port, rising, *at)
            for port, at in (("external", (0.3, 0.02)), ("actuator", (0.4, 0.0)))
            for rising in (True, False)
        )
    )
    held = tuple(
        Held(HELD, away, rising, Mean(-0.2 * away, 1e-4)) for away in (-0.2, 0.0, 0.2) for rising in (True, False)
    )
    exertion = ExertionTable(held, (), {HELD: Mean(0.4, 1e-3)})
    (row,) = two_ports(source, exertion)
    assert row.apart_rad == pytest.approx(0.1)
    assert row.load.value == pytest.approx(0.02)
    assert row.exertion.value == pytest.approx(0.02)
    assert np.isnan(two_ports(source, None)[0].exertion.value)
    assert two_ports(SourceTable(source.levels[:2]), exertion) == ()
