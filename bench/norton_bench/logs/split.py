"""``--train`` and ``--test``: parts of every log in seconds ("0:12.5 s, 20:30 s"), or files by name or pattern."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from norton_bench.arrays import BoolArray, FloatArray
from norton_bench.errors import UsageError
from norton_bench.units import NUMBER, parse_quantity

PART = re.compile(rf"\s*({NUMBER})?\s*:\s*({NUMBER})?\s*([A-Za-zµμ]*)\s*")


@dataclass(frozen=True)
class Selection:
    """Parts of every log's own time in seconds, or whole files; exactly one of the two is not empty."""

    parts_s: tuple[tuple[float, float], ...] = ()
    files: tuple[str, ...] = ()

    def of(self, path: Path, time_s: FloatArray) -> BoolArray:
        """Which instants of the log at ``path`` are chosen, shape (n,)."""
        if self.files:
            return np.full(time_s.shape, self.names(path))
        return np.asarray(np.any([(time_s >= first) & (time_s < last) for first, last in self.parts_s], axis=0))

    def names(self, path: Path) -> bool:
        """Whether a pattern is that of the file, by its name or by its path."""
        return any(path.match(each) or fnmatch(path.name, each) or fnmatch(str(path), each) for each in self.files)


def parse_selection(text: str, where: str) -> Selection:
    """Raises UsageError in a sentence; ``where`` is the option or key that says it."""
    pieces = [piece.strip() for piece in text.split(",") if piece.strip()]
    if not pieces:
        raise UsageError(f'{where}: is empty; write it like "0:12.5 s", or name files')
    timed = [PART.fullmatch(piece) for piece in pieces]
    if not any(timed):
        return Selection(files=tuple(pieces))
    unit = next((match[3] for match in reversed(timed) if match and match[3]), "s")
    parts = []
    for piece, match in zip(pieces, timed, strict=True):
        if match is None:
            raise UsageError(f'{where}: "{piece}" is no part of the time; write either parts like "0:12.5 s" or files')
        parts.append(_part(match, unit, piece, where))
    return Selection(parts_s=tuple(parts))


def _part(match: re.Match[str], unit: str, piece: str, where: str) -> tuple[float, float]:
    try:
        first, last = (
            float(default) if written is None else parse_quantity(f"{written} {match[3] or unit}", "s")
            for written, default in ((match[1], "-inf"), (match[2], "inf"))
        )
    except ValueError as wrong:
        raise UsageError(f"{where}: {wrong}") from None
    if first >= last:
        raise UsageError(f'{where}: "{piece}" ends before it begins; write it like "0:12.5 s"')
    return first, last


def extra_files(selection: Selection | None, paths: Sequence[Path]) -> tuple[Path, ...]:
    """Files that a selection names and that are not among the logs yet, in order."""
    found: list[Path] = []
    known = {path.resolve() for path in paths}
    for pattern in selection.files if selection else ():
        given = Path(pattern)
        matches = [given] if given.is_file() else sorted(given.parent.glob(given.name)) if given.name else []
        found += [path for path in matches if path.is_file() and path.resolve() not in known]
        known |= {path.resolve() for path in matches}
    return tuple(found)


def train_and_test(
    train: Selection | None, test: Selection | None, path: Path, time_s: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """Which instants of a log are fitted and which are only predicted: what one leaves unsaid is the rest."""
    everything = np.ones(time_s.shape, dtype=bool)
    if train is None and test is None:
        return everything, ~everything
    if train is None:
        assert test is not None
        tested = test.of(path, time_s)
        return ~tested, tested
    trained = train.of(path, time_s)
    tested = ~trained if test is None else test.of(path, time_s)
    return trained, tested & ~trained
