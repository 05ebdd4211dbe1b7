"""The state of devices, buses and the loop, a row for each."""

from itertools import groupby
from math import isfinite
from textwrap import wrap

from norton_bench.jog.signals import SignalValue
from norton_bench.loop.timing import Spread, loop_timing
from norton_bench.report.words import pretty_unit
from norton_bench.screen.picture.parts import BenchHealth, DeviceState
from norton_bench.screen.picture.picture import Picture
from norton_bench.screen.styles import (
    BAD,
    GOOD,
    HEADING,
    LABEL,
    STRONG,
    TEXT,
    UNIT,
    WARNING,
    Row,
    apart,
    fitted,
    heading,
)

SIGNS = {"ok": ("●", GOOD), "silent": ("✗", BAD), "trouble": ("▲", WARNING), "unheard": ("○", LABEL)}
LOOKED_BACK_S = 5.0
WITH_PLACE, WITH_LOST = 56, 74
STAGE = 22  # columns before the numbers of the loop, where there is room
STAGE_NUMBERS = 25
NAME, KIND, RATE, AGE, TEMPERATURE, LOST = 14, 14, 9, 9, 7, 10


def health_rows(picture: Picture, width: int, height: int) -> list[Row]:
    """Devices, buses, the loop; where there is room also the last trouble of each."""
    health = picture.health
    rows = [heading("Bench", "", in_short(health), width)]
    pulses = [*health.devices(), *health.buses()]
    rows += [_pulse(pulse, width) for pulse in pulses] + _loop(picture, width)
    troubles = [row for each in pulses if each.said for row in _trouble(f"{each.name}: {each.said}", width)]
    return [fitted(row, width) for row in (*rows, *troubles)][:height]


def _trouble(said: str, width: int) -> list[Row]:
    first, *others = wrap(said, max(width - 2, 1))
    return [[("▲ ", WARNING), (first, LABEL)], *([("  ", LABEL), (other, LABEL)] for other in others)]


def in_short(health: BenchHealth) -> str:
    """The names of those with trouble; empty where there is none."""
    bad = [pulse.name for pulse in (*health.devices(), *health.buses()) if pulse.state in ("silent", "trouble")]
    return f"look at {', '.join(bad)}" if bad else ""


def _pulse(pulse: DeviceState, width: int) -> Row:
    sign, style = SIGNS[pulse.state]
    left: Row = [(f"{sign} ", style), (pulse.name.ljust(NAME), TEXT)]
    if width >= WITH_PLACE:
        left.append((pulse.kind.ljust(KIND)[:KIND], LABEL))
    numbers = _known(pulse.rate_hz, "{:.0f} Hz").rjust(RATE) + _known(pulse.age_ms, "{:.1f} ms").rjust(AGE)
    if width >= WITH_LOST:
        numbers += (f"{pulse.lost} lost" if pulse.lost else "").rjust(LOST)
    numbers += _known(pulse.temperature_c, "{:.0f} °C").rjust(TEMPERATURE)
    if not numbers.strip():
        return [*left, (pulse.place, UNIT)]
    return apart(left, [(numbers if pulse.state != "unheard" else "no data yet", LABEL)], width)


def _known(value: float, form: str) -> str:
    return form.format(value) if isfinite(value) else ""


def _loop(picture: Picture, width: int) -> list[Row]:
    """Lateness, work and stages of the last seconds; in lock step nothing can be late."""
    tick_ns = picture.rig.tick_ns
    timing = loop_timing(picture.recent.rows()[-round(LOOKED_BACK_S * 1e9 / tick_ns) :])
    rate = f"{1e9 / tick_ns:.0f} Hz"
    if timing is None:
        return [[("○ ", LABEL), ("loop".ljust(NAME), TEXT), (rate, LABEL)]]
    sign, style = SIGNS["trouble" if timing.skipped else "ok"]
    left: Row = [(f"{sign} ", style), ("loop".ljust(NAME), TEXT), (rate, LABEL)]
    if timing.in_lock_step:
        return [apart(left, [("lock step, never late", LABEL)], width)]
    stage = min(STAGE, width - STAGE_NUMBERS)
    skipped = f"{timing.skipped} of {timing.ticks + timing.skipped} skipped" if timing.skipped else "no tick skipped"
    return [
        apart(left, [(skipped, WARNING if timing.skipped else LABEL)], width),
        [("".ljust(stage), LABEL), ("   p50     p99    most  µs", UNIT)],
        *(
            _spread(name, spread, stage)
            for name, spread in (("late", timing.lateness), ("work", timing.work), *timing.stages)
        ),
    ]


def _spread(name: str, spread: Spread, stage: int) -> Row:
    levels = (spread.median_ns, spread.p99_ns, spread.most_ns)
    return [
        (f"    {name:<{max(stage - 4, 0)}}", LABEL),
        (" ".join(f"{level * 1e-3:>7.0f}" for level in levels)[1:], TEXT),
    ]


