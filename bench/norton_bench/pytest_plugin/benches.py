"""Simulated rigs with other values, and sessions run on them: once each, unless another run is asked for."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from norton_bench.errors import RigError
from norton_bench.pytest_plugin.checks import SessionOutcome
from norton_bench.rig.files import parse_toml, read_text, toml
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.engine import run_session
from norton_bench.session.operator import Answers
from norton_bench.session.schema import Session, load_session, standard_session


def simulated_rig(path: str | Path, overrides: Mapping[str, Any] | None = None) -> Rig:
    """The rig of the file at ``path``, on the simulated backend.

    ``overrides`` are values by their place in the file: ``{"simulated.actuator.inertia": "8e-5 kg*m^2"}``. Raises
    RigError as reading a rig file does, and where a place is none.
    """
    path = Path(path)
    text = read_text(path, "rig file", RigError)
    if overrides:
        written = deepcopy(parse_toml(text, str(path), RigError))
        for place, value in overrides.items():
            _put(written, place, value, path)
        text = "\n".join(f"{toml(key)} = {toml(value)}" for key, value in written.items())
    return parse_rig(text, place=str(path), backend="simulated")


def _put(written: dict[str, Any], place: str, value: Any, path: Path) -> None:
    *sections, key = place.split(".")
    table = written
    for section in sections:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise RigError(f"{path}: {place}: {section} is no section; name a key like simulated.actuator.inertia")
    table[key] = value


@dataclass
class Runs:
    """Runs sessions, and remembers what came of them for as long as the tests run. ``out`` gets a folder for each."""

    out: Path
    _outcomes: dict[object, SessionOutcome] = field(default_factory=dict)

    def __call__(
        self,
        rig: Rig,
        session: str | Path | Session | None = None,
        *,
        seed: int = 1,
        values: Mapping[str, Any] | None = None,
        answers: Mapping[str, str] | None = None,
        fresh: bool = False,
    ) -> SessionOutcome:
        """What ``session`` (a file, or one in hand; the standard session where none is given) finds on ``rig``.

        ``values`` are for the session file's parameters, ``answers`` for its prompts; all others are answered with
        "yes". The same run is not run twice, unless it is to be ``fresh``. Raises what the session ends with.
        """
        chosen = _session(session, rig, values or {})
        key = (rig.text, rig.place, chosen.place, chosen.text, repr(chosen.steps), seed, repr(values), repr(answers))
        if fresh or key not in self._outcomes:
            folder = self.out / f"{len(list(self.out.glob('*'))) + 1}-{rig.name}"
            folder.mkdir(parents=True)
            ready = Answers(dict(answers or {}), yes=True)
            self._outcomes[key] = SessionOutcome(run_session(rig, chosen, out=folder, seed=seed, answers=ready))
        return self._outcomes[key]


def _session(session: str | Path | Session | None, rig: Rig, values: Mapping[str, Any]) -> Session:
    if session is None:
        return standard_session(rig)
    return session if isinstance(session, Session) else load_session(session, values)
