"""The sheet's tables and sentences, as text: the same on the page and on paper."""

from collections.abc import Iterator, Sequence
from math import hypot, isfinite, pi

from norton_bench.datasheet.ripple import Order, Wave
from norton_bench.datasheet.sheet import LEVEL, Difference, Sheet, SheetValue
from norton_bench.distributions import normal_quantile
from norton_bench.identification.statistics import tail_of_each
from norton_bench.models.derived import BANDWIDTH, Figure, OperatingPoint
from norton_bench.models.parameters import Parameter, Status
from norton_bench.report.words import NO_NUMBER as NONE
from norton_bench.report.words import Facts, between, number, parameter_named, pretty_unit, within


def parameter_table(sheet: Sheet) -> Facts:
    """The network's own numbers."""
    statuses = any(each.status for each in sheet.parameters)
    head = ("", "parameter", "value", "95 % interval", "unit", *(("status",) if statuses else ()))
    return Facts(head, tuple(_parameter(each, statuses=statuses) for each in sheet.parameters))


def figure_table(sheet: Sheet) -> Facts:
    """What follows from them. A figure is as good as the worst parameter in it."""
    head = ("", "figure", "value", "95 % interval", "unit", "valid at")
    figures = sheet.figures()
    before = [None, *(figure.row for figure in figures)]
    rows = tuple(_figure(each, sheet, again=each.row is row) for each, row in zip(figures, before, strict=False))
    return Facts(head, rows)


def parameter_difference_table(first: Sheet, second: Sheet) -> Facts:
    """Both networks' numbers; the difference is B − A, with the interval of independent values."""
    other = {each.name: each for each in second.parameters}
    pairs = [(each, other[each.name]) for each in first.parameters if each.name in other]
    alike = sum(one.unit == two.unit for one, two in pairs)
    beyond = -normal_quantile(tail_of_each(max(alike, 1)))
    return Facts(_SIDE_BY_SIDE, tuple(row for pair in pairs for row in _parameter_difference(*pair, beyond)))


def difference_table(differences: Sequence[Difference]) -> Facts:
    """Every figure of both."""
    return Facts(_SIDE_BY_SIDE, tuple(row for each in differences for row in _difference(each)))


_SIDE_BY_SIDE = ("", "figure", "A", "B", "B − A, 95 % interval", "unit", "remark")
_DIFFERS = "differs"


def order_table(sheet: Sheet) -> Facts | None:
    """Cogging and ripple by order; None where nothing stands out."""
    evidence = [each for each in sheet.evidence.orders if each.is_torque]
    if not evidence:
        return None
    head = ("periods a turn", "cogging [mN·m]", "95 % interval", "ripple [% of the torque]", "95 % interval")
    rows = tuple(
        (f"{each.periods_per_turn:.4g}", *_wave(each.cogging_nm, 1e3), *_wave(each.ripple, 100.0)) for each in evidence
    )
    return Facts(head, rows)


def valid_where(figure: Figure, sheet: Sheet) -> str:
    """At which operating point a figure stands, and whether the network was seen to hold there."""
    unit = pretty_unit(sheet.network.command_unit)
    words = [_measured(figure, sheet)] if figure.at is None else [_at(figure.at, figure, unit)]
    if figure.extrapolated:
        words.append(_beyond(figure))
    if not figure.settled and figure.status is not None:
        words.append(figure.status.value)
    return "; ".join(words)


def _beyond(figure: Figure) -> str:
    """The speed without a load is often more than was measured, and than the rig allows: then it says so."""
    at = figure.at
    if at is not None and figure.row.name == "no_load_speed" and figure.value > at.velocity_rad_s:
        return f"extrapolated beyond {number(at.velocity_rad_s, 3)} rad/s"
    return "extrapolated"


def _measured(figure: Figure, sheet: Sheet) -> str:
    """A bandwidth is the model's where no point of the torque's frequency response lies so high."""
    spectra = sheet.evidence.spectra
    if BANDWIDTH not in figure.row.needs or spectra is None or not spectra.torque.frequency_hz.size:
        return "measured range"
    last_hz = float(spectra.torque.frequency_hz.max())
    beyond = sheet.network.amplifier_bandwidth_rad_s > 2 * pi * last_hz
    return f"by the model: points end at {number(last_hz, 2)} Hz" if beyond else "measured range"


