"""The result of an experiment on one page: parameters, figures of merit, verdict, files."""

from collections.abc import Iterable, Iterator
from itertools import zip_longest
from math import floor, isfinite, isnan, log10
from pathlib import Path
from textwrap import wrap

from norton_bench.errors import ExitCode
from norton_bench.events import Ended
from norton_bench.models.parameters import Estimate, Status
from norton_bench.report.words import Facts, interval, number, percent, pretty_unit, symbol
from norton_bench.screen.picture.parts import EstimateHistory, half_width
from norton_bench.screen.styles import (
    BAD,
    GOOD,
    LABEL,
    STRONG,
    TEXT,
    UNIT,
    WARNING,
    Row,
    apart,
    fitted,
    heading,
    length,
)

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
# The sign, the word, and the spaces before both, so that no word is cut.
STATUS = 3 + max(len(status.value) for status in Status)
# What a table of so many columns has room for.
LEAST = SYMBOL + SHORT_VALUE + SHORT_WIDTH + STATUS
WITH_UNIT = SYMBOL + VALUE + UNIT_WIDTH + 1 + WIDTH + STATUS
WITH_INTERVAL, WITH_NAME = WITH_UNIT + INTERVAL, WITH_UNIT + INTERVAL + NAME
LIVE, FINAL = "live 95 %", "final fit 95 %"


LEARNT = "known once the shaft has moved"
LEARNT_IN_SITU = "identified in situ, at the end"


def parameter_rows(known: EstimateHistory, width: int, height: int, *, before: str = LEARNT) -> list[Row]:
    """The table of parameters as it converges: values, intervals, status in a word and a sign.

    A row for each parameter, with more columns where there is room. ``before`` is shown until there are estimates.
    """
    count = f"{known.valid} of {len(known.estimates)} known" if known.estimates else ""
    rows = [heading("Parameters", FINAL if known.final else LIVE, count, width)]
    if not known.estimates:
        return [*rows, [(before, LABEL)]]
    rows += [_row(estimate, known.widths.get(estimate.name, []), width) for estimate in known.estimates]
    return rows[:height]


def _row(estimate: Estimate, widths: list[float], width: int) -> Row:
    sign, style = SIGNS[estimate.status]
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
    row += [(share, TEXT), (f" {sign} {estimate.status.value:<{STATUS - 3}}", style)]
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


RESULT_VALUE, RESULT_UNIT, RESULT_INTERVAL = 11, 10, 26
SIGNED_STATUS = 4 + max(len(status.value) for status in Status)
RESULT_WIDTH = SYMBOL + NAME + RESULT_VALUE + 1 + RESULT_UNIT + RESULT_INTERVAL + SIGNED_STATUS
# In two columns from this width on, so that the right one has room for sentences.
BETWEEN, LEAST_SAID = 4, 50
TWO_COLUMNS = RESULT_WIDTH + BETWEEN + LEAST_SAID
FACT = 12
EXPLANATION = "rms error on motion kept apart from the fit"
GAP = 3  # between the columns of a table
NAMING = ("port", "command", "modulation")  # columns that name a row


def result_rows(summary: Ended, width: int) -> list[Row]:
    """All rows of the page; where there is room, numbers at the left and sentences at the right."""
    wide = width >= TWO_COLUMNS
    left, right = (RESULT_WIDTH, width - RESULT_WIDTH - BETWEEN) if wide else (width, width)
    numbers = _spaced([_parameters(summary.estimates, left), _trials(summary, left), _merit(summary, left)])
    tables = _spaced(_tables(summary.tables, width))
    sentences = _spaced(
        [
            _listed("Conditions", "for a unique model", summary.conditions, right),
            _listed("Verdict", "", summary.verdict, right),
        ]
    )
    end, files = _spaced([_end(summary, width)]), _spaced([_files(summary, width)])
    if wide:
        return [*end, *_beside(numbers, sentences, left, right), *tables, *files]
    return [*end, *numbers, *tables, *sentences, *files]


def _spaced(sections: Iterable[list[Row]]) -> list[Row]:
    """One after the other, with a row between them."""
    return [row for section in sections if section for row in (*section, [("", TEXT)])]


def _beside(left: list[Row], right: list[Row], first: int, second: int) -> list[Row]:
    """Two columns, so wide."""
    pairs = zip_longest(left, right, fillvalue=Row())
    return [[*fitted(one, first), (" " * BETWEEN, TEXT), *fitted(other, second)] for one, other in pairs]


def _end(summary: Ended, width: int) -> list[Row]:
    """A line about the end; after a failure, its reason."""
    if summary.failure:
        return [
            [(line, BAD if not number_ else TEXT)] for number_, line in enumerate(wrap(f"■ {summary.failure}", width))
        ]
    known = sum(estimate.status is Status.VALID for estimate in summary.estimates)
    if summary.exit_code is not ExitCode.OK:
        return [[("▲ No result: see the verdict.", WARNING)]]
    if not summary.estimates and (summary.tables or summary.trials):
        return [[("✓ ", GOOD), ("Done; the results are below.", STRONG)]]
    if not summary.estimates:
        return [[("✓ ", GOOD), ("Done; there was nothing to fit.", STRONG)]]
    return [[("✓ ", GOOD), (f"{known} of {len(summary.estimates)} parameters are known.", STRONG)]]


def _parameters(estimates: tuple[Estimate, ...], width: int) -> list[Row]:
    if not estimates:
        return []
    described = _parameter_below if width < RESULT_WIDTH - NAME else _parameter
    rows = [row for each in estimates for row in described(each, width)]
    return [heading("Parameters", "with 95 % intervals", "", width), *rows]


