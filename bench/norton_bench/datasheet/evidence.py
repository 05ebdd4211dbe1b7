"""What a recording adds to its network: points measured at the port, and effects that the network does not contain."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.datasheet.ripple import LEVEL, Folded, Order, OrderWave, Samples, folded, orders
from norton_bench.datasheet.spectra import Piece, Spectra, spectra
from norton_bench.identification.cleaning import clean
from norton_bench.identification.conditions import ZeroRange, zero_range
from norton_bench.identification.residual_tests import ResidualTests
from norton_bench.identification.results import FitResult
from norton_bench.identification.rows import Aligned, align
from norton_bench.identification.signals import Signals, signals
from norton_bench.identification.statistics import sandwich
from norton_bench.identification.turns import strongest_period
from norton_bench.identification.validation import is_free, network_trace
from norton_bench.models.network import NortonNetwork
from norton_bench.records import Measured, SegmentInfo
from norton_bench.report.figures_network import ImpedanceLoop, bench_time_s, presliding_loops, sliding_samples
from norton_bench.segments import Use

# A drive tells its temperature about so exactly; a span no wider says nothing of what warmth does.
TOLD_K = 1.0
# A velocity held for less is on the way to another.
FEWEST_TICKS = 50


@dataclass(frozen=True)
class Warming:
    """What the drive's temperature [°C] did during the recording, and by how much friction was greater at its warmest
    than at its coldest [N m], with half of the interval of 95 %; NaN where the span is too narrow to tell."""

    from_c: float
    to_c: float
    change_nm: float = float("nan")
    half_width_nm: float = float("nan")


@dataclass(frozen=True)
class Sliding:
    """Steady velocities under one command: torque measured beside what the network makes of the motion."""

    command: float
    samples: ImpedanceLoop


@dataclass(frozen=True)
class Evidence:
    """Parts that the recording does not hold are None or empty."""

    spectra: Spectra | None = None
    orders: tuple[Order, ...] = ()
    folded: Folded | None = None
    order_nm: FloatArray = field(default_factory=lambda: np.empty(0))  # amplitude by whole periods a turn, from 1 on
    loops: tuple[ImpedanceLoop, ...] = ()
    sliding: tuple[Sliding, ...] = ()
    gap: ZeroRange | None = None
    warming: Warming | None = None
    has_current: bool = False  # of the actuator's motor
    has_supply: bool = False  # the voltage at its drive


def evidence(fit: FitResult, measured: Measured, tests: ResidualTests | None, tick_s: float) -> Evidence:
    """Of the recording that ``fit`` is of. Without measured torque little is left."""
    warming = _span_of_temperature(measured)
    has_supply = bool(np.isfinite(measured.ticks["supply_v"]).any())
    told = Evidence(warming=warming, has_current=bool(len(measured.current)), has_supply=has_supply)
    cleaned = clean(measured).measured
    stretches = signals(cleaned, tick_s, Use.IDENTIFY)
    if fit.ratios_only or any(each.torque_nm is None for each in stretches):
        return told
    aligned = align(stretches, fit.motion_delay_s)
    samples, known = _samples(fit, aligned, stretches)
    network = fit.network
    lines = orders(samples, {each: _line(aligned, each, network, known) for each in _periods(fit, samples, tests)})
    lines = tuple(_as_fitted(each, fit) for each in lines)
    deflection_rad = network.coulomb_torque_nm / network.presliding_stiffness_nm_rad
    return replace(
        told,
        spectra=_spectra(fit, cleaned, tick_s),
        orders=lines,
        folded=folded(samples, lines[0].periods_per_turn) if lines and lines[0].is_torque else None,
        order_nm=np.empty(0) if tests is None else tests.spectrum_nm,
        loops=tuple(_without_zero(loop, fit) for loop in presliding_loops(measured, fit.trace, deflection_rad)),
        sliding=tuple(_sliding(measured, fit)),
        gap=zero_range(
            aligned,
            measured.segments,
            inertia_kgm2=network.inertia_kgm2,
            bias_nm=fit.torque_bias_nm,
            noise_nm=fit.torque_rms_nm,
        ),
        warming=_friction_over(warming, samples, measured),
    )


def _spectra(fit: FitResult, measured: Measured, tick_s: float) -> Spectra | None:
    """From every multisine that was imposed on the port, whatever its samples were for."""
    pieces = []
    for use in (Use.IDENTIFY, Use.VALIDATE):
        wanted = [each.index for each in measured.segments if each.use is use and _imposed_multisine(each)]
        if wanted:
            pieces += _pieces(measured, align(signals(measured, tick_s, use), fit.motion_delay_s), wanted)
    return spectra(pieces, tick_s, fit.command_delay_s)


def _imposed_multisine(segment: SegmentInfo) -> bool:
    return "multisine" in segment.name and not is_free(segment)


def _pieces(measured: Measured, stretches: Sequence[Aligned], wanted: Sequence[int]) -> list[Piece]:
    ticks_s = bench_time_s(measured, measured.ticks["tick_ns"])
    asked = np.nan_to_num(measured.ticks["reference_velocity_rad_s"])
    return [
        Piece(
            each.command[rows],
            each.velocity_rad_s[rows],
            each.torque_nm[rows],
            np.interp(each.signals.time_s[rows], ticks_s, asked),
        )
        for each in stretches
        for index in wanted
        if (rows := each.signals.segment == index).any()
    ]


def _samples(fit: FitResult, aligned: Sequence[Aligned], stretches: tuple[Signals, ...]) -> tuple[Samples, BoolArray]:
    """What the network leaves of the torque, and which of all instants it is known at."""
    trace = network_trace(fit, stretches)

    def joined(values: Sequence[FloatArray]) -> FloatArray:
        return cast("FloatArray", np.concatenate(values))

    residual = trace.measured - trace.predicted
    known = np.isfinite(residual)
    samples = Samples(
        joined([each.signals.time_s for each in aligned])[known],
        joined([each.position_rad for each in aligned])[known],
        joined([each.velocity_rad_s for each in aligned])[known],
        fit.network.torque_gain * joined([each.command for each in aligned])[known],
        residual[known],
        stretches[0].tick_s,
    )
    return samples, known


def _line(aligned: Sequence[Aligned], periods: float, network: NortonNetwork, known: BoolArray) -> OrderWave:
    """Of so many periods a turn, at the instants that the residual is ``known`` at."""
    wave, velocity, acceleration = np.concatenate(
        [
            np.stack(
                [
                    each.rows.of_fine_signal(form(periods * each.signals.position_rad), (0, 1, 2), each.motion_delay_s)
                    for form in (np.cos, np.sin)
                ],
                axis=1,
            )
            for each in aligned
        ],
        axis=2,
    )[:, :, known]
    return OrderWave(wave, network.inertia_kgm2 * acceleration + network.viscous_damping_nms_rad * velocity)


def _periods(fit: FitResult, samples: Samples, tests: ResidualTests | None) -> tuple[float, ...]:
    """Where something may stand out: what the fit and its tests found, and what goes with the torque as well."""
    result = [each.periods_per_turn for each in fit.cogging]
    result += [] if tests is None else [each.periods_per_turn for each in tests.harmonics]
    size = float(np.sqrt(np.mean(samples.drive_nm**2)))
    if size > 0.0:
        with_torque = strongest_period(samples.position_rad, samples.residual_nm * samples.drive_nm / size, 1.0)
        result += [] if with_torque is None else [with_torque]
    return tuple(dict.fromkeys(result))


def _as_fitted(order: Order, fit: FitResult) -> Order:
    """With the cogging that the network has, where it has this line: there nothing else of the torque is in its way."""
    for wave in fit.cogging:
        if wave.periods_per_turn == order.periods_per_turn:
            fitted = replace(order.cogging_nm, amplitude=wave.amplitude_nm, half_width=wave.half_interval_nm)
            return replace(order, cogging_nm=fitted)
    return order


def _sliding(measured: Measured, fit: FitResult) -> Iterator[Sliding]:
    for segment in measured.segments:
        if segment.procedure == "imposed" and segment.name.startswith("grid"):
            samples = sliding_samples(replace(measured, segments=tuple(_settled(measured, segment))), fit.trace)
            if samples is not None:
                yield Sliding(_command(measured, segment), _without_zero(samples, fit))


def _settled(measured: Measured, segment: SegmentInfo) -> Iterator[SegmentInfo]:
    """The last half of each velocity that is held: before, the shaft is still on its way there."""
    ticks = measured.ticks
    inside = np.flatnonzero((ticks["tick_ns"] >= segment.start_ns) & (ticks["tick_ns"] < segment.end_ns))
    asked = ticks["reference_velocity_rad_s"][inside]
    for run in np.split(inside, np.flatnonzero(np.diff(asked) != 0.0) + 1):
        if run.size >= FEWEST_TICKS:
            start, end = (int(ticks["tick_ns"][at]) for at in (run[run.size // 2], run[-1]))
            yield replace(segment, start_ns=start, end_ns=end)


def _without_zero(loop: ImpedanceLoop, fit: FitResult) -> ImpedanceLoop:
    """Without what the sensor reads when nothing is at the port."""
    zero_nm = fit.torque_bias_nm
    return replace(loop, measured_nm=loop.measured_nm - zero_nm, predicted_nm=loop.predicted_nm - zero_nm)


def _command(measured: Measured, segment: SegmentInfo) -> float:
    ticks = measured.ticks[
        (measured.ticks["tick_ns"] >= segment.start_ns) & (measured.ticks["tick_ns"] < segment.end_ns)
    ]
    return float(np.median(ticks["command"])) if len(ticks) else float("nan")


def _span_of_temperature(measured: Measured) -> Warming | None:
    value = measured.ticks["transistor_temperature_c"]
    known = value[np.isfinite(value)]
    return Warming(float(np.min(known)), float(np.max(known))) if known.size else None


def _friction_over(warming: Warming | None, samples: Samples, measured: Measured) -> Warming | None:
    """The residual's part that goes with direction and temperature together, over the whole span."""
    if warming is None or warming.to_c - warming.from_c < TOLD_K:
        return warming
    ticks = measured.ticks
    known = np.isfinite(ticks["transistor_temperature_c"])
    time_s = bench_time_s(measured, ticks["tick_ns"])
    warmth = np.interp(samples.time_s, time_s[known], ticks["transistor_temperature_c"][known])
    direction = -np.sign(samples.velocity_rad_s)
    columns = np.stack([direction * (warmth - np.mean(warmth)), direction, np.ones(direction.size)], axis=1)
    values = np.linalg.lstsq(columns, samples.residual_nm, rcond=None)[0]
    covariance = sandwich(columns, samples.residual_nm - columns @ values, samples.time_s)
    span = warming.to_c - warming.from_c
    return replace(
        warming, change_nm=float(values[0] * span), half_width_nm=float(LEVEL * np.sqrt(covariance[0, 0]) * span)
    )
