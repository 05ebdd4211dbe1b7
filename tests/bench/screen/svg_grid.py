"""Screens compared by what a reader sees: the words, and where curves and tables stand.

A stored SVG and a new one are read as grids of characters. Words must be the same; digits may be others, for a number
depends on the processor that found it; a curve may differ in a few of its cells for the same reason. Colours are
compared as the set that is used. (pytest-textual-snapshot wants an older pytest than ours.)
"""

import re
from dataclasses import dataclass
from html import unescape

TEXT = re.compile(r'<text class="[^"]*?r(\d+)" x="([\d.]+)" y="([\d.]+)" textLength="([\d.]+)"[^>]*>([^<]*)</text>')
COLOUR = re.compile(r"-r\d+ \{ ([^}]*) \}")
WORD = re.compile(r"[^\W\d_]{2,}")
CURVES = {chr(code) for code in range(0x2800, 0x2900)} | set("▴▾┈")
BARS = set("▁▂▃▄▅▆▇█━─╌│┤")
# Cells of curves that may differ, as a share of all.
MAY_DIFFER = 0.06


@dataclass(frozen=True)
class Seen:
    """One screen: its rows, and the colours in use."""

    rows: tuple[str, ...]
    colours: frozenset[str]


def seen(svg: str) -> Seen:
    """What a terminal would show."""
    pieces = [(float(y), float(x), float(w), unescape(text)) for _, x, y, w, text in TEXT.findall(svg)]
    width = min(w / len(text) for _, _, w, text in pieces if text)
    rows: dict[float, list[str]] = {}
    for y, x, _, text in pieces:
        row = rows.setdefault(y, [])
        first = round(x / width)
        row.extend(" " * (first + len(text) - len(row)))
        row[first : first + len(text)] = text.replace("\xa0", " ")
    return Seen(tuple("".join(rows[y]).rstrip() for y in sorted(rows)), frozenset(COLOUR.findall(svg)))


def differences(before: Seen, now: Seen) -> list[str]:
    """What a reader would notice, a line each; none where it is the same screen."""
    if len(before.rows) != len(now.rows):
        return [f"{len(now.rows)} rows instead of {len(before.rows)}"]
    told = [
        f"row {number}: {new!r} instead of {old!r}"
        for number, (old, new) in enumerate(zip(before.rows, now.rows, strict=True))
        if words(old) != words(new)
    ]
    other = sum(_differs(old, new) for old, new in zip(before.rows, now.rows, strict=True))
    most = MAY_DIFFER * sum(max(len(row), 1) for row in before.rows)
    if other > most:
        told.append(f"{other} cells of curves and rules differ, more than {most:.0f}")
    if before.colours != now.colours:
        told.append(f"colours: {sorted(before.colours ^ now.colours)}")
    return told


def words(row: str) -> list[str]:
    """The words of a row, in order."""
    return WORD.findall(row)


def _differs(old: str, new: str) -> int:
    """Cells of which only one belongs to a curve, or to a rule or bar."""
    wide = max(len(old), len(new))
    pairs = zip(old.ljust(wide), new.ljust(wide), strict=True)
    return sum((a in kind) != (b in kind) for a, b in pairs for kind in (CURVES, BARS))