DEVICE, SIGNAL, NUMBER, UNIT_WIDTH, SIGNAL_AGE = 10, 15, 11, 7, 10
# Decimals that can be read while they change.
DECIMALS = {"°C": 1, "V": 2, "A": 3, "rad/s": 3, "W": 3}
USUAL_DECIMALS = 4
BEFORE = "last values"
SIGNALS_WIDTH = DEVICE + SIGNAL + 3 * NUMBER + UNIT_WIDTH + 1 + SIGNAL_AGE
# The same in a phone's columns; the age is in milliseconds.
NARROW_SIGNAL, NARROW_NOW, NARROW_AGE, NARROW_END = 18, 8, 4, 7
OLDEST_MS = 999


def signal_rows(
    seen: tuple[SignalValue, ...], stale_after_s: float, width: int, height: int, *, live: bool
) -> list[Row]:
    """Every signal of the bench: now, how old, least and greatest since the start.

    A row for each signal; with an empty row between devices where there is room. An age above ``stale_after_s`` is
    marked. Where the row has no room, the device stands above its signals, and numbers have fewer digits.
    """
    if width < SIGNALS_WIDTH:
        return _narrow_signals(seen, stale_after_s, width, live=live)[:height]
    rows = [heading("Signals", "", "" if live else BEFORE, width), _names()]
    devices = [list(group) for _, group in groupby(seen, key=lambda each: each.device)]
    apart = height >= len(rows) + len(seen) + len(devices) - 1
    for number, signals in enumerate(devices):
        if apart and number:
            rows.append([])
        rows += [_row(each, stale_after_s, first=place == 0) for place, each in enumerate(signals)]
    return [fitted(row, width) for row in rows][:height]


def _names() -> Row:
    names = f"{'':<{DEVICE + SIGNAL}}{'now':>{NUMBER}}{'':<{UNIT_WIDTH + 1}}{'age':>{SIGNAL_AGE}}"
    return [(names + f"{'least':>{NUMBER}}{'greatest':>{NUMBER}}", UNIT)]


def _row(seen: SignalValue, stale_after_s: float, *, first: bool) -> Row:
    age = f"{seen.age_s * 1e3:.1f} ms" if isfinite(seen.age_s) else ""
    return [
        (f"{seen.device if first else '':<{DEVICE}}", STRONG),
        (f"{seen.name:<{SIGNAL}}", LABEL),
        (_number(seen.value, seen.unit), TEXT),
        (f" {pretty_unit(seen.unit):<{UNIT_WIDTH}}", UNIT),
        (f"{age:>{SIGNAL_AGE}}", WARNING if seen.age_s > stale_after_s else LABEL),
        (_number(seen.least, seen.unit) + _number(seen.greatest, seen.unit), LABEL),
    ]


def _number(value: float, unit: str) -> str:
    """A constant number of decimals where the value allows, so that the digits do not move."""
    if not isfinite(value):
        return "–".rjust(NUMBER)
    text = _fixed(value, DECIMALS.get(unit, USUAL_DECIMALS))
    return (text if len(text) < NUMBER else f"{value:.3e}").replace("-", "−").rjust(NUMBER)


def _fixed(value: float, decimals: int) -> str:
    return f"{round(value, decimals) + 0.0:.{decimals}f}"  # no negative zero


def _narrow_signals(seen: tuple[SignalValue, ...], stale_after_s: float, width: int, *, live: bool) -> list[Row]:
    names = f"{'now':>{NARROW_NOW}}{'ms':>{NARROW_AGE}}{'least':>{NARROW_END}}{'most':>{NARROW_END}}"
    rows: list[Row] = [apart([("Signals" if live else BEFORE, HEADING)], [(names, UNIT)], width)]
    for device, signals in groupby(seen, key=lambda each: each.device):
        rows += [[(device, STRONG)], *(_narrow_row(each, stale_after_s, width) for each in signals)]
    return [fitted(row, width) for row in rows]


def _narrow_row(seen: SignalValue, stale_after_s: float, width: int) -> Row:
    age = f"{min(seen.age_s * 1e3, OLDEST_MS):.0f}" if isfinite(seen.age_s) else ""
    named: Row = [(seen.name, LABEL), (f" {pretty_unit(seen.unit)}", UNIT)]
    return apart(
        fitted(named, NARROW_SIGNAL),
        [
            (_short(seen.value, seen.unit, NARROW_NOW), TEXT),
            (f"{age:>{NARROW_AGE}}", WARNING if seen.age_s > stale_after_s else LABEL),
            (_short(seen.least, seen.unit, NARROW_END) + _short(seen.greatest, seen.unit, NARROW_END), LABEL),
        ],
        width,
    )


def _short(value: float, unit: str, columns: int) -> str:
    """As many of the usual decimals as there is room for."""
    if not isfinite(value):
        return "–".rjust(columns)
    texts = (_fixed(value, decimals) for decimals in range(DECIMALS.get(unit, USUAL_DECIMALS), -1, -1))
    chosen = next((text for text in texts if len(text) < columns), f"{value:.0e}")
    return chosen.replace("-", "−").rjust(columns)
