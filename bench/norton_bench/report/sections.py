"""The sections of a report; a section without data is left out."""

from collections.abc import Callable
from math import isfinite

import numpy as np

from norton_bench.guard.check import Limited
from norton_bench.identification.judged_fit import changes
from norton_bench.loop.timing import LoopTiming, loop_timing, timing_rows, timing_sentence
from norton_bench.on_demand import deferred
from norton_bench.records import FOR_PROGRAMS, Table
from norton_bench.report.figures_fit import live_figure, residual_figure, timing_figure, validation_figure
from norton_bench.report.figures_network import (
    bench_time_s,
    blocked_figure,
    impedance_figure,
    presliding_loops,
    sliding_samples,
    source_map_figure,
)
from norton_bench.report.sections_checks import (
    friction_section,
    model_error_section,
    residuals_section,
    source_sentences,
    without_model_section,
)
from norton_bench.report.streams import StreamQuality, stream_qualities
from norton_bench.report.svg import picture
from norton_bench.report.words import Facts, Section, interval, number, percent, pretty_unit, to_its_digits
from norton_bench.result import Result


def _of_steps(name: str, *parts: str) -> Callable[[Result], Section | None]:
    """A section on steps that few sessions have; its module is imported where the result has one of its ``parts``."""
    section = deferred(f"norton_bench.report.sections_tables:{name}")

    def make(data: Result) -> Section | None:
        measured = any(getattr(data, part) for part in parts)
        return section(data) if measured else None

    return make


def sections(data: Result) -> list[Section]:
    """The sections with data, in the order of the page."""
    made = [make(data) for make in MAKERS]
    return [section for section in made if section is not None]


def conditions_section(data: Result) -> Section | None:
    """The paper's three conditions for a network that measurements at its port determine."""
    if not data.conditions:
        return None
    head = ("condition", "result", "judged by", "value", "95 % interval", "unit")
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
    lead = (
        "Can measurements at the output shaft (the port) alone determine the model, and only one model? "
        "Three conditions decide that (Hogan 2014)."
    )
    points = tuple(map(str, data.conditions))
    return Section("conditions", "Is the model unique?", (lead,), tables=(Facts(head, rows),), points=points)


def source_section(data: Result) -> Section | None:
    if data.source_map is None and data.network is None:
        return None
    drawn = picture(
        source_map_figure(data.source_map, data.network, data.command_unit),
        "source",
        "Read off which speed a command gives on a free shaft, and whether the model agrees with the measurement.",
        "Steady velocity with no torque at the port, against command. Where the command is too weak for friction "
        "the shaft rests; beyond, the velocity follows two straight lines. Below: measured minus model. Bars and bands "
        "are 95 % intervals.",
    )
    sentences = ["The motion of the actuator when nothing holds or drives its shaft."]
    if data.network is not None:
        unit = pretty_unit(data.command_unit)
        low, high = (f"{number(threshold, 3)} {unit}".strip() for threshold in data.network.thresholds)
        sentences.append(
            f"The shaft rests for commands between {low} and {high}; beyond, it turns."
            if np.isfinite(data.network.thresholds).all()
            else "The torque saturates before it overcomes friction: no command turns the shaft from rest."
        )
    if data.source_map is not None:
        sentences += source_sentences(data.source_map, pretty_unit(data.command_unit))
    return Section("source", "The motion source", tuple(sentences), (drawn,))


def impedance_section(data: Result) -> Section | None:
    if data.fit is None or data.measured is None:
        return None
    network = data.fit.network
    deflection_rad = network.coulomb_torque_nm / network.presliding_stiffness_nm_rad
    loops = presliding_loops(data.measured, data.fit.trace, deflection_rad)
    sliding = sliding_samples(data.measured, data.fit.trace)
    if not loops and sliding is None:
        return None
    sentences = (
        "The torque that the actuator exerts when its shaft is made to move otherwise than the motion source.",
        f"The friction contact deflects by {number(1e3 * deflection_rad, 3)} mrad before it slides (τc/σ0).",
    )
    drawn = picture(
        impedance_figure(loops, sliding),
        "impedance",
        "Compare the model's torque with the measured one, for motions too small to slide and for steady sliding.",
        "Left: torque against position in small loops; the area of a loop is energy lost to friction. Right: torque "
        "against velocity; the slope is viscous damping, the step at zero velocity is friction.",
    )
    return Section("impedance", "The impedance", sentences, (drawn,))


def blocked_section(data: Result) -> Section | None:
    if data.blocked_map is None or not np.isfinite(data.blocked_map.torque_nm).any():
        return None
    drawn = picture(
        blocked_figure(data.blocked_map, data.network, data.command_unit),
        "blocked",
        "Read off the torque at standstill, and how far friction makes it uncertain.",
        "Torque at standstill against command. The same command gives different torques, by how the shaft came to "
        "rest: friction may hold any torque between −τc and +τc (the band). Bars are 95 % intervals.",
    )
    return Section("blocked", "Torque at standstill", (), (drawn,))


