"""``demo`` and ``examples``: the files that come with the program."""

import re
import shutil
from collections.abc import Iterator
from os.path import normpath
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from norton_bench.cli.arguments import Json, Out, Quiet, Seed
from norton_bench.cli.experiment import identify
from norton_bench.cli.output import Output, plain_table
from norton_bench.errors import ExitCode, UsageError
from norton_bench.shipped import FOLDERS, README, shipped_folder

DEMONSTRATION = "rigs/sim-odrive.toml"
SUFFIXES = (".toml", ".py", ".yml")
LINK = re.compile(r"\[(?P<words>[^\[\]]*)\]\((?P<to>[^()\s]+)\)")
LEFT_OUT = ("__pycache__", "*.pyc", "*.egg-info", "build", "dist")

Folder = Annotated[
    Path | None, Parameter(name="FOLDER", help="Copy them into this folder. Existing files are not replaced.")
]


def demo(*, seed: Seed = None, out: Out = None, json: Json = False, quiet: Quiet = False) -> int:
    """Identify a simulated actuator with the standard session, through real CAN frames and serial bytes."""
    return identify(shipped_folder() / DEMONSTRATION, seed=seed, out=out, json=json, quiet=quiet)


def examples(folder: Folder = None, /, *, json: Json = False) -> int:
    """List the rigs, sessions and scripts that come with the program, or copy them and the docs into a folder."""
    output, shipped = Output(json), shipped_folder()
    if folder is not None:
        copied = list(_copied(shipped, folder))
        start = folder / DEMONSTRATION
        output.result({"copied": copied}, f"{len(copied)} files copied to {folder}; norton-bench identify {start}")
        return ExitCode.OK
    listed = {str(path.relative_to(shipped)): _first_line(path) for path in _listed(shipped)}
    table = plain_table()
    for heading in ("file", "content"):
        table.add_column(heading, overflow="fold")
    for name, words in listed.items():
        table.add_row(name, words)
    output.result(listed, table, "To copy them, and the docs: norton-bench examples FOLDER")
    return ExitCode.OK


def _listed(shipped: Path) -> Iterator[Path]:
    """The files to start from. Of an example with a folder of its own only the README is listed."""
    for name in FOLDERS[:-1]:
        for path in sorted((shipped / name).rglob("*")):
            whole = any((folder / "pyproject.toml").is_file() for folder in path.parents if shipped in folder.parents)
            if path.name == "README.md" if whole else path.suffix in SUFFIXES:
                yield path


def _first_line(path: Path) -> str:
    """The first line of its comment or docstring, which says what it is."""
    with path.open(encoding="utf-8") as file:
        return file.readline().strip().lstrip('#" ')


def _copied(shipped: Path, folder: Path) -> Iterator[Path]:
    """Copy the files that do not exist there. Raises UsageError where the folder cannot be written to."""
    ignored = shutil.ignore_patterns(*LEFT_OUT)
    sources = (path for name in FOLDERS for path in sorted((shipped / name).rglob("*")))
    for source in (shipped / README, *sources):
        place = source.relative_to(shipped)
        target = folder / place
        if source.is_dir() or target.exists() or ignored("", list(place.parts)):
            continue
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)
            if source.suffix == ".md":
                target.write_text(_within_reach(source.read_text(encoding="utf-8"), place), encoding="utf-8")
        except OSError as error:
            raise UsageError(f"{target}: cannot be written ({error.strerror}); choose another folder") from error
        yield target


def _within_reach(text: str, place: Path) -> str:
    """A document that is copied to ``place``, whose links to what is not copied, such as sources, are plain text."""

    def link(found: re.Match[str]) -> str:
        reached = normpath(place.parent / found["to"].partition("#")[0])
        copied = Path(reached).parts[:1] in {(name,) for name in (*FOLDERS, README)}
        return found[0] if copied or ":" in found["to"] or found["to"].startswith("#") else found["words"]

    return LINK.sub(link, text)
