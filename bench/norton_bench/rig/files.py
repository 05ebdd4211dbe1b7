"""TOML files as users write them: read, with a sentence for every way in which that can fail."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from norton_bench.errors import UsageError

# What to do with a file of each kind that was given in the place of another.
MENDS = {
    "rig file": "norton-bench identify RIG runs the standard session on it, norton-bench run SESSION --rig RIG another",
    "session file": "norton-bench run SESSION runs it, on the rig that it names or on that of --rig",
    "column map": "norton-bench fit LOG --columns MAP reads a log by it",
    "recording": "norton-bench fit RECORDING fits it again, norton-bench info RECORDING says what it holds",
}


def read_text(path: Path, kind: str, error: type[UsageError] = UsageError) -> str:
    """The content of the file; ``kind`` ("rig file") names it. Raises ``error`` in one sentence."""
    try:
        return path.read_text(encoding="utf-8-sig")  # Windows' editors put a mark at the beginning
    except FileNotFoundError:
        raise error(f"{path}: no such {kind}; {_neighbours(path)}") from None
    except IsADirectoryError:
        raise error(f"{path}: is a folder; {_neighbours(path / 'x')}") from None
    except UnicodeDecodeError as wrong:
        if path.suffix.lower() == ".mcap":
            raise error(f"{path}: is a recording, not a {kind}; {MENDS['recording']}") from None
        raise error(f"{path}: is not text (byte {wrong.start} is not UTF-8); give a {kind} in TOML") from None
    except OSError as wrong:
        raise error(f"{path}: cannot be read ({wrong.strerror}); check its permissions") from None


def parse_toml(text: str, place: str, error: type[UsageError] = UsageError) -> dict[str, Any]:
    """The tables in ``text``. Raises ``error`` with line and column where it is not TOML."""
    text = text.removeprefix("\ufeff")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as wrong:
        if text.lstrip().startswith("{"):
            raise error(f"{place}: is JSON, not TOML; is it a network file? norton-bench network show FILE") from None
        raise error(f"{place}: is not TOML: {wrong}; check quotes, brackets and repeated keys there") from None


def check_kind(tables: Mapping[str, Any], kind: str, place: str, error: type[UsageError] = UsageError) -> None:
    """Raises ``error`` where a file that was read as a ``kind`` ("rig file") is one of another kind."""
    found = _kind_of(tables)
    if found not in ("", kind):
        raise error(f"{place}: is a {found}, not a {kind}; {MENDS[found]}")


def _kind_of(tables: Mapping[str, Any]) -> str:
    """What the tables say the file is, by those that only one kind has; empty where they do not tell."""
    if isinstance(tables.get("step"), list):
        return "session file"
    if isinstance(tables.get("columns"), dict):
        return "column map"
    if isinstance(tables.get("actuator"), dict) and ("limits" in tables or "rig" in tables):
        return "rig file"
    return ""


def _neighbours(path: Path) -> str:
    """The mend for a file that is not there: those that lie where it was looked for."""
    found = sorted(str(near) for near in path.parent.glob("*.toml"))[:5]
    if found:
        return f"there are: {', '.join(found)}"
    return f"there is none in {path.parent}; check the path, or copy the shipped ones: norton-bench examples ."