def _parameter_below(estimate: Estimate, width: int) -> list[Row]:
    """Two rows: value and status; and below them the interval."""
    sign, style = SIGNS[estimate.status]
    value: Row = [
        (symbol(estimate).ljust(SYMBOL), STRONG),
        (f"{number(estimate.value, 5):>{RESULT_VALUE}}", TEXT),
        (f" {pretty_unit(estimate.unit)}", UNIT),
    ]
    return [
        apart(value, [(f"{sign} {estimate.status.value}", style)], width),
        [(" " * SYMBOL, LABEL), (interval(estimate.value, estimate.std), LABEL)],
    ]


def _parameter(estimate: Estimate, width: int) -> list[Row]:
    sign, style = SIGNS[estimate.status]
    row: Row = [(symbol(estimate).ljust(SYMBOL), STRONG)]
    if width >= RESULT_WIDTH:
        row.append((estimate.name.replace("_", " ").ljust(NAME), LABEL))
    row.append((f"{number(estimate.value, 5):>{RESULT_VALUE}}", TEXT))
    row.append((f" {pretty_unit(estimate.unit):<{RESULT_UNIT}}", UNIT))
    row.append((f"{interval(estimate.value, estimate.std):>{RESULT_INTERVAL}}", LABEL))
    return [fitted([*row, (f"  {sign} {estimate.status.value}", style)], width)]


def _trials(summary: Ended, width: int) -> list[Row]:
    lines = [line for sentence in summary.trials for line in wrap(sentence, width)]
    return [heading("Trials", "", "", width), *([(line, TEXT)] for line in lines)] if lines else []


def _tables(tables: tuple[Facts, ...], width: int) -> Iterator[list[Row]]:
    """A section for each table; the first heading explains the intervals."""
    parts = (part for facts in tables for part in _folded(facts, width))
    for number_, facts in enumerate(parts):
        columns = _widths(facts)
        head = "".join(text.rjust(column) for text, column in zip(facts.head, columns, strict=True))
        rows = ["".join(text.rjust(column) for text, column in zip(row, columns, strict=True)) for row in facts.rows]
        above = [heading("Tables", "with 95 % intervals", "", width)] if not number_ else []
        yield [*above, fitted([(head, LABEL)], width), *(fitted([(row, TEXT)], width) for row in rows)]


def _folded(facts: Facts, width: int) -> Iterator[Facts]:
    """The table in parts that fit into ``width``, each with the columns that name its rows."""
    columns = _widths(facts)
    naming = [place for place, text in enumerate(facts.head) if text.split(" ")[0] in NAMING]
    chosen = list(naming)
    for place in range(len(columns)):
        if place in naming:
            continue
        if len(chosen) > len(naming) and sum(columns[each] for each in (*chosen, place)) > width:
            yield _columns_of(facts, chosen)
            chosen = list(naming)
        chosen.append(place)
    yield _columns_of(facts, chosen)


def _columns_of(facts: Facts, places: list[int]) -> Facts:
    return Facts(
        tuple(facts.head[place] for place in places),
        tuple(tuple(row[place] for place in places) for row in facts.rows),
    )


def _widths(facts: Facts) -> list[int]:
    return [max(map(len, column)) + GAP for column in zip(facts.head, *facts.rows, strict=True)]


def _listed(title: str, beside: str, sentences: tuple[str, ...], width: int) -> list[Row]:
    """Under a heading, each with a dot before it; nothing where there are none."""
    lines = [
        line
        for sentence in sentences
        for line in wrap(sentence, width - 2, initial_indent="· ", subsequent_indent="  ")
    ]
    return [heading(title, beside, "", width), *([(line, TEXT)] for line in lines)] if lines else []


def _merit(summary: Ended, width: int) -> list[Row]:
    """The errors of prediction on data kept apart from the fit, and the expectations."""
    rows: list[Row] = []
    for what, share in (("torque", summary.torque_relative), ("velocity", summary.velocity_relative)):
        if share is not None:
            found: Row = [(what.ljust(FACT), LABEL), (f"{percent(share)} of it  ", STRONG)]
            begin = " " * (length(found) - FACT)
            first, *others = wrap(EXPLANATION, max(width - FACT, 2 * FACT), initial_indent=begin)
            rows += [[*found, (first.strip(), LABEL)], *([(" " * FACT, TEXT), (other, LABEL)] for other in others)]
    for expectation in summary.expectations:
        sign, style = ("✓ ", GOOD) if expectation.met else ("✗ ", BAD)
        first, *others = wrap(expectation.sentence, max(width - len(sign), FACT))
        rows += [[(sign, style), (first, TEXT)], *([("  ", TEXT), (other, TEXT)] for other in others)]
    return [heading("Figures of merit", "", "", width), *(fitted(row, width) for row in rows)] if rows else []


def _files(summary: Ended, width: int) -> list[Row]:
    files: list[tuple[str, Path | None]] = [
        ("recording", summary.recording),
        ("network", summary.network),
        ("report", summary.report),
    ]
    rows: list[Row] = [row for name, path in files if path is not None for row in _file(name, str(path), width)]
    return [heading("Files", "", "", width), *rows] if rows else []


def _file(name: str, path: str, width: int) -> list[Row]:
    """Its whole path, in as many rows as needed."""
    room = max(width - FACT, 1)
    pieces = [path[at : at + room] for at in range(0, len(path), room)]
    return [[((name if not number_ else "").ljust(FACT), LABEL), (piece, TEXT)] for number_, piece in enumerate(pieces)]
