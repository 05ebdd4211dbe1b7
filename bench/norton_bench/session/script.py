"""Experiments as generators: a script yields what to do next, and reads what is known by then.

A session file becomes such a script (:mod:`norton_bench.session.program`), and a Python program may write its own:

    def script(so_far: SoFar) -> Script:
        yield TareProcedure()
        yield CalibrateProcedure()
        try:
            while so_far.parameter("coulomb_torque").interval > 0.01:
                yield ImposedProcedure(ImposedOptions(duration_s=10.0))
        finally:
            yield Ask("unclamped", "Take the clamp off.")

The block ``finally`` is carried out however the experiment ends. After a safety stop, a failed device or a stop by the
operator nothing may move: then only its prompts are carried out.
"""

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import islice
from typing import Protocol

from norton_bench.errors import BenchError, ExperimentError
from norton_bench.events import PlannedStep, Prompt
from norton_bench.identification.results import FitResult
from norton_bench.models.parameter_result import ParameterResult, parameter_result
from norton_bench.models.parameters import Estimate
from norton_bench.procedures.knowledge import Adaptive, Knowledge, Plan, Procedure
from norton_bench.records import join
from norton_bench.rig.rig import Rig
from norton_drivers.errors import DeviceError
from norton_drivers.readings import DeviceIdentity


@dataclass(frozen=True)
class Ask:
    """A prompt to the operator, with the drives idle; the answer is then in ``so_far.answers[name]``."""

    name: str
    text: str
    choices: tuple[str, ...] = ()

    @property
    def prompt(self) -> Prompt:
        return Prompt(self.name, self.text, self.choices)


@dataclass(frozen=True)
class ByHand:
    """Segments that a person decides on, one after the other, for any time. They are recorded, and nothing is
    fitted."""

    name: str
    plan: Callable[[Knowledge], Plan]

    def duration_s(self, rig: Rig) -> float:
        """Nobody knows."""
        return 0.0


Planned = Procedure | Adaptive | Ask
Action = Planned | ByHand


@dataclass(frozen=True)
class Turn:
    """An action that is step ``index`` of the plan."""

    index: int
    action: Planned


@dataclass(frozen=True)
class Remark:
    """A line for the watcher."""

    text: str


Script = Generator[Action | Turn | Remark, None, None]


@dataclass
class SoFar:
    """What a script can decide by: the knowledge so far, the operator's ``answers``, and the fit of all recorded data.

    ``devices`` are the identities that the devices report: drives in the order of the rig, then the torque sensor.

    It changes while the script waits at a ``yield``.
    """

    known: Knowledge
    answers: dict[str, str] = field(default_factory=dict)
    devices: tuple[DeviceIdentity, ...] = ()
    _fitted: FitResult | None = field(default=None, init=False)
    _fitted_records: int = field(default=0, init=False)

    def fit(self) -> FitResult:
        """The fit of all recorded data; takes seconds. Raises ExperimentError where nothing was measured yet."""
        from norton_bench.identification.judged_fit import fit  # noqa: PLC0415  (slow to import)

        records = self.known.records
        if self._fitted is None or self._fitted_records != len(records):
            if not records:
                raise ExperimentError("nothing has been measured yet: run a step before you ask for its results")
            unit, tick_s = self.known.rig.command.unit, self.known.tick_s
            measured = join(records)
            self._fitted = fit(measured, command_unit=unit, tick_s=tick_s)
            self._fitted_records = len(records)
        return self._fitted

    def parameter(self, name: str) -> ParameterResult:
        """The estimate of a parameter so far, also where nothing is known. Raises UsageError for an unknown name."""
        return parameter_result(self._estimates(), name, self.known.rig.command.unit)

    def _estimates(self) -> tuple[Estimate, ...]:
        try:
            return self.fit().estimates
        except ExperimentError:
            return ()


@dataclass(frozen=True)
class Experiment:
    """A script with its ``plan`` and its ``prompts``; None where they are not known beforehand."""

    script: Callable[[SoFar], Script]
    plan: tuple[PlannedStep, ...] = ()
    prompts: tuple[Prompt, ...] | None = None


# How many actions a script may yield after a stop; without a limit it could go on for ever.
MOST_LAST_TURNS = 100

Yielded = Action | Turn | Remark


class Performer(Protocol):
    """Carries out what a script yields. :func:`perform` throws what fails back into the script."""

    def turn(self, yielded: Yielded) -> None:
        """Raises what the action does."""
        ...

    def last_turn(self, yielded: Yielded, error: Exception) -> None:
        """The same after ``error``, which was final: nothing may move."""
        ...


def perform(script: Script, performer: Performer) -> None:
    """Until the script is done.

    The script may catch an ExperimentError, and then continues. Every other BenchError and DeviceError is final: the
    script's ``finally`` blocks are carried out, and the error is raised even if the script catches it.
    """
    with _closed(script):
        yielded = next(script, None)
        while yielded is not None:
            try:
                performer.turn(yielded)
            except ExperimentError as error:
                yielded = _thrown_into(script, error)
            except (BenchError, DeviceError) as error:
                for last in islice(_last(script, error), MOST_LAST_TURNS):
                    performer.last_turn(last, error)
                raise
            else:
                yielded = next(script, None)


@contextmanager
def _closed(script: Script) -> Iterator[None]:
    try:
        yield
    finally:
        # When the program itself is ended, the script gets no more turns.
        with suppress(RuntimeError):
            script.close()


def _thrown_into(script: Script, error: Exception) -> Yielded | None:
    """Throw ``error`` into the script; returns what it yields next. Raises ``error`` where the script does not catch
    it.
    """
    try:
        return script.throw(error)
    except StopIteration:
        return None


def _last(script: Script, error: Exception) -> Iterator[Yielded]:
    with suppress(StopIteration, type(error)):
        yield script.throw(error)
        yield from script
