"""The rig and session files to choose from: in ./rigs and ./sessions, or else in the working folder."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from norton_bench.errors import BenchError
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.schema import Session, load_session, standard_session


@dataclass(frozen=True)
class Choice:
    """One thing to choose: its name, its description, and ``mistake``: why it cannot be chosen, empty if it can."""

    name: str
    description: str
    mistake: str = ""


@dataclass(frozen=True)
class Available:
    """Files of one kind, and the choice that belongs to each, in the same order."""

    paths: Sequence[Path]
    choices: Sequence[Choice]


def find_rigs(folder: Path) -> Available:
    """Every TOML file in folder/rigs, or else in the folder, that has a section [rig]."""
    paths = [path for path in _files(folder, "rigs") if "[rig]" in _text(path)]
    return _choices(folder, paths, lambda path: _rig(load_rig(path)))


def find_sessions(folder: Path, rig: Rig) -> Available:
    """Every TOML file in folder/sessions, or else in the folder, that has a section [[step]].

    Those that ``rig`` cannot perform come last, each with the reason. Takes a second the first time.
    """
    paths = [path for path in _files(folder, "sessions") if "[[step]]" in _text(path)]
    available = _choices(folder, paths, lambda path: _performed(load_session(path), rig))
    order = sorted(range(len(paths)), key=lambda place: bool(available.choices[place].mistake))
    return Available([available.paths[place] for place in order], [available.choices[place] for place in order])


def by_hand_choice(rig: Rig) -> Choice:
    """The bench moved by hand, without a session."""
    return Choice(
        "by hand", f"Nudge {rig.name} with the arrow keys, and watch every signal.\n\nnorton-bench jog {rig.place}"
    )


def standard_choice(rig: Rig) -> Choice:
    """The built-in session."""
    steps = ", ".join(step.do for step in standard_session(rig).every_step())
    return Choice("standard session", f"Everything that {rig.name} can perform:\n{steps}.")


def _files(folder: Path, name: str) -> list[Path]:
    own = folder / name
    return sorted((own if own.is_dir() else folder).glob("*.toml"))


def _choices(folder: Path, paths: Sequence[Path], describe: Callable[[Path], str]) -> Available:
    return Available(paths, [_choice(folder, path, describe) for path in paths])


def _choice(folder: Path, path: Path, describe: Callable[[Path], str]) -> Choice:
    try:
        paragraphs = (_comment(path), describe(path), str(path.relative_to(folder)))
        return Choice(path.stem, "\n\n".join(filter(None, paragraphs)))
    except BenchError as error:
        return Choice(path.stem, "", str(error))


def _comment(path: Path) -> str:
    """The comment at the top of the file."""
    lines = []
    for line in _text(path).splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    return "\n".join(lines)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def _rig(rig: Rig) -> str:
    devices = [
        f"{device.role.replace('_', ' '):<13} {device.driver:<9} {device.bus or device.port}"
        for device in rig.wiring.devices()
    ]
    return "\n".join([f"{rig.backend}, {1 / rig.tick_s:.0f} Hz", *devices])


def _performed(session: Session, rig: Rig) -> str:
    """Its steps. Raises BenchError for a session that ``rig`` cannot perform."""
    from norton_bench.session.program import make_experiment  # noqa: PLC0415  (brings the report along)

    make_experiment(session, rig)
    return "\n".join(f"{number}  {step.do}" for number, step in enumerate(session.every_step(), 1))
