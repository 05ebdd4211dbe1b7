"""The user's settings of the screen, from one TOML file: theme, frames a second, keys. The file is optional."""

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from platformdirs import user_config_path
from pydantic import BaseModel, ConfigDict, Field
from textual.theme import BUILTIN_THEMES, Theme

from norton_bench.errors import UsageError, nearest
from norton_bench.rig.files import Mistakes, parse_toml, read_text, toml

BENCH, BENCH_LIGHT = "bench", "bench-light"
OWN = (
    Theme(
        BENCH, primary="#6cb6ff", secondary="#f0b67f", accent="#6cb6ff", warning="#e8c07d", error="#f47067",
        success="#7ccf93", foreground="#d5dbe3", background="#12161c", surface="#1a2029", panel="#232b36",
    ),
    Theme(
        BENCH_LIGHT, primary="#0b62b8", secondary="#a8540c", accent="#0b62b8", warning="#8a6100", error="#b3261e",
        success="#1d7a3d", foreground="#1f2328", background="#fbfaf7", surface="#f1efe9", panel="#e4e1d8", dark=False,
    ),
)  # fmt: skip
KNOWN = frozenset(theme.name for theme in OWN) | frozenset(BUILTIN_THEMES)


def user_themes(written: Mapping[str, Mapping[str, Any]]) -> list[Theme]:
    """The themes of the settings file."""
    return [Theme(name, **colours) for name, colours in written.items()]


PLACE = "NORTON_BENCH_CONFIG"
STOP_KEY, STOP = "space", "stop"
FPS = 25.0
COLOURS = (
    *("primary", "secondary", "accent", "warning", "error", "success"),
    *("foreground", "background", "surface", "panel"),
)
COLOUR = re.compile(r"#[0-9a-fA-F]{6}")
DARK = "dark"


@dataclass(frozen=True)
class Settings:
    """``keys`` by the id of their action; ``themes`` by name: colours, and "dark"."""

    theme: str = ""
    fps: float = FPS
    keys: Mapping[str, str] = field(default_factory=dict)
    themes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


class _SettingsFile(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")

    theme: str = Field("", examples=["nord"])
    fps: float = Field(FPS, ge=1, le=60, examples=[10])
    keys: dict[str, str] = Field(default_factory=dict, examples=[{"pause": "f5"}])
    themes: dict[str, dict[str, Any]] = Field(default_factory=dict)


def settings_path() -> Path:
    """The settings file: ``$NORTON_BENCH_CONFIG``, or config.toml in the user's folder for norton-bench."""
    path = os.environ.get(PLACE)
    return Path(path) if path else user_config_path("norton-bench") / "config.toml"


def load_settings(path: Path, known_keys: frozenset[str], known_themes: frozenset[str]) -> Settings:
    """The settings in the file; the defaults where there is no file and none was named.

    Raises UsageError: a line for each mistake, with its place and the remedy.
    """
    if not path.exists() and PLACE not in os.environ:
        return Settings()
    mistakes = Mistakes(str(path))
    read = mistakes.read(_SettingsFile, parse_toml(read_text(path, "settings file"), str(path)), "")
    if read is not None:
        _check_keys(read.keys, known_keys, mistakes)
        _check_themes(read, known_themes, mistakes)
    mistakes.raise_as(UsageError)
    assert read is not None
    keys = {name: f"{STOP_KEY},{keys}" if name == STOP else keys for name, keys in read.keys.items()}
    return Settings(read.theme, read.fps, keys, read.themes)


def _check_keys(keys: Mapping[str, str], known: frozenset[str], mistakes: Mistakes) -> None:
    for name, written in keys.items():
        if name not in known:
            mistakes.add(f"[keys] {name}", f"is no action of a key; {nearest(name, known)}")
        elif not written.strip():
            mistakes.add(f"[keys] {name}", 'is empty; write it like "f5" or "f5,ctrl+r"')
        elif name != STOP and STOP_KEY in [key.strip() for key in written.split(",")]:
            mistakes.add(f"[keys] {name}", "space always stops; choose another key")


def _check_themes(read: _SettingsFile, known: frozenset[str], mistakes: Mistakes) -> None:
    for name, colours in read.themes.items():
        where = f"[themes.{name}]"
        if "primary" not in colours:
            mistakes.add(f"{where} primary", 'is missing; add primary = "#4f9dde"')
        for key, value in colours.items():
            if key == DARK:
                if not isinstance(value, bool):
                    mistakes.add(f"{where} {key}", f"expected true or false, not {toml(value)}")
            elif key not in COLOURS:
                mistakes.add(f"{where} {key}", f"is not a colour of a theme; {nearest(key, (*COLOURS, DARK))}")
            elif not (isinstance(value, str) and COLOUR.fullmatch(value)):
                mistakes.add(f"{where} {key}", f'expected a colour like "#4f9dde", not {toml(value)}')
    themes = known | read.themes.keys()
    if read.theme and read.theme not in themes:
        mistakes.add("theme", f"there is no theme {toml(read.theme)}; {nearest(read.theme, themes)}")
