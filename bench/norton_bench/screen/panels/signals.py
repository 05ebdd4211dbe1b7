"""Every signal of the bench: now, how old, least and greatest since the start."""

from itertools import groupby
from math import isfinite

from norton_bench.jog.signals import Seen
from norton_bench.report.words import pretty_unit
from norton_bench.screen.tones import LABEL, STRONG, TEXT, UNIT, WARNING, Row, fitted, heading

DEVICE, SIGNAL, NUMBER, UNIT_WIDTH, AGE = 10, 15, 11, 7, 10
# Decimals that are worth looking at while they change.
DECIMALS = {"°C": 1, "V": 2, "A": 3, "rad/s": 3, "W": 3}
USUAL_DECIMALS = 4
BEFORE = "as they were last"


def signal_rows(seen: tuple[Seen, ...], stale_after_s: float, width: int, height: int, *, live: bool) -> list[Row]:
    """One row a signal; devices are set apart where there is room. An age beyond ``stale_after_s`` is marked."""
    rows = [heading("Signals", "", "" if live else BEFORE, width), _names()]
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
        (_number(seen.value, seen.unit), TEXT),
        (f" {pretty_unit(seen.unit):<{UNIT_WIDTH}}", UNIT),
        (f"{age:>{AGE}}", WARNING if seen.age_s > stale_after_s else LABEL),
        (_number(seen.least, seen.unit) + _number(seen.greatest, seen.unit), LABEL),
    ]


def _number(value: float, unit: str) -> str:
    """As many decimals whatever its size, as long as they say anything, so that it does not jump about."""
    if not isfinite(value):
        return "–".rjust(NUMBER)
    decimals = DECIMALS.get(unit, USUAL_DECIMALS)
    said = f"{round(value, decimals) + 0.0:.{decimals}f}"  # no negative zero
    return (said if len(said) < NUMBER else f"{value:.3e}").replace("-", "−").rjust(NUMBER)
