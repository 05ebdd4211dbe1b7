"""The sections of a report, each from the data that it needs, or left out."""

from collections.abc import Callable
from math import isfinite

import numpy as np

from norton_bench.guard.commands import Limited
from norton_bench.identification.live.moved import changes
from norton_bench.loop.timing import LoopTiming, loop_timing, timing_rows, timing_sentence
from norton_bench.records import FOR_PROGRAMS, Table
from norton_bench.report.data import ReportData
from norton_bench.report.figures_fit import live_figure, residual_figure, validation_figure
from norton_bench.report.figures_network import blocked_figure, impedance_figure, source_map_figure
from norton_bench.report.figures_timing import timing_figure
from norton_bench.report.loops import bench_time_s, presliding_loops, sliding_samples
from norton_bench.report.section import Facts, Section
from norton_bench.report.sections_model_error import model_error_section
from norton_bench.report.sections_tables import (
    exertion_section,
    modulation_section,
    tabulated_source_section,
    two_ports_section,
)
from norton_bench.report.sections_trials import in_situ_section, trials_section
from norton_bench.report.sections_without_model import residuals_section, source_sentences, without_model_section
from norton_bench.report.streams import StreamQuality, stream_qualities
from norton_bench.report.svg import svg
from norton_bench.report.words import number, percent, pretty_unit, with_deviation


def sections(data: ReportData) -> list[Section]:
    """Those for which there are data, in the order of the page."""
    made = [make(data) for make in MAKERS]
    return [section for section in made if section is not None]


def conditions_section(data: ReportData) -> Section | None:
    """The paper's three conditions for a network that its port tells without ambiguity."""
    if not data.conditions:
        return None
    head = ("condition", "", "judged by", "value", "95 % interval", "unit")
    rows = tuple(
        (
            each.condition,
            each.verdict,
            each.figure,
            number(each.value, 3),
            f"{number(each.interval[0], 3)} … {number(each.interval[1], 3)}" if isfinite(each.interval[0]) else "",
            pretty_unit(each.unit),
        )
        for each in data.conditions
    )
    sentences = tuple(map(str, data.conditions))
    return Section("conditions", "Whether it can be told from the port", sentences, tables=(Facts(head, rows),))


def source_section(data: ReportData) -> Section | None:
    if data.source_map is None and data.network is None:
        return None
    caption = (
        "Steady velocity with no torque at the port, against command. Where the command is too weak for friction "
        "the shaft rests; outside, the velocity follows in two straight branches. Below, what lies between measured "
        "and identified; bars and bands are 95 % intervals."
    )
    picture = svg(source_map_figure(data.source_map, data.network, data.command_unit), "source", caption)
    sentences = []
    if data.network is not None:
        unit = pretty_unit(data.command_unit)
        low, high = (f"{number(threshold, 3)} {unit}".strip() for threshold in data.network.thresholds)
        sentences = [f"The shaft rests for commands between {low} and {high}; beyond, it turns."]
    if data.source_map is not None:
        sentences += source_sentences(data.source_map, pretty_unit(data.command_unit))
    return Section("source", "The motion source", tuple(sentences), ((picture, caption),))


def impedance_section(data: ReportData) -> Section | None:
    if data.fit is None or data.measured is None:
        return None
    network = data.fit.network
    deflection_rad = network.coulomb_torque_nm / network.presliding_stiffness_nm_rad
    loops = presliding_loops(data.measured, data.fit.trace, deflection_rad)
    sliding = sliding_samples(data.measured, data.fit.trace)
    if not loops and sliding is None:
        return None
    caption = (
        "Torque that the actuator exerts while the bench prescribes its motion. Left alone at one command, "
        "each straight line on the right is the viscous branch, shifted by friction on either side of rest."
    )
    sentence = f"Friction's contact deflects by {number(1e3 * deflection_rad, 3)} mrad before it slides (τc/σ0)."
    picture = svg(impedance_figure(loops, sliding), "impedance", caption)
    return Section("impedance", "The impedance", (sentence,), ((picture, caption),))


def friction_section(data: ReportData) -> Section | None:
    """The ladder of friction models: how much of the torque each leaves, on data it has seen and on data it has not."""
    if not data.ladder:
        return None
    best = next(rung for rung in data.ladder if rung.selected)
    sentences = (
        f"Judged on parts of the recording that the fit had not seen, in a low band: {best.name} is the simplest model "
        "that is not worse than the best by more than one standard error.",
    )
    head = ("model", "numbers", "torque left, seen [%]", "not seen [%]", "standard error [%]", "remark")
    rows = tuple(
        (
            rung.name,
            str(rung.unknowns),
            number(100 * rung.train_relative, 3),
            number(100 * rung.held_out_relative, 3),
            number(100 * rung.held_out_std / rung.target_rms, 3),
            "selected" if rung.selected else "" if rung.fit.converged else "did not converge",
        )
        for rung in data.ladder
    )
    return Section("friction", "Friction models", sentences, tables=(Facts(head, rows),))


def blocked_section(data: ReportData) -> Section | None:
    if data.blocked_map is None or not np.isfinite(data.blocked_map.torque_nm).any():
        return None
    caption = (
        "Torque at standstill against command. One command gives different torques, by how the shaft came to rest: "
        "friction leaves ±τc open, so the blocked port does not determine a source."
    )
    picture = svg(blocked_figure(data.blocked_map, data.network, data.command_unit), "blocked", caption)
    return Section("blocked", "The blocked port", (), ((picture, caption),))


