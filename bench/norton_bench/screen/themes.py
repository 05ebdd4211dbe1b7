"""The themes: two of our own, calm, beside textual's, and those of the user."""

from collections.abc import Mapping
from typing import Any

from textual.theme import BUILTIN_THEMES, Theme

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
    """Those of the settings file."""
    return [Theme(name, **colours) for name, colours in written.items()]
