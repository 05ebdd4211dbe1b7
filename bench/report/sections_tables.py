"""The sections of what was tabulated: source, exertion, and the two ports beside each other."""

from math import isfinite

from bench.identification.tables.exertion_table import ExertionTable, Line
from bench.identification.tables.means import Mean
from bench.identification.tables.source_table import SourceTable
from bench.identification.tables.two_ports import PortsRow, two_ports
from bench.report.data import ReportData
from bench.report.figures_tables import exertion_figure, shaken_figure, source_table_figure
from bench.report.section import Facts, Section
from bench.report.svg import svg
from bench.report.words import number, pretty_unit, within


def tabulated_source_section(data: ReportData) -> Section | None:
    if data.source is None:
        return None
    caption = (
        "Where the port rests with nothing pulling at it, under each command, reached from both sides. Bars are 95 % "
        "intervals of the mean. In the table ± is half of a 95 % interval, half of the gap between the sides in it."
    )
    picture = svg(source_table_figure(data.source, data.command_unit), "tabulated-source", caption)
    sentences = (*_unsettled(data.source), _settling(data.source))
    return Section(
        "tabulated-source",
        "The source, tabulated",
        sentences,
        ((picture, caption),),
        (source_facts(data.source, data.command_unit),),
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


def source_facts(table: SourceTable, command_unit: str) -> Facts:
    """A row for each command at each port."""
    unit = pretty_unit(command_unit)
    head = ("port", f"command [{unit}]", "rests at [rad]", "gap [rad]", "torque [mN·m]")
    rows = tuple(
        (
            port,
            number(row.command, 4),
            within(row.position.value, row.position.half_width),
            number(row.gap_rad, 2) if isfinite(row.gap_rad) else "one side",
            within(1e3 * row.torque.value, 1e3 * row.torque.half_width),
        )
        for port in table.ports
        for row in table.rows(port)
    )
    return Facts(head, rows)


def exertion_section(data: ReportData) -> Section | None:
    table = data.exertion
    if table is None:
        return None
    caption = (
        "Torque at the port, held away from where it rests. Triangles point the way in which the place was reached; "
        "bars are 95 % intervals of the mean."
    )
    figures = [(svg(exertion_figure(table, data.command_unit), "exertion", caption), caption)]
    if table.shaken:
        told = "How the port answers to being shaken about its source: spring and inertia left, damping right."
        figures.append((svg(shaken_figure(table, data.command_unit), "shaken", told), told))
    return Section("exertion", "The impedance, tabulated", (), tuple(figures), (line_facts(table, data.command_unit),))


def line_facts(table: ExertionTable, command_unit: str) -> Facts:
    """A row for each command."""
    head = (
        f"command [{pretty_unit(command_unit)}]",
        "source [rad]",
        "stiffness [N·m/rad]",
        "hysteresis [mN·m]",
        "no torque [mrad]",
    )
    return Facts(head, tuple(_line(line) for line in table.lines()))


def _line(line: Line) -> tuple[str, ...]:
    width = Mean(float("nan"), float("nan")) if line.zeros is None else line.zeros.width
    return (
        number(line.command, 4),
        within(line.source.value, line.source.half_width),
        within(line.stiffness.value, line.stiffness.half_width),
        number(1e3 * line.hysteresis_nm, 2),
        within(1e3 * width.value, 1e3 * width.half_width),
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
    return Section("two-ports", "Two ports", (sentence,), tables=(ports_facts(rows, data.command_unit),))


def ports_facts(rows: tuple[PortsRow, ...], command_unit: str) -> Facts:
    """A row for each command."""
    head = (
        f"command [{pretty_unit(command_unit)}]",
        "external [rad]",
        "actuator [rad]",
        "asked [mN·m]",
        "exerted [mN·m]",
    )
    facts = tuple(
        (
            number(row.command, 4),
            within(row.external.value, row.external.half_width),
            within(row.actuator.value, row.actuator.half_width),
            within(1e3 * row.load.value, 1e3 * row.load.half_width),
            within(1e3 * row.exertion.value, 1e3 * row.exertion.half_width),
        )
        for row in rows
    )
    return Facts(head, facts)
