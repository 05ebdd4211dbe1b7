"""Where words go: data to stdout, everything said meanwhile to stderr."""

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

# No table is as wide.
WIDEST = 10_000


@dataclass(frozen=True)
class Output:
    """``json``: stdout carries one JSON document and nothing else. ``quiet``: nothing is said meanwhile."""

    json: bool = False
    quiet: bool = False

    def result(self, data: object, *human: "RenderableType") -> None:
        """The command's result, in the form that was asked for."""
        with to_stdout():
            if self.json:
                print(to_json(data))
            else:
                _print(human)

    def say(self, text: str) -> None:
        """A remark on the way."""
        if not self.quiet:
            complain(text)


@contextmanager
def to_stdout() -> Iterator[None]:
    """Inside, data are written to stdout, and all of them have left when it ends.

    A reader who has left, as ``head`` does, has read enough. Raises UsageError where they cannot be written.
    """
    try:
        yield
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:
        _silence(sys.stdout)
    except SystemExit as end:  # how rich says the same
        if not isinstance(end.__context__, BrokenPipeError):
            raise
    except OSError as error:
        _silence(sys.stdout)
        raise UsageError(f"the output cannot be written ({error.strerror or error}); send it elsewhere") from error


def complain(text: str) -> None:
    """To stderr; where nobody can read it, what is under way goes on all the same."""
    try:
        print(text, file=sys.stderr, flush=True)
    except OSError:
        _silence(sys.stderr)


def _silence(stream: TextIO) -> None:
    """What still waits to be written, or will be, goes nowhere: the interpreter would trip over it at its end."""
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
    """With every figure whole, however narrow the terminal: it breaks lines by itself. A file has room for all."""
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
    """An empty table as every command draws it: without a frame, headings in bold."""
    from rich.table import Table  # noqa: PLC0415  (not needed for JSON)

    return Table(box=None, pad_edge=False, header_style="bold")


def to_json(data: object) -> str:
    """One JSON document; what is not finite becomes null, as JSON knows no such number."""
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
    """The one place that turns errors into sentences on stderr and into exit codes.

    Say on stderr what went wrong; with ``debug``, where in the program.
    """
    if debug:
        traceback.print_exception(error, file=sys.stderr)
    complain(sentence_of(error))
    return exit_code_of(error)
