"""Simulated rigs with other values, sessions run on them (each once), and assertions on their results.

A failed assertion raises AssertionError, in a sentence.
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from norton_bench.errors import RigError
from norton_bench.models.parameter_result import ExpectationResult, ParameterResult
from norton_bench.models.parameters import HALF_INTERVAL
from norton_bench.result import Result
from norton_bench.rig.files import parse_toml, read_text, toml
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.engine import run_session
from norton_bench.session.operator import Answers
from norton_bench.session.schema import Session, load_session, standard_session
from norton_bench.units import parse_quantity


def _assert(judged: ExpectationResult) -> bool:
    __tracebackhide__ = True
    if not judged.met:
        raise AssertionError(judged.sentence)
    return True


@dataclass(frozen=True)
class Within:
    """A tolerance that waits for its reference."""

    found: ParameterResult
    tolerance: str

    def of(self, reference: str) -> bool:
        """Raises ValueError, in a sentence, where reference or tolerance is no quantity of the parameter's kind."""
        __tracebackhide__ = True
        return _assert(self.found.is_within(self.tolerance, reference))


@dataclass(frozen=True)
class CheckedParameter:
    """A parameter as the session found it: ``value`` and ``std`` in ``unit``, ``interval`` relative."""

    found: ParameterResult

    @property
    def value(self) -> float:
        return self.found.value

    @property
    def std(self) -> float:
        return self.found.std

    @property
    def unit(self) -> str:
        return self.found.unit

    @property
    def status(self) -> str:
        return self.found.status.value

    @property
    def interval(self) -> float:
        return self.found.interval

    def within(self, tolerance: str) -> Within:
        """``.within("2 %").of("0.02 N*m")``, or a tolerance with a unit: the value must be valid, too."""
        return Within(self.found, tolerance)

    def known_within(self, interval: str) -> bool:
        """Half of the 95 % interval is at most this share of the value, which is valid."""
        __tracebackhide__ = True
        return _assert(self.found.is_known_within(interval))

    def covers(self, reference: str) -> bool:
        """The 95 % interval holds ``reference``."""
        __tracebackhide__ = True
        result, expected = self.found, parse_quantity(reference, self.found.unit)
        met = isfinite(result.std) and abs(result.value - expected) <= HALF_INTERVAL * result.std
        message = f"{result}: its 95 % interval {'holds' if met else 'does not hold'} {reference}"
        return _assert(ExpectationResult(result.name, met, message))

    def has_status(self, status: str) -> bool:
        """As it says it: "valid", "ratio only", ..."""
        __tracebackhide__ = True
        return _assert(
            ExpectationResult(self.found.name, self.status == status, f"{self.found}: its status is not {status}")
        )


@dataclass(frozen=True, repr=False)
class SessionOutcome:
    """What came of a session. ``result`` has all of it."""

    result: Result

    def __repr__(self) -> str:
        return f"<what {self.recording} tells>"

    def parameter(self, name: str) -> CheckedParameter:
        """Raises UsageError for a name that no parameter has."""
        return CheckedParameter(self.result.parameter(name))

    @property
    def recording(self) -> Path:
        assert self.result.recording is not None
        return self.result.recording

    @property
    def report(self) -> Path | None:
        return self.result.report_file

    def converged(self) -> bool:
        """The fit is a result: the data do not contradict themselves, and the actuator does what the model has."""
        __tracebackhide__ = True
        fit = self.result.fit
        met = fit is not None and not fit.shortcoming
        message = "nothing was measured to fit" if fit is None else "; ".join(fit.verdict) or "the fit did not converge"
        return _assert(ExpectationResult("fit", met, message))

    def predicts(self, what: str, *, within: str) -> bool:
        """``what`` ("torque" or "velocity") under what no fit has seen, to this share of its rms."""
        __tracebackhide__ = True
        checked = self.result.validation
        error = float("nan") if checked is None else float(getattr(checked, f"{what}_relative"))
        met = isfinite(error) and error <= parse_quantity(within, "")
        return _assert(
            ExpectationResult(what, met, f"{what} is predicted to {100 * error:.2g} %, which is not within {within}")
        )

    def as_expected(self) -> bool:
        """Everything that the session file itself expects (``[[expect]]``) came true."""
        __tracebackhide__ = True
        missed = [judged.sentence for judged in self.result.expectations if not judged.met]
        return _assert(ExpectationResult("expectations", not missed, "; ".join(missed)))


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
        live: bool = False,
    ) -> SessionOutcome:
        """What ``session`` (a file, or one in hand; the standard session where none is given) finds on ``rig``.

        ``values`` are for the session file's parameters, ``answers`` for its prompts; all others are answered with
        "yes". The same run is not run twice, unless it is to be ``fresh``. With ``live`` it identifies while it runs,
        too. Raises what the session ends with.
        """
        chosen = _session(session, rig, values or {})
        key = (
            rig.text,
            rig.place,
            chosen.place,
            chosen.text,
            repr(chosen.steps),
            seed,
            repr(values),
            repr(answers),
            live,
        )
        if fresh or key not in self._outcomes:
            folder = self.out / f"{len(list(self.out.glob('*'))) + 1}-{rig.name}"
            folder.mkdir(parents=True)
            ready = Answers(dict(answers or {}), yes=True)
            result = run_session(rig, chosen, out=folder, seed=seed, answers=ready, live=live)
            self._outcomes[key] = SessionOutcome(result)
        return self._outcomes[key]


def _session(session: str | Path | Session | None, rig: Rig, values: Mapping[str, Any]) -> Session:
    if session is None:
        return standard_session(rig)
    return session if isinstance(session, Session) else load_session(session, values)
