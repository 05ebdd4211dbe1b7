"""The sections of what was tabulated: source, exertion, and the two ports beside each other."""

from norton_bench.identification.tables.exertion_table import ExertionTable
from norton_bench.identification.tables.modulation import modulated
from norton_bench.identification.tables.source_table import SourceTable
from norton_bench.identification.tables.two_ports import two_ports
from norton_bench.report.data import ReportData
from norton_bench.report.facts_tables import (
    line_facts,
    modulation_sentences,
    modulator_facts,
    modulator_sentence,
    ports_facts,
    source_facts,
    stiffness_facts,
)
from norton_bench.report.figures_tables import exertion_figure, shaken_figure, source_table_figure
from norton_bench.report.section import Facts, Section
from norton_bench.report.svg import svg
from norton_bench.report.words import number


def tabulated_source_section(data: ReportData) -> Section | None:
    if data.source is None:
        return None
    caption = (
        "Where the port rests with nothing pulling at it, under each command, reached from both sides. Bars are 95 % "
        "intervals of the mean. In the table ± is half of a 95 % interval, half of the gap between the sides in it."
    )
    picture = svg(source_table_figure(data.source, data.units), "tabulated-source", caption)
    sentences = (*_unsettled(data.source), _settling(data.source))
    return Section(
        "tabulated-source",
        "The source, tabulated",
        sentences,
        ((picture, caption),),
        (source_facts(data.source, data.units),),
    )


def _unsettled(table: SourceTable) -> list[str]:
    moving = [level for level in table.levels if not level.settled]
    if not moving:
        return ["Every level was seen to rest before it was read."]
    fastest = max(abs(level.velocity_rad_s) for level in moving)
    return [
        f"{len(moving)} of {len(table.levels)} levels still moved while they were read, by up to "
        f"{number(fastest, 2)} rad/s: they are no places of rest; wait longer (at_most), or the source is a velocity, "
        "which the step 'free' measures."
    ]


def _settling(table: SourceTable) -> str:
    longest = max(level.settling_s for level in table.levels)
    return f"The slowest took {number(longest, 2)} s to come within 2\u00a0% of its way."


def exertion_section(data: ReportData) -> Section | None:
    table = data.exertion
    if table is None:
        return None
    caption = (
        "Torque at the port, held away from where it rests. Triangles point the way in which the place was reached; "
        "bars are 95 % intervals of the mean. Lines without marks are slow sweeps."
    )
    figures = [(svg(exertion_figure(table, data.units), "exertion", caption), caption)]
    if table.shaken:
        told = "How the port answers to being shaken about its source: spring and inertia left, damping right."
        figures.append((svg(shaken_figure(table, data.units), "shaken", told), told))
    return Section(
        "exertion", "The impedance, tabulated", _swept(table), tuple(figures), (line_facts(table, data.units),)
    )


def _swept(table: ExertionTable) -> tuple[str, ...]:
    """What its sweeps tell."""
    speeds = [each.speed_rad_s for each in table.swept]
    if not speeds:
        return ()
    return (
        f"Friction is half of what lies between both directions of a sweep at {number(max(speeds), 2)} rad/s; the "
        "range without torque is read from the sweeps, too. Held still, contacts forget how they were strained.",
    )


def two_ports_section(data: ReportData) -> Section | None:
    rows = two_ports(data.source, data.exertion)
    if not rows:
        return None
    sentence = (
        "With nothing pulling at the far side of the load the actuator carries the load's body, and rests elsewhere "
        "than with nothing pulling at its own port. What the body asks there was read by the torque sensor; what the "
        "actuator exerts so far from its own source stands in its table: the two should agree."
    )
    return Section("two-ports", "Two ports", (sentence,), tables=(ports_facts(rows, data.units),))


def modulation_section(data: ReportData) -> Section | None:
    found = modulated(data.source, data.exertion)
    if found is None and data.modulator is None:
        return None
    sentences: tuple[str, ...] = ()
    tables: tuple[Facts, ...] = ()
    if found is not None:
        sentences = modulation_sentences(found, data.units)
        tables = (stiffness_facts(found, data.units),) if found.stiffness else ()
    if data.modulator is not None:
        sentences = (*sentences, modulator_sentence(data.modulator, data.units))
        tables = (*tables, modulator_facts(data.modulator, data.units))
    return Section("modulation", "What the modulation changes", sentences, tables=tables)
