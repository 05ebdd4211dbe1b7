"""One fit of a sweep, wherever it runs: what it is given, and the little that it sends back."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from math import isfinite, nan
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, Protocol

import numpy as np

from norton_bench.errors import BenchError, sentence_of
from norton_bench.identification.cleaning import clean
from norton_bench.identification.judged_fit import fit_judged
from norton_bench.identification.results import FitResult
from norton_bench.models.parameters import PARAMETERS, Estimate, Status
from norton_bench.recording.reader import read_recording
from norton_bench.rig.load import true_parameters
from norton_bench.rig.rig import Rig
from norton_bench.session.conclusion import check_metadata, conclude_recording
from norton_bench.session.engine import record_session, run_session
from norton_bench.session.items import Session
from norton_bench.session.resume import with_earlier
from norton_drivers.errors import DeviceError


@dataclass(frozen=True)
class TaskResult:
    """What came of a task: its estimates, what is true where that is known, or the sentence with which it failed.

    ``true`` holds values by the estimates' names, in their units.
    """

    name: str
    estimates: tuple[Estimate, ...] = ()
    converged: bool = False
    true: Mapping[str, float] = field(default_factory=dict)
    failure: str = ""
    took_s: float = 0.0

    def as_json(self) -> dict[str, Any]:
        return {**asdict(self), "estimates": [_estimate_json(each) for each in self.estimates]}

    @classmethod
    def of_json(cls, written: Mapping[str, Any]) -> "TaskResult":
        """Raises KeyError, TypeError or ValueError for what is none."""
        return cls(**{**written, "estimates": tuple(_estimate_of_json(each) for each in written["estimates"])})


def _estimate_json(estimate: Estimate) -> dict[str, Any]:
    """JSON knows no number that is not finite."""
    numbers = {name: value if isfinite(value) else None for name, value in _numbers(estimate).items()}
    return {**asdict(estimate), **numbers, "status": estimate.status.value}


def _estimate_of_json(written: Mapping[str, Any]) -> Estimate:
    numbers = {name: nan if written[name] is None else float(written[name]) for name in ("value", "std")}
    return Estimate(**{**written, **numbers, "status": Status(written["status"])})


def _numbers(estimate: Estimate) -> dict[str, float]:
    return {"value": float(estimate.value), "std": float(estimate.std)}


class Task(Protocol):
    """Anything that pickles, has a name of its own in its sweep, and can be carried out anywhere."""

    @property
    def name(self) -> str: ...

    def fitted(self) -> TaskResult:
        """Raises BenchError or DeviceError, in a sentence, where there is nothing to fit."""
        ...


@dataclass(frozen=True)
class SimulatedTask:
    """One session on a simulated rig, identified at its end. Files are kept in ``keep``/<name>, or not at all."""

    rig: Rig
    session: Session
    seed: int
    keep: Path | None = None

    @property
    def name(self) -> str:
        return f"seed {self.seed}"

    def fitted(self) -> TaskResult:
        true = {name: value for name, (value, _) in true_parameters(self.rig, self.seed).items()}
        return _outcome(self.name, self._fit(), true)

    def _fit(self) -> FitResult | None:
        if self.keep is not None:
            folder = self.keep / self.name.replace(" ", "-")
            folder.mkdir(parents=True, exist_ok=True)
            return run_session(self.rig, self.session, out=folder, seed=self.seed, live=False).fit
        rig = replace(self.rig, candump=False)
        with TemporaryDirectory(prefix="norton-bench-") as folder_name:
            recorded = record_session(rig, self.session, out=Path(folder_name), seed=self.seed, live=False)
        return fit_judged(clean(recorded.measured), command_unit=rig.command.unit, tick_s=rig.tick_s).result


@dataclass(frozen=True)
class RecordedTask:
    """One recording, fitted again. Network and report are kept in ``keep``/<name>, or not at all."""

    path: Path
    keep: Path | None = None

    @property
    def name(self) -> str:
        return str(self.path)

    def fitted(self) -> TaskResult:
        return _outcome(self.name, self._fit(), {})

    def _fit(self) -> FitResult | None:
        if self.keep is not None:
            # Recordings of a fleet have one name in many folders.
            folder = self.keep / f"{self.path.stem}-{sha256(self.name.encode()).hexdigest()[:8]}"
            folder.mkdir(parents=True, exist_ok=True)
            return conclude_recording(self.path, folder).fit
        recording = read_recording(self.path, raw_frames=False)
        check_metadata(self.path, recording.metadata)
        unit, tick_s = recording.metadata["command_unit"], float(recording.metadata["tick_s"])
        measured = with_earlier(self.path, recording)
        return fit_judged(clean(measured), command_unit=unit, tick_s=tick_s).result


def carry_out(task: Task) -> TaskResult:
    """The task's outcome; one that fails says so, and does not end the sweep."""
    begun_s = perf_counter()
    try:
        outcome = task.fitted()
    except (BenchError, DeviceError, OSError) as error:
        outcome = TaskResult(task.name, failure=sentence_of(error))
    return replace(outcome, took_s=perf_counter() - begun_s)


def _outcome(name: str, result: FitResult | None, true: Mapping[str, float]) -> TaskResult:
    if result is None:
        return TaskResult(name, failure="nothing was measured to fit; the session needs a step 'free' or 'imposed'")
    return TaskResult(name, result.estimates, not result.shortcoming, true)


WITHIN = 1.96  # deviations, of 95 %


# What the outcomes of a sweep say together, parameter by parameter.
@dataclass(frozen=True)
class Spread:
    """One parameter over all runs in which it is valid, in ``unit``; NaN where runs or truth are too few to say.

    ``spread`` is the standard deviation of the values, ``std`` the median of those that the runs themselves give.
    ``bias`` and ``rms_error`` are of the errors, ``within`` is the share of 95 % intervals that hold the truth.
    """

    name: str
    unit: str
    runs: int
    median: float
    least: float
    greatest: float
    spread: float
    std: float
    bias: float
    rms_error: float
    within: float


def summary(outcomes: Sequence[TaskResult]) -> tuple[Spread, ...]:
    """In the order of the table of parameters; what is valid nowhere is left out."""
    result = (_spread(parameter.name, outcomes) for parameter in PARAMETERS)
    return tuple(each for each in result if each is not None)


def _spread(name: str, outcomes: Sequence[TaskResult]) -> Spread | None:
    valid = [
        (outcome, estimate)
        for outcome in outcomes
        for estimate in outcome.estimates
        if estimate.name == name and estimate.status is Status.VALID
    ]
    if not valid:
        return None
    value, std = np.array([(estimate.value, estimate.std) for _, estimate in valid]).T
    error = value - np.array([outcome.true.get(name, np.nan) for outcome, _ in valid])
    known = bool(np.isfinite(error).all())
    return Spread(
        name=name,
        unit=valid[0][1].unit,
        runs=len(valid),
        median=float(np.median(value)),
        least=float(value.min()),
        greatest=float(value.max()),
        spread=float(np.std(value, ddof=1)) if len(valid) > 1 else float("nan"),
        std=float(np.median(std)),
        bias=float(np.mean(error)),
        rms_error=float(np.sqrt(np.mean(error**2))),
        within=float(np.mean(np.abs(error) <= WITHIN * std)) if known else float("nan"),
    )
