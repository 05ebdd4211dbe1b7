"""Every signal of the bench: now, how old, least and greatest since the start."""

from itertools import groupby
from math import isfinite

from norton_bench.jog.signals import Seen
from norton_bench.report.words import pretty_unit
from norton_bench.screen.tones import LABEL, STRONG, TEXT, UNIT, WARNING, Row, fitted, heading

DEVICE, SIGNAL, NUMBER, UNIT_WIDTH, AGE = 10, 15, 12, 7, 10
# Digits that are worth looking at while they change.
DIGITS = 4


def signal_rows(seen: tuple[Seen, ...], stale_after_s: float, width: int, height: int) -> list[Row]:
    """One row a signal; devices are set apart where there is room. An age beyond ``stale_after_s`` is marked."""
    rows = [heading("Signals", "", "", width), _names()]
    if not any(isfinite(each.value) for each in seen):
        return [rows[0], [("nothing read yet", LABEL)]]
    devices = [list(group) for _, group in groupby(seen, key=lambda each: each.device)]
    apart = height >= len(rows) + len(seen) + len(devices) - 1
    for number, signals in enumerate(devices):
        if apart and number:
            rows.append([])
        rows += [_row(each, stale_after_s, first=place == 0) for place, each in enumerate(signals)]
    return [fitted(row, width) for row in rows][:height]


def _names() -> Row:
    names = f"{'':<{DEVICE + SIGNAL}}{'now':>{NUMBER}}{'':<{UNIT_WIDTH + 1}}{'age':>{AGE}}"
    return [(names + f"{'least':>{NUMBER}}{'greatest':>{NUMBER}}", UNIT)]


def _row(seen: Seen, stale_after_s: float, *, first: bool) -> Row:
    age = f"{seen.age_s * 1e3:.1f} ms" if isfinite(seen.age_s) else ""
    return [
        (f"{seen.device if first else '':<{DEVICE}}", STRONG),
        (f"{seen.name:<{SIGNAL}}", LABEL),
        (_number(seen.value), TEXT),
        (f" {pretty_unit(seen.unit):<{UNIT_WIDTH}}", UNIT),
        (f"{age:>{AGE}}", WARNING if seen.age_s > stale_after_s else LABEL),
        (_number(seen.least) + _number(seen.greatest), LABEL),
    ]


def _number(value: float) -> str:
    """At its place whatever its size: signs and points stand below each other as long as they can."""
    if not isfinite(value):
        return "–".rjust(NUMBER)
    value += 0.0  # no negative zero
    plain = f"{value:.{DIGITS}f}"
    said = plain if abs(value) < 1e5 and (abs(value) >= 1e-3 or value == 0.0) else f"{value:.{DIGITS - 1}e}"
    return said.replace("-", "−").rjust(NUMBER)
