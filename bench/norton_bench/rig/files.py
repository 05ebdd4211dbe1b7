"""TOML files as users write them: read, with a sentence for every way in which that can fail."""

import tomllib
from pathlib import Path
from typing import Any

from norton_bench.errors import UsageError


def read_text(path: Path, kind: str, error: type[UsageError] = UsageError) -> str:
    """The content of the file; ``kind`` ("rig file") names it. Raises ``error`` in one sentence."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise error(f"{path}: no such {kind}; {_neighbours(path)}") from None
    except IsADirectoryError:
        raise error(f"{path}: is a folder; {_neighbours(path / 'x')}") from None
    except UnicodeDecodeError as wrong:
        raise error(f"{path}: is not text (byte {wrong.start} is not UTF-8); give a {kind} in TOML") from None
    except OSError as wrong:
        raise error(f"{path}: cannot be read ({wrong.strerror}); check its permissions") from None


def parse_toml(text: str, place: str, error: type[UsageError] = UsageError) -> dict[str, Any]:
    """The tables in ``text``. Raises ``error`` with line and column where it is not TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as wrong:
        raise error(f"{place}: is not TOML: {wrong}; check quotes, brackets and repeated keys there") from None


def _neighbours(path: Path) -> str:
    """The mend for a file that is not there: those that lie where it was looked for."""
    found = sorted(str(near) for near in path.parent.glob("*.toml"))[:5]
    if found:
        return f"there are: {', '.join(found)}"
    return f"there is none in {path.parent}; check the path, or copy the shipped ones: norton-bench examples ."