def fit_section(data: Result) -> Section | None:
    fit = data.fit
    if fit is None:
        return None
    residual = fit.trace.measured - fit.trace.predicted
    delays = "; ".join(
        f"{name} {to_its_digits(1e3 * delay_s, 1e3 * std_s)} ms (95 % interval {interval(1e3 * delay_s, 1e3 * std_s)})"
        for name, delay_s, std_s in (
            ("command", fit.command_delay_s, fit.command_delay_std_s),
            ("motion", fit.motion_delay_s, fit.motion_delay_std_s),
        )
    )
    sentences = (
        f"The fit {'converged' if fit.converged else 'did not converge'} on {fit.samples:,} samples.".replace(",", " "),
        f"The residual (measured minus model) is {number(1e3 * fit.torque_rms_nm, 3)} mN·m rms, "
        f"{percent(fit.torque_relative)} of the torque.",
        f"Delays relative to the torque readings: {delays}.",
    )
    if not np.isfinite(residual).any():
        return Section("fit", "The fit", sentences)
    drawn = picture(
        residual_figure(fit.trace),
        "residuals",
        "Check that the error looks like noise: no stretch worse than others, no long tails.",
        "Residual of the torque over time, and how often each size occurs.",
    )
    return Section("fit", "The fit", sentences, (drawn,))


def validation_section(data: Result) -> Section | None:
    checked = data.validation
    if checked is None:
        return None
    sentences = (
        "A part of the session was kept apart from the fit and is predicted here: a fair test of the model.",
        "The torque under a measured motion is predicted with an rms error of "
        f"{number(1e3 * checked.torque_rms_nm, 3)} mN·m, {percent(checked.torque_relative)} of the torque.",
        "The free velocity under a command is predicted with an rms error of "
        f"{number(checked.velocity_rms_rad_s, 3)} rad/s, {percent(checked.velocity_relative)} of the velocity.",
    )
    figures = tuple(
        picture(validation_figure(trace, what), f"validation-{what}", purpose, caption)
        for trace, what, purpose, caption in (
            (
                checked.torque,
                "torque",
                "Judge how well the model predicts the torque that a load would feel.",
                "Torque at the port, measured, and predicted from the measured motion and the command.",
            ),
            (
                checked.velocity,
                "velocity",
                "Judge how well the model predicts the motion of the free shaft.",
                "Free velocity, measured, and predicted from the command alone.",
            ),
        )
        if np.isfinite(trace.measured).any()
    )
    return Section("validation", "Prediction of motion kept apart from the fit", sentences, figures)


def live_section(data: Result) -> Section | None:
    if not any(state.estimates for state in data.live) or data.measured is None:
        return None
    time_s = bench_time_s(data.measured, [state.stamp_ns for state in data.live])
    drawn = picture(
        live_figure(data.live, time_s, data.fit),
        "live",
        "See whether the session was long enough: the curves should have become flat well before its end.",
        "Estimates while the bench was running, with bands of 95 %; the line is the final fit. The scale "
        "is that of the last two thirds, so the beginning may lie outside.",
    )
    return Section("live", "How the estimates converged", _beside_final(data), (drawn,))


def _beside_final(data: Result) -> tuple[str, ...]:
    """How far the last live values are from the final ones."""
    compared = () if data.fit is None else changes(data.live[-1].estimates, data.fit)
    if not compared:
        return ()
    furthest = max(compared, key=lambda change: abs(change.deviations))
    return (
        f"The last live values of {len(compared)} parameters lie within {abs(furthest.deviations):.1f} standard "
        f"deviations of the final ones; {furthest.final.name.replace('_', ' ')} is the furthest off.",
    )


def timing_section(data: Result) -> Section | None:
    if data.measured is None or not len(data.measured.ticks):
        return None
    ticks = data.measured.ticks
    timing = loop_timing(ticks)
    qualities = stream_qualities(data.measured)
    drawn = picture(
        timing_figure(ticks),
        "timing",
        "Check that the control loop kept its time, so that the readings can be trusted.",
        "How late each cycle (tick) of the loop began, how long it took, and how old the readings were that it used.",
    )
    return Section(
        "timing",
        "Timing and lost readings",
        ((timing_sentence(timing), _clipping(ticks)) if timing is not None else (_clipping(ticks),)),
        (drawn,),
        (*_timing_table(timing), *((_stream_table(qualities),) if qualities else ())),
    )


def events_section(data: Result) -> Section | None:
    if data.measured is None or not data.measured.events:
        return None
    events = [event for event in data.measured.events if event.kind not in FOR_PROGRAMS]
    times_s = bench_time_s(data.measured, [event.stamp_ns for event in events])
    rows = tuple((f"{time_s:.3f}", event.kind, event.text) for time_s, event in zip(times_s, events, strict=True))
    if not rows:
        return None
    return Section("events", "Events", tables=(Facts(("bench time [s]", "kind", "what"), rows),))


def _timing_table(timing: LoopTiming | None) -> tuple[Facts, ...]:
    """Nothing, where time waited for the loop."""
    return () if timing is None or timing.in_lock_step else (Facts(*timing_rows(timing)),)


def _clipping(ticks: Table) -> str:
    counts = {limit: int(np.count_nonzero(ticks["limited"] & limit.value)) for limit in Limited}
    clipped = [f"{limit.name.lower().replace('_', ' ')} in {n}" for limit, n in counts.items() if n and limit.name]
    return f"The guard clipped {', '.join(clipped)} ticks." if clipped else "The guard clipped no command."


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


MAKERS: tuple[Callable[[Result], Section | None], ...] = (
    conditions_section,
    _of_steps("tabulated_source_section", "source"),
    _of_steps("exertion_section", "exertion"),
    _of_steps("modulation_section", "source", "exertion", "modulator"),
    _of_steps("two_ports_section", "source"),
    source_section,
    impedance_section,
    validation_section,
    model_error_section,
    without_model_section,
    fit_section,
    residuals_section,
    friction_section,
    blocked_section,
    _of_steps("trials_section", "trials"),
    _of_steps("rendered_section", "rendered"),
    _of_steps("in_situ_section", "in_situ"),
    live_section,
    timing_section,
    events_section,
)