def fit_section(data: ReportData) -> Section | None:
    fit = data.fit
    if fit is None:
        return None
    residual = fit.trace.measured - fit.trace.predicted
    caption = "What the fit leaves of the torque."
    delays = "; ".join(
        f"{name} {with_deviation(1e3 * delay_s, 1e3 * std_s)} ms"
        for name, delay_s, std_s in (
            ("command", fit.command_delay_s, fit.command_delay_std_s),
            ("motion", fit.motion_delay_s, fit.motion_delay_std_s),
        )
    )
    sentences = (
        f"The fit {'converged' if fit.converged else 'did not converge'} on {fit.samples:,} samples.".replace(",", " "),
        f"Torque residual {number(1e3 * fit.torque_rms_nm, 3)} mN·m rms, {percent(fit.torque_relative)} of the torque.",
        f"Delays relative to the torque stream: {delays}.",
    )
    figures = ((svg(residual_figure(fit.trace), "residuals", caption), caption),) if np.isfinite(residual).any() else ()
    return Section("fit", "The fit", sentences, figures)


def validation_section(data: ReportData) -> Section | None:
    checked = data.validation
    if checked is None:
        return None
    sentences = (
        f"Torque under unseen motion: {number(1e3 * checked.torque_rms_nm, 3)} mN·m rms off, "
        f"{percent(checked.torque_relative)} of the torque.",
        f"Free velocity under an unseen command: {number(checked.velocity_rms_rad_s, 3)} rad/s rms off, "
        f"{percent(checked.velocity_relative)} of the velocity.",
    )
    figures = []
    for trace, what, caption in (
        (checked.torque, "torque", "Torque at the port, measured and predicted from the measured motion."),
        (checked.velocity, "velocity", "Free velocity, measured and predicted from the command alone."),
    ):
        if np.isfinite(trace.measured).any():
            figures.append((svg(validation_figure(trace, what), f"validation-{what}", caption), caption))
    return Section("validation", "Motion that no fit has seen", sentences, tuple(figures))


def live_section(data: ReportData) -> Section | None:
    if not any(state.estimates for state in data.live) or data.measured is None:
        return None
    time_s = bench_time_s(data.measured, [state.stamp_ns for state in data.live])
    caption = (
        "The live estimates while the bench was running, with their 95 % bands; the line is the final fit. The scale "
        "is that of the last two thirds, so that the beginning may lie outside."
    )
    figure = svg(live_figure(data.live, time_s, data.fit), "live", caption)
    return Section("live", "How it was learnt", _beside_final(data), ((figure, caption),))


def _beside_final(data: ReportData) -> tuple[str, ...]:
    """How far the last live values are from the final ones."""
    compared = () if data.fit is None else changes(data.live[-1].estimates, data.fit)
    if not compared:
        return ()
    furthest = max(compared, key=lambda change: abs(change.deviations))
    return (
        f"The last live values of {len(compared)} parameters lie within {abs(furthest.deviations):.1f} standard "
        f"deviations of the final ones; {furthest.final.name.replace('_', ' ')} is the furthest off.",
    )


def timing_section(data: ReportData) -> Section | None:
    if data.measured is None or not len(data.measured.ticks):
        return None
    ticks = data.measured.ticks
    timing = loop_timing(ticks)
    qualities = stream_qualities(data.measured)
    caption = "How late ticks began, how long each took, and how old the signals were that it acted on."
    return Section(
        "timing",
        "Time kept, readings lost",
        ((timing_sentence(timing), _clipping(ticks)) if timing is not None else (_clipping(ticks),)),
        ((svg(timing_figure(ticks), "timing", caption), caption),),
        (*_timing_table(timing), *((_stream_table(qualities),) if qualities else ())),
    )


def events_section(data: ReportData) -> Section | None:
    if data.measured is None or not data.measured.events:
        return None
    told = [event for event in data.measured.events if event.kind not in FOR_PROGRAMS]
    times_s = bench_time_s(data.measured, [event.stamp_ns for event in told])
    rows = tuple((f"{time_s:.3f}", event.kind, event.text) for time_s, event in zip(times_s, told, strict=True))
    if not rows:
        return None
    return Section("events", "What happened", tables=(Facts(("bench time [s]", "kind", "what"), rows),))


def _timing_table(timing: LoopTiming | None) -> tuple[Facts, ...]:
    """Nothing, where time waited for the loop."""
    return () if timing is None or timing.in_lock_step else (Facts(*timing_rows(timing)),)


def _clipping(ticks: Table) -> str:
    counts = {limit: int(np.count_nonzero(ticks["limited"] & limit.value)) for limit in Limited}
    clipped = [f"{limit.name.lower().replace('_', ' ')} in {n}" for limit, n in counts.items() if n and limit.name]
    return f"The guard clipped {', '.join(clipped)} ticks." if clipped else "The guard had nothing to clip."


def _stream_table(qualities: list[StreamQuality]) -> Facts:
    head = (
        "stream",
        "rate [Hz]",
        "expected",
        "lost",
        "unchanged",
        "longest gap [ms]",
        "age, median [ms]",
        "age, most [ms]",
    )
    return Facts(
        head,
        tuple(
            (
                quality.name,
                number(quality.rate_hz, 5),
                str(quality.expected),
                str(quality.lost),
                str(quality.unchanged),
                number(quality.longest_gap_ms, 3),
                number(quality.age_median_ms, 3),
                number(quality.age_greatest_ms, 3),
            )
            for quality in qualities
        ),
    )


MAKERS: tuple[Callable[[ReportData], Section | None], ...] = (
    conditions_section,
    tabulated_source_section,
    exertion_section,
    modulation_section,
    two_ports_section,
    source_section,
    impedance_section,
    validation_section,
    model_error_section,
    without_model_section,
    fit_section,
    residuals_section,
    friction_section,
    blocked_section,
    trials_section,
    in_situ_section,
    live_section,
    timing_section,
    events_section,
)
