"""The tables of an actuator without a model, as text and sentences for report, screen and command line."""

from collections.abc import Iterator, Sequence
from math import isfinite

import numpy as np

from norton_bench.identification.averages import UNKNOWN, Setting
from norton_bench.identification.exertion_table import ExertionTable, SpringLine
from norton_bench.identification.impedance_along import ImpedanceAlong
from norton_bench.identification.in_situ import EXPLAINED, InSituResult
from norton_bench.identification.modulation import Modulated, ModulatorPlaces
from norton_bench.identification.path_impedance import PathImpedance
from norton_bench.identification.rendered import Rendered, name_of
from norton_bench.identification.source_table import SourceTable
from norton_bench.identification.table_conditions import PortsRow, two_ports
from norton_bench.identification.trials import TrialFigures, last_driven, settled
from norton_bench.report.words import Facts, number, pretty_unit, within
from norton_bench.result import Result
from norton_bench.units import Units


def setting_head(units: Units) -> tuple[str, ...]:
    """The head of the columns of :func:`setting_cells`."""
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


def _line(line: SpringLine, units: Units) -> tuple[str, ...]:
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


def modulation_sentences(effect: Modulated, units: Units) -> tuple[str, ...]:
    """Sentences about what the modulation changes, and what not."""
    return tuple(filter(None, (_stiffens(effect, pretty_unit(units.modulation)), _shifts(effect, units))))


def _stiffens(effect: Modulated, unit: str) -> str:
    if len(effect.stiffness) < 2:
        return ""
    first, last = effect.stiffness[0], effect.stiffness[-1]
    ends = [within(row.stiffness.value, row.stiffness.half_width) for row in (first, last)]
    span = f"from {number(first.modulation, 3)} to {number(last.modulation, 3)} {unit}"
    if effect.stiffens:
        goes = f"goes from {ends[0]} to {ends[1]} N·m/rad"
        return f"The modulation changes the impedance: {span} the stiffness at the source {goes}."
    return f"The modulation does not change the impedance: {span} the stiffness at the source stays {ends[0]} N·m/rad."


def _shifts(effect: Modulated, units: Units) -> str:
    shift = effect.shift
    if shift is None:
        return ""
    span = f"from {number(shift.low, 3)} to {number(shift.high, 3)} {pretty_unit(units.modulation)}"
    moved = within(1e3 * shift.shift.value, 1e3 * shift.shift.half_width)
    where = f"at a command of {number(shift.command, 3)} {pretty_unit(units.command)} by {moved} mrad, {span}"
    if shift.shows:
        return f"The modulation also moves the source, most {where}: modulation and source are coupled."
    return f"The modulation does not move the source: the largest difference, {where}, is within the intervals."


def stiffness_facts(effect: Modulated, units: Units) -> Facts:
    """A row for each modulation."""
    head = (f"modulation [{pretty_unit(units.modulation)}]", "stiffness at the source [N·m/rad]")
    rows = tuple(
        (number(row.modulation, 4), within(row.stiffness.value, row.stiffness.half_width)) for row in effect.stiffness
    )
    return Facts(head, rows)


def modulator_sentence(places: ModulatorPlaces, units: Units) -> str:
    """Whether the modulator reached its commanded positions, by its own encoder."""
    unit, astray = pretty_unit(units.modulation), places.stray
    if astray is not None:
        ends = f"{number(min(astray.places_rad), 3)} and {number(max(astray.places_rad), 3)} rad"
        return (
            f"The modulator did not reach its commanded position: at {number(astray.modulation, 3)} {unit} it was at "
            f"{ends}. It slips or loses count, so that several impedances are mixed there; repair it and repeat that."
        )
    if not places.followed:
        return "The modulator stood at the same place under different modulations: it is at a stop, or stuck."
    same = f"{number(1e3 * places.same_rad, 2)} mrad"
    return f"By its encoder the modulator reached its commanded positions: one for each modulation, ± {same}."


def modulator_facts(places: ModulatorPlaces, units: Units) -> Facts:
    """A row for each modulation."""
    head = (f"modulation [{pretty_unit(units.modulation)}]", "stood at [rad]", "times", "apart [mrad]")
    rows = tuple(
        (
            number(each.modulation, 4),
            number(sum(each.places_rad) / len(each.places_rad), 4),
            str(len(each.places_rad)),
            number(1e3 * each.apart_rad, 2),
        )
        for each in places.stood
    )
    return Facts(head, rows)


def in_sentences(result: Result) -> Iterator[str]:
    """The results of repeated movements, and the laws that were rendered."""
    yield from map(rendered_sentence, result.rendered)
    if result.in_situ is not None and result.in_situ.trials:
        yield in_situ_sentence(result.in_situ)
        yield from impedance_sentences(result.in_situ)
    if result.trials:
        yield trials_sentence(result.trials)


def tabulated(result: Result) -> tuple[Facts, ...]:
    """The tables of source and impedance, in short: without single readings."""
    tables = []
    if result.source is not None:
        tables.append(source_facts(result.source, result.units))
    if result.exertion is not None:
        tables.append(line_facts(result.exertion, result.units))
    rows = two_ports(result.source, result.exertion)
    return (*tables, ports_facts(rows, result.units)) if rows else tuple(tables)


# What a law consists of, with its unit as it is shown, and how many of those are one in SI.
LAW_PARTS = (("mass", "g·m²", 1e3), ("damping", "mN·m·s/rad", 1e3), ("stiffness", "N·m/rad", 1.0))


