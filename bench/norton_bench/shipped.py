"""Where rigs, sessions, scripts and docs lie that come with the program."""

from pathlib import Path

FOLDERS = ("rigs", "sessions", "examples", "docs")


def shipped_folder() -> Path:
    """The folder that holds :data:`FOLDERS`: inside the installed package, or the repository of an editable install."""
    installed = Path(__file__).parent / "shipped"
    return installed if installed.is_dir() else Path(__file__).parents[2]
