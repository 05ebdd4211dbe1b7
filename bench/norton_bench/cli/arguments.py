"""Arguments that several commands share."""

import re
from collections.abc import Sequence
from datetime import datetime
from math import isfinite
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, Token

from norton_bench.errors import UsageError


def _whole(_kind: object, tokens: Sequence[Token]) -> int:
    """Accept whole numbers only; 1.5 would else become 1."""
    (token,) = tokens
    if re.fullmatch(r"[+-]?\d+", token.value) is None:
        raise ValueError(f'{token.keyword} "{token.value}" is not a whole number.')
    return int(token.value)


def _not_negative(_kind: object, seed: int | None) -> None:
    if seed is not None and seed < 0:
        raise ValueError("A seed is 0 or greater; give --seed 1, or another.")


def _at_least_one(_kind: object, count: int | None) -> None:
    if count is not None and count < 1:
        raise ValueError("Give at least one.")


def _not_empty(_kind: object, text: str | None) -> None:
    if text is not None and not text.strip():
        raise ValueError('Write "hardware" or "simulated", or leave it out.')


RigFile = Annotated[Path, Parameter(name="RIG", help="A rig file.")]
RecordingFile = Annotated[Path, Parameter(name="RECORDING", help="A recording (.mcap).")]
Json = Annotated[bool, Parameter(help="Print one JSON document on stdout, and nothing else.")]
Quiet = Annotated[bool, Parameter(help="Print no progress.")]
Seed = Annotated[
    int | None,
    Parameter(help="Seed of the simulation; replaces that of the rig file.", converter=_whole, validator=_not_negative),
]
Jobs = Annotated[
    int | None,
    Parameter(
        help="Number of parallel processes; default: number of cores.", converter=_whole, validator=_at_least_one
    ),
]
Backend = Annotated[
    str | None, Parameter(help='"hardware" or "simulated"; replaces that of the rig file.', validator=_not_empty)
]
Out = Annotated[Path | None, Parameter(help="Folder for the results.")]


RUNS = Path("runs")
NUMBERS = re.compile(r"(\d+)(?:-(\d+))?")
MOST_NUMBERS = 10_000


def numbers_in(option: str, text: str) -> tuple[int, ...]:
    """The numbers in a text such as "1-3,7", each once, in that order. Raises UsageError for any other text."""
    numbers: dict[int, None] = {}
    for part in text.split(","):
        match = NUMBERS.fullmatch(part.strip())
        last = int(match[2] or match[1]) if match else -1
        if match is None or last < int(match[1]):
            raise UsageError(f'{option} "{text}": write numbers and ranges, such as 1-5 or 1,4,7')
        if last - int(match[1]) >= MOST_NUMBERS:
            raise UsageError(f'{option} "{text}": these are more than {MOST_NUMBERS}; ask for fewer')
        numbers.update(dict.fromkeys(range(int(match[1]), last + 1)))
    return tuple(numbers)


def run_folder(out: Path | None, rig_name: str, runs: Path = RUNS) -> Path:
    """Make the folder of this run: ``out``, or <runs>/<stamp>-<rig>. Raises UsageError where it cannot be made."""
    folder = out if out is not None else runs / f"{datetime.now():%Y%m%d-%H%M%S}-{rig_name}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"{folder}: the folder cannot be made ({error.strerror}); choose another with --out"
        ) from error
    return folder


def value_in(option: str, text: str, unit: str) -> float:
    """What an option says, in ``unit``; so is a bare number. A time is more than 0 s, and an hour at most.

    Raises UsageError.
    """
    from norton_bench.units import parse_quantity  # noqa: PLC0415

    try:
        value = float(text)
    except ValueError:
        try:
            value = parse_quantity(text, unit)
        except ValueError as error:
            raise UsageError(f"{option}: {error}") from None
    if not isfinite(value) or (unit == "s" and not 0 < value <= 3600):
        raise UsageError(
            f"{option} {text}: must be {'more than 0 s, and an hour at most' if unit == 's' else 'finite'}"
        )
    return value