def range_sentence(sheet: Sheet) -> str:
    """Where the network was seen to hold, and how well."""
    prediction, unit = sheet.network.prediction, pretty_unit(sheet.network.command_unit) or "N·m"
    if prediction is None or not prediction.ranges:
        return "Where this network was seen to hold is not known: its file does not say."
    spans = {"velocity": "rad/s", "acceleration": "rad/s²", "command": unit}
    seen = ", ".join(
        f"{name} {number(prediction.ranges[name][0], 3)} to {number(prediction.ranges[name][1], 3)} {spans[name]}"
        for name in spans
        if name in prediction.ranges
    )
    off = [f"{number(1e3 * prediction.torque_nm, 2)} mN·m of torque"] if isfinite(prediction.torque_nm) else []
    if isfinite(prediction.velocity_rad_s):
        off.append(f"{number(prediction.velocity_rad_s, 2)} rad/s of free velocity")
    share = f"{100 * prediction.level:.0f} % of" if isfinite(prediction.level) else "of"
    held = f"Valid where it was measured: {seen}."
    return (
        f"{held} There, {share} motions that were not fitted were predicted to within {' and '.join(off)} (rms)."
        if off
        else held
    )


# By whether the motor's current and the supply's voltage were recorded: power needs both of one place.
_BOTH = (
    "the current of the motor and the voltage of the supply were recorded, but neither the current from the supply nor "
    "the voltage at the motor"
)
_ELECTRICAL = {
    (True, True): _BOTH,
    (True, False): "the current of the motor was recorded, but no voltage",
    (False, True): "the voltage of the supply was recorded, but no current",
    (False, False): "no current and no voltage were recorded",
}


def remarks(sheet: Sheet) -> Iterator[str]:
    """What was measured and shows nothing, and what was not measured: said, so that nobody looks for it."""
    evidence = sheet.evidence
    if "scale" in sheet.network.provenance:
        yield "No torque was measured: only figures that need no torque scale are given."
    if not sheet.recorded:
        yield "From the network alone: measured points, cogging and free play are in its recording."
        return
    if evidence.gap is not None:
        yield _gap_sentence(sheet)
    if evidence.order_nm.size and not any(order.is_torque for order in evidence.orders):
        yield "No cogging and no ripple stands out from the noise."
    yield from map(_angle_sentence, (order for order in evidence.orders if order.angle_error_rad.shows))
    missing = _ELECTRICAL[evidence.has_current, evidence.has_supply]
    yield f"There is no electrical efficiency: {missing}. Mechanical efficiency holds friction's losses alone."
    yield _warming_sentence(sheet)


def _angle_sentence(order: Order) -> str:
    error = order.angle_error_rad
    return (
        f"The measured angle has an error of {within(1e3 * error.amplitude, 1e3 * error.half_width)} mrad that repeats "
        f"{order.periods_per_turn:.4g} times a turn."
    )


def _gap_sentence(sheet: Sheet) -> str:
    gap = sheet.evidence.gap
    assert gap is not None
    if gap.is_gap:
        value, span = between(1e3 * gap.width_rad, (1e3 * gap.interval_rad[0], 1e3 * gap.interval_rad[1]))
        return f"Free play at the port: {value} mrad ({span}): over that range the port exerts nothing."
    most = number(1e3 * max(gap.interval_rad[1], gap.crossing_rad), 2)
    return f"Small loops show no free play wider than {most} mrad."


def _warming_sentence(sheet: Sheet) -> str:
    warming = sheet.evidence.warming
    if warming is None:
        return "No temperature was recorded, so nothing is said of friction against it."
    span = f"{number(warming.from_c, 3)} to {number(warming.to_c, 3)} °C"
    if not isfinite(warming.change_nm):
        return f"The drive's temperature stayed within {span}: too little to tell what warmth does to friction."
    change, half = 1e3 * warming.change_nm, 1e3 * warming.half_width_nm
    value, interval = between(change, (change - half, change + half))
    return f"While the drive's temperature went from {span}, friction changed by {value} mN·m ({interval})."