def rendered_facts(results: Sequence[Rendered]) -> Facts:
    """A row for each law: as measured, and in brackets as it was asked for."""
    head = (*(f"{name} [{unit}]" for name, unit, _ in LAW_PARTS), "port torque [mN·m]", "unexplained [mN·m]")
    rows = tuple(
        (
            *(
                f"{within(factor * value, factor * half)} ({number(factor * asked, 3)}{_wall(result, name)})"
                for (name, _, factor), asked, value, half in _law(result)
            ),
            number(1e3 * result.torque_nm, 3),
            number(1e3 * result.off_nm, 2),
        )
        for result in results
    )
    return Facts(head, rows)


def rendered_sentence(result: Rendered) -> str:
    """A law that was rendered, in one sentence."""
    if result.shortcoming:
        return f"Rendered: {name_of(result.asked)} was asked for; not measured, because {result.shortcoming}."
    parts = [
        f"{name} {within(factor * value, factor * half)} {unit} "
        f"({number(factor * asked, 3)}{_wall(result, name)} asked for)"
        for (name, unit, factor), asked, value, half in _law(result)
    ]
    return (
        f"Rendered: {', '.join(parts)}; of {1e3 * result.torque_nm:.2g} mN·m rms at the port the law asked for leaves "
        f"{1e3 * result.off_nm:.2g} unexplained."
    )


def _wall(result: Rendered, part: str) -> str:
    """Where the spring begins, if it is a wall's."""
    wall_rad = result.asked.wall_rad
    return "" if wall_rad is None or part != "stiffness" else f" beyond {number(wall_rad, 3)} rad"


def _law(result: Rendered) -> Iterator[tuple[tuple[str, str, float], float, float, float]]:
    return zip(LAW_PARTS, result.asked.values, result.measured, result.half, strict=True)


def in_situ_sentence(result: InSituResult) -> str:
    """The trials in situ, in one sentence."""
    last = last_driven(result.trials)
    end = "; ".join(result.reasons) or EXPLAINED
    return (
        f"In situ, {len(result.trials)} trials: in the last one the actuator exerted {1e3 * last.with_noise_nm:.2f} "
        f"mN·m, at least {last.below_db(result.trials[0]):.0f} dB below the first; {end}."
    )


def impedance_sentences(result: InSituResult) -> Iterator[str]:
    """The impedance about the path, and how it changes along it; where it changes, the mean is not told."""
    along = result.along
    if along is not None:
        yield _along_sentence(along)
    if result.impedance is not None and (along is None or not along.linear):
        yield _impedance_sentence(result.impedance)


def _along_sentence(along: ImpedanceAlong) -> str:
    if not along.linear:
        return (
            "Along this motion an inertia, and a damper and a spring that change, explain only "
            f"{max(along.explained, 0.0):.0%} of the torque of trials that the fit has not seen: friction or play "
            "answers, too, or the trials hardly differ."
        )
    low, high = float(np.min(along.stiffness_nm_rad)), float(np.max(along.stiffness_nm_rad))
    half = f"± {number(float(np.median(along.stiffness_half_nm_rad)), 2)} N·m/rad"
    stiffness = (
        f"a stiffness of {number(low, 3)} to {number(high, 3)} {half}, resolved to {1e3 * along.resolution_s:.0f} ms"
        if isfinite(along.resolution_s)
        else f"a stiffness that was not seen to change, {number(high, 4)} {half}"
    )
    damping = number(float(np.mean(along.damping_nms_rad)), 3)
    inertia = f"{number(along.inertia_kgm2, 4)} ± {number(along.inertia_half_kgm2, 2)} kg·m²"
    mean = " in the mean" if along.damping_changes else ""
    return (
        f"Along this motion the actuator answers with an inertia of {inertia}, {stiffness}, and a damping of {damping} "
        f"N·m·s/rad{mean}, at the load's encoder and in newton metres of its drive; "
        f"they explain {along.explained:.2%} of the torque of trials that the fit has not seen."
    )


def _impedance_sentence(about: PathImpedance) -> str:
    if not about.linear:
        return (
            f"About this motion an inertia, a damper and a spring explain only {about.explained:.0%} of how the torque "
            "of the trials differs: friction, play, or a stiffness that changes answers, too."
        )
    parts = (("inertia", "kg·m²"), ("damping", "N·m·s/rad"), ("stiffness", "N·m/rad"))
    inertia, damping, stiffness = (
        f"{what} {number(value, 4)} ± {number(half, 2)} {unit}"
        for (what, unit), value, half in zip(parts, about.values, about.half, strict=True)
    )
    return (
        f"About this motion the actuator answers with {inertia}, {damping} and {stiffness}, at the load's encoder and "
        f"in newton metres of its drive; they explain {about.explained:.1%} of how the torque of the trials differs."
    )


def trials_sentence(trials: Sequence[TrialFigures]) -> str:
    """The trials of zero torque under a repeated command, in one sentence."""
    last = trials[-1]
    end = "noise hides what is left" if settled(trials) else "not converged"
    return (
        f"Zero torque, {len(trials)} trials: {1e3 * last.with_noise_nm:.2f} mN·m at the port, at least "
        f"{last.below_db(trials[0]):.0f} dB below the undriven load; {end}."
    )
