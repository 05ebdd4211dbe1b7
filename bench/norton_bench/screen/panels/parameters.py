"""The table of parameters as it converges: values, intervals, status in a word and a sign."""

from math import floor, isfinite, isnan, log10

from norton_bench.models.parameters import Estimate, Status
from norton_bench.report.words import interval, number, pretty_unit, symbol
from norton_bench.screen.picture.known import Known, half_width
from norton_bench.screen.tones import BAD, GOOD, LABEL, STRONG, TEXT, UNIT, WARNING, Row, fitted, heading

SIGNS = {
    Status.UNEXCITED: ("○", LABEL),
    Status.LEARNING: ("◐", WARNING),
    Status.VALID: ("●", GOOD),
    Status.AT_BOUND: ("▲", BAD),
    Status.RATIO_ONLY: ("÷", WARNING),
    Status.NOT_CONVERGED: ("✗", BAD),
    Status.INADEQUATE: ("≠", BAD),
    Status.DOUBTFUL: ("?", BAD),
}
# A bar is full at ± 100 % and empty at ± 0.01 %.
BARS = "▁▂▃▄▅▆▇█"
NARROWEST = 1e-4
SYMBOL, VALUE, SHORT_VALUE, WIDTH, SHORT_WIDTH, UNIT_WIDTH, INTERVAL, NAME, LEAST_SPARK = 6, 12, 11, 9, 8, 9, 24, 22, 6
# The sign, the word, and the spaces before both: no word is ever cut.
STATUS = 3 + max(len(status.value) for status in Status)
# What a table of so many columns has room for.
LEAST = SYMBOL + SHORT_VALUE + SHORT_WIDTH + STATUS
WITH_UNIT = SYMBOL + VALUE + UNIT_WIDTH + 1 + WIDTH + STATUS
WITH_INTERVAL, WITH_NAME = WITH_UNIT + INTERVAL, WITH_UNIT + INTERVAL + NAME
LIVE, FINAL = "live 95 %", "final fit 95 %"


LEARNT = "learnt once the shaft is moved"
LEARNT_IN_SITU = "found in situ, at the end"


def parameter_rows(known: Known, width: int, height: int, *, before: str = LEARNT) -> list[Row]:
    """One row a parameter; the wider, the more is said of each. ``before`` stands there until there are any."""
    count = f"{known.valid} of {len(known.estimates)} known" if known.estimates else ""
    rows = [heading("Parameters", FINAL if known.final else LIVE, count, width)]
    if not known.estimates:
        return [*rows, [(before, LABEL)]]
    rows += [_row(estimate, known.widths.get(estimate.name, []), width) for estimate in known.estimates]
    return rows[:height]


def _row(estimate: Estimate, widths: list[float], width: int) -> Row:
    sign, tone = SIGNS[estimate.status]
    row: Row = [(symbol(estimate).ljust(SYMBOL), STRONG)]
    if width >= WITH_NAME:
        row.append((estimate.name.replace("_", " ").ljust(NAME), LABEL))
    roomy = width >= WITH_UNIT
    value = f"{number(estimate.value, 5):>{VALUE}}" if roomy else f"{number(estimate.value, 4):>{SHORT_VALUE}}"
    row.append((value, TEXT if estimate.status is Status.VALID else LABEL))
    if roomy:
        row.append((f" {pretty_unit(estimate.unit):<{UNIT_WIDTH}}"[: UNIT_WIDTH + 1], UNIT))
    if width >= WITH_INTERVAL:
        row.append((f"{interval(estimate.value, estimate.std):>{INTERVAL}}"[:INTERVAL], LABEL))
    share = _plus_minus(half_width(estimate), WIDTH if roomy else SHORT_WIDTH)
    row += [(share, TEXT), (f" {sign} {estimate.status.value:<{STATUS - 3}}", tone)]
    room = width - sum(len(text) for text, _ in row)
    return [*row, (sparkline(widths, room), UNIT)] if room >= LEAST_SPARK else fitted(row, width)


def _plus_minus(share: float, width: int) -> str:
    """ "±0.23 %", in ``width`` characters."""
    if not isfinite(share) or share >= 1:
        return ("> 100 %" if share >= 1 else "–").rjust(width)
    decimals = min(max(0, 1 - floor(log10(100 * share))), 3 if width >= WIDTH else 2)
    return f"±{100 * share:.{decimals}f} %".rjust(width)


def sparkline(widths: list[float], room: int) -> str:
    """Relative half-widths as bars on a logarithmic scale, the newest at the right."""
    chosen = widths[-room:] if len(widths) <= room else [widths[(i + 1) * len(widths) // room - 1] for i in range(room)]
    return "".join(" " if isnan(each) else BARS[_level(each)] for each in chosen).rjust(room)


def _level(share: float) -> int:
    place = 1 - log10(min(max(share, NARROWEST), 1.0)) / log10(NARROWEST)
    return min(int(place * len(BARS)), len(BARS) - 1)