def _parameter(each: SheetValue, *, statuses: bool) -> tuple[str, ...]:
    value, interval = between(each.shown, each.interval)
    row = _described(each.name)
    shown = interval if each.settled else NONE
    status = (each.status.value if each.status else "",) if statuses else ()
    return (row.symbol, row.meaning, value, shown, pretty_unit(each.unit), *status)


def _figure(figure: Figure, sheet: Sheet, *, again: bool) -> tuple[str, ...]:
    """What a figure is stands with the first of its operating points alone."""
    value, interval = between(figure.shown, figure.interval)
    shown = interval if figure.settled else NONE
    words = figure.words if again else f"{figure.words}: {figure.row.meaning}"
    return (figure.row.symbol, words, value, shown, pretty_unit(figure.unit), valid_where(figure, sheet))


def _described(name: str) -> Parameter:
    return parameter_named(name) or Parameter(name, name, "", name)


def _parameter_difference(first: SheetValue, second: SheetValue, beyond: float) -> Iterator[tuple[str, ...]]:
    """``beyond`` is how many standard deviations the two must be apart to differ."""
    row, apart = _described(first.name), second.value - first.value
    std = hypot(first.std, second.std)
    known, alike = first.settled and second.settled, first.unit == second.unit
    units = pretty_unit(first.unit) if alike else ", ".join(pretty_unit(x.unit) or "1" for x in (first, second))
    span = between(apart, (apart - LEVEL * std, apart + LEVEL * std))[1] if known and alike else NONE
    yield (
        row.symbol,
        row.meaning,
        *(between(each.shown, each.interval)[0] for each in (first, second)),
        span,
        units,
        _DIFFERS if known and alike and abs(apart) > beyond * std else "",
    )
    yield _below(first, second, _said_of_both([_status_words(each) for each in (first, second)]))


def _difference(each: Difference) -> Iterator[tuple[str, ...]]:
    first, second = each.first, each.second
    known = first.settled and second.settled
    words = first.words
    if first.at is not None:
        words += f" ({first.at.name}, {number(first.at.command, 3)})"
    yield (
        first.row.symbol,
        words,
        *(between(figure.shown, figure.interval)[0] for figure in (first, second)),
        between(each.value, each.interval)[1] if known else NONE,
        pretty_unit(first.unit),
        _DIFFERS if each.significant else "",
    )
    marks = [
        "; ".join(filter(None, (_beyond(figure) if figure.extrapolated else "", _status_words(figure))))
        for figure in (first, second)
    ]
    yield _below(first, second, _said_of_both(marks))


def _below(first: SheetValue | Figure, second: SheetValue | Figure, remark: str) -> tuple[str, ...]:
    """The row with the interval of each."""
    spans = (between(each.shown, each.interval)[1] if each.settled else NONE for each in (first, second))
    return ("", "95 % interval", *spans, "", "", remark)


def _status_words(each: SheetValue | Figure) -> str:
    """Nothing for what is valid."""
    return "" if each.status in (None, Status.VALID) else str(each.status.value)


def _said_of_both(words: Sequence[str]) -> str:
    """Once where it is the same of both, else with the letter of the sheet."""
    if words[0] == words[1]:
        return words[0]
    return "; ".join(f"{letter}: {said}" for letter, said in zip("AB", words, strict=True) if said)


def _wave(wave: Wave, factor: float) -> tuple[str, str]:
    """Nothing where nothing stands out."""
    if not wave.shows:
        return NONE, f"below {number(factor * (wave.amplitude + wave.half_width), 2)}"
    amplitude, half = factor * wave.amplitude, factor * wave.half_width
    return between(amplitude, (amplitude - half, amplitude + half))


def _at(point: OperatingPoint, figure: Figure, unit: str) -> str:
    """ "at 0.08 N·m, 51 rad/s (as excited)", with what of the two matters."""
    parts = []
    if "torque_gain" in figure.row.needs:
        parts.append(f"{number(point.command, 3)} {unit or 'N·m'}")
    if figure.row.velocity is not None and isfinite(point.velocity_rad_s) and figure.row.name != "no_load_speed":
        parts.append(f"{number(point.velocity_rad_s, 3)} rad/s")
    return f"{', '.join(parts)}, {point.name}"
