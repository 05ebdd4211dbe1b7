"""Where words go: data to stdout, everything said meanwhile to stderr."""

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table


@dataclass(frozen=True)
class Output:
    """``json``: stdout carries one JSON document and nothing else. ``quiet``: nothing is said meanwhile."""

    json: bool = False
    quiet: bool = False

    def result(self, data: object, *human: "RenderableType") -> None:
        """The command's result, in the form that was asked for."""
        if self.json:
            print(to_json(data))
            return
        from rich.console import Console  # noqa: PLC0415  (not needed for JSON)

        console = Console()
        for renderable in human:
            console.print(renderable, soft_wrap=isinstance(renderable, str), highlight=False, markup=False)

    def say(self, text: str) -> None:
        """A remark on the way."""
        if not self.quiet:
            print(text, file=sys.stderr, flush=True)


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
