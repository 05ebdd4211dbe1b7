"""Where rigs, sessions, scripts and docs lie that come with the program."""

from pathlib import Path

FOLDERS = ("rigs", "sessions", "examples", "docs")
README = "README.md"  # the docs lead there


def shipped_folder() -> Path:
    """The folder that holds :data:`FOLDERS` and :data:`README`: inside the installed package, or the repository of an
    editable install.
    """
    installed = Path(__file__).parent / "shipped"
    return installed if installed.is_dir() else Path(__file__).parents[2]
