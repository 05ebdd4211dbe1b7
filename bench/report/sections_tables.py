"""The sections of what was tabulated: source, exertion, and the two ports beside each other."""

from math import isfinite

from bench.identification.tables.exertion_table import ExertionTable, Line
from bench.identification.tables.means import UNKNOWN, Setting
from bench.identification.tables.modulation import Modulated, modulated
from bench.identification.tables.modulator import ModulatorPlaces
from bench.identification.tables.source_table import SourceTable
from bench.identification.tables.two_ports import PortsRow, two_ports
from bench.report.data import ReportData
from bench.report.figures_tables import exertion_figure, shaken_figure, source_table_figure
from bench.report.section import Facts, Section
from bench.report.svg import svg
from bench.report.words import Units, number, pretty_unit, within


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


def setting_head(units: Units) -> tuple[str, ...]:
    """Over the columns that :func:`setting_cells` fills."""
    head = (f"command [{pretty_unit(units.command)}]",)
    return (*head, f"modulation [{pretty_unit(units.modulation)}]") if units.modulation else head


def setting_cells(setting: Setting, units: Units) -> tuple[str, ...]:
    """The command, and on a bench with a modulator the modulation."""
    cells = (number(setting.command, 4),)
    if not units.modulation:
        return cells
    return (*cells, "–" if setting.modulation is None else number(setting.modulation, 4))


def source_facts(table: SourceTable, units: Units) -> Facts:
    """A row for each setting at each port."""
    head = ("port", *setting_head(units), "rests at [rad]", "gap [rad]", "torque [mN·m]")
    rows = tuple(
        (
            port,
            *setting_cells(row.setting, units),
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


def line_facts(table: ExertionTable, units: Units) -> Facts:
    """A row for each setting."""
    head = (
        *setting_head(units),
        "source [rad]",
        "stiffness [N·m/rad]",
        "hysteresis [mN·m]",
        "friction [mN·m]",
        "no torque [mrad]",
    )
    return Facts(head, tuple(_line(line, units) for line in table.lines()))


def _line(line: Line, units: Units) -> tuple[str, ...]:
    width = UNKNOWN if line.zeros is None else line.zeros.width
    friction = UNKNOWN if line.sweep is None else line.sweep.friction
    return (
        *setting_cells(line.setting, units),
        within(line.source.value, line.source.half_width),
        within(line.stiffness.value, line.stiffness.half_width),
        number(1e3 * line.hysteresis_nm, 2),
        within(1e3 * friction.value, 1e3 * friction.half_width),
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
    return Section("two-ports", "Two ports", (sentence,), tables=(ports_facts(rows, data.units),))


def ports_facts(rows: tuple[PortsRow, ...], units: Units) -> Facts:
    """A row for each setting."""
    head = (
        *setting_head(units),
        "external [rad]",
        "actuator [rad]",
        "asked [mN·m]",
        "exerted [mN·m]",
    )
    facts = tuple(
        (
            *setting_cells(row.setting, units),
            within(row.external.value, row.external.half_width),
            within(row.actuator.value, row.actuator.half_width),
            within(1e3 * row.load.value, 1e3 * row.load.half_width),
            within(1e3 * row.exertion.value, 1e3 * row.exertion.half_width),
        )
        for row in rows
    )
    return Facts(head, facts)


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


def modulator_sentence(found: ModulatorPlaces, units: Units) -> str:
    """Whether the drive went where it was sent, as far as its own encoder tells."""
    unit, stray = pretty_unit(units.modulation), found.stray
    if stray is not None:
        ends = f"{number(min(stray.places_rad), 3)} and {number(max(stray.places_rad), 3)} rad"
        return (
            f"The modulator did not go where it was sent: under {number(stray.modulation, 3)} {unit} it was at {ends}: "
            "it slips or loses count, and what was tabulated there is of several impedances; mend it and repeat that."
        )
    if not found.followed:
        return "The modulator stood at the same place under different modulations: it is at a stop, or stuck."
    same = f"{number(1e3 * found.same_rad, 2)} mrad"
    return f"By its encoder the modulator went where it was sent: under each modulation to one place, ± {same}."


def modulator_facts(found: ModulatorPlaces, units: Units) -> Facts:
    """A row for each modulation."""
    head = (f"modulation [{pretty_unit(units.modulation)}]", "stood at [rad]", "times", "apart [mrad]")
    rows = tuple(
        (
            number(each.modulation, 4),
            number(sum(each.places_rad) / len(each.places_rad), 4),
            str(len(each.places_rad)),
            number(1e3 * each.apart_rad, 2),
        )
        for each in found.stood
    )
    return Facts(head, rows)


def modulation_sentences(found: Modulated, units: Units) -> tuple[str, ...]:
    """What it changes, and what it leaves alone."""
    return tuple(filter(None, (_stiffens(found, pretty_unit(units.modulation)), _shifts(found, units))))


def _stiffens(found: Modulated, unit: str) -> str:
    if len(found.stiffness) < 2:
        return ""
    first, last = found.stiffness[0], found.stiffness[-1]
    ends = [within(row.stiffness.value, row.stiffness.half_width) for row in (first, last)]
    span = f"from {number(first.modulation, 3)} to {number(last.modulation, 3)} {unit}"
    if found.stiffens:
        goes = f"goes from {ends[0]} to {ends[1]} N·m/rad"
        return f"The modulation changes the impedance: {span} the stiffness at the source {goes}."
    return f"The modulation does not show in the impedance: {span} the stiffness at the source stays {ends[0]} N·m/rad."


def _shifts(found: Modulated, units: Units) -> str:
    shift = found.shift
    if shift is None:
        return ""
    span = f"from {number(shift.low, 3)} to {number(shift.high, 3)} {pretty_unit(units.modulation)}"
    moved = within(1e3 * shift.shift.value, 1e3 * shift.shift.half_width)
    where = f"at a command of {number(shift.command, 3)} {pretty_unit(units.command)} by {moved} mrad, {span}"
    if shift.shows:
        return f"The modulation does not leave the source alone, which moves the most {where}: the two are coupled."
    return (
        f"The modulation leaves the source alone, which moves the most {where}: no more than the intervals leave open."
    )


def stiffness_facts(found: Modulated, units: Units) -> Facts:
    """A row for each modulation."""
    head = (f"modulation [{pretty_unit(units.modulation)}]", "stiffness at the source [N·m/rad]")
    rows = tuple(
        (number(row.modulation, 4), within(row.stiffness.value, row.stiffness.half_width)) for row in found.stiffness
    )
    return Facts(head, rows)
