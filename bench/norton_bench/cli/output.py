"""Output: results to stdout, progress and errors to stderr."""

import json
import os
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from norton_bench.errors import ExitCode, UsageError, exit_code_of, sentence_of

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

# Wider than any table.
WIDEST = 10_000


@dataclass(frozen=True)
class Output:
    """``json``: one JSON document on stdout, and nothing else. ``quiet``: no progress on stderr."""

    json: bool = False
    quiet: bool = False

    def result(self, data: object, *human: "RenderableType") -> None:
        """Print the result of the command, as JSON or for a terminal."""
        with to_stdout():
            if self.json:
                print(to_json(data))
            else:
                _print(human)

    def say(self, text: str) -> None:
        """Print a line of progress."""
        if not self.quiet:
            complain(text)


@contextmanager
def to_stdout() -> Iterator[None]:
    """Inside, data are written to stdout; at the end they are flushed.

    A reader that closes the pipe, as ``head`` does, is no error. Raises UsageError where data cannot be written.
    """
    try:
        yield
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:
        _silence(sys.stdout)
    except SystemExit as end:  # how rich reports the same
        if not isinstance(end.__context__, BrokenPipeError):
            raise
    except OSError as error:
        _silence(sys.stdout)
        raise UsageError(
            f"the output cannot be written ({error.strerror or error}); send it to another file"
        ) from error


def complain(text: str) -> None:
    """Print to stderr; where that is closed, the program continues without it."""
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        _silence(sys.stderr)


def _silence(stream: TextIO) -> None:
    """Discard what is still buffered: the interpreter would fail to write it at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _print(renderables: "Sequence[RenderableType]") -> None:
    from rich.console import Console, Group  # noqa: PLC0415  (not needed for JSON)
    from rich.table import Table  # noqa: PLC0415

    console = Console()
    for renderable in renderables:
        if isinstance(renderable, Group):
            _print(renderable.renderables)
        elif isinstance(renderable, Table):
            _print_table(console, renderable)
        else:
            console.print(renderable, soft_wrap=isinstance(renderable, str), highlight=False, markup=False)


def _print_table(console: "Console", table: "Table") -> None:
    """Print at full width, so that no figure is cut; a narrow terminal breaks the lines."""
    from rich.console import Console  # noqa: PLC0415
    from rich.measure import Measurement  # noqa: PLC0415

    needs = Measurement.get(console, console.options.update(max_width=WIDEST), table)
    width = max(needs.minimum, console.width if console.is_terminal else needs.maximum)
    page = Console(width=width)
    with page.capture() as drawn:
        page.print(table, crop=False, highlight=False, markup=False)
    for line in drawn.get().splitlines():
        print(line.rstrip())


def plain_table() -> "Table":
    """An empty table in the style of all commands: no frame, headings in bold."""
    from rich.table import Table  # noqa: PLC0415  (not needed for JSON)

    return Table(box=None, pad_edge=False, header_style="bold")


def to_json(data: object) -> str:
    """One JSON document; a number that is not finite becomes null, for JSON has no such number."""
    return json.dumps(_plain(data), indent=2, ensure_ascii=False, allow_nan=False)


def _plain(data: object) -> object:
    if isinstance(data, Mapping):
        return {str(key): _plain(value) for key, value in data.items()}
    if isinstance(data, Sequence) and not isinstance(data, str):
        return [_plain(value) for value in data]
    if isinstance(data, float):
        return float(data) if isfinite(data) else None
    if isinstance(data, Enum):
        return data.value
    return str(data) if isinstance(data, Path) else data


def report_error(error: BaseException, *, debug: bool) -> ExitCode:
    """Print the message of an error to stderr, with ``debug`` also its traceback; returns the exit code.

    No other place turns errors into messages and exit codes.
    """
    if debug:
        traceback.print_exception(error, file=sys.stderr)
    complain(sentence_of(error))
    return exit_code_of(error)
