"""Earlier runs, read from their files: the result of each, the difference of two, a parameter over time."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from math import sqrt
from pathlib import Path

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.distributions import normal_quantile, t_quantile
from norton_bench.errors import UsageError
from norton_bench.identification.statistics import NORMAL_95, Combined, combine, tail_of_each
from norton_bench.models.network import NortonNetwork, told_statuses
from norton_bench.models.parameters import Estimate, Status
from norton_bench.recording.reader import read_happenings

DAYS_A_MONTH = 30.0


@dataclass(frozen=True)
class Run:
    """One recording. ``started`` is None where the file has no such entry; ``ending`` says in words how it ended.

    ``estimates`` are those of its network file, by name; empty where there is no such file.
    """

    recording: Path
    rig: str
    session: str
    started: datetime | None
    ending: str
    estimates: dict[str, Estimate]


@dataclass(frozen=True)
class Difference:
    """``second`` minus ``first``, with the standard deviation for independent sessions [unit of both]."""

    first: Estimate
    second: Estimate
    value: float
    std: float
    shows: bool  # at 95 %, corrected for how many parameters were looked at


@dataclass(frozen=True)
class Trend:
    """``slope_per_month`` ± 1.96 ``slope_std`` of a straight line through the runs' values [unit of the parameter].

    Both are None where all runs were made at one time.
    """

    combined: Combined
    slope_per_month: float | None
    slope_std: float | None


def runs_in(folder: Path) -> tuple[Run, ...]:
    """The run of every recording below ``folder``, the oldest first. Raises UsageError for a folder that is missing."""
    if not folder.is_dir():
        raise UsageError(f"{folder}: no such folder; name the one that holds your runs")
    runs = [_run(path) for path in sorted(folder.rglob("*.mcap"))]
    return tuple(sorted(runs, key=lambda run: run.started.timestamp() if run.started else 0.0))


def run_of(place: Path) -> Run:
    """The run of a recording, or of a folder with exactly one recording. Raises UsageError otherwise."""
    if not place.is_dir():
        return _run(place)
    recordings = sorted(place.glob("*.mcap"))
    if len(recordings) != 1:
        raise UsageError(f"{place}: holds {len(recordings) or 'no'} recordings; name the recording (.mcap)")
    return _run(recordings[0])


def compare(first: Run, second: Run) -> tuple[Difference, ...]:
    """The difference of each parameter. Raises UsageError where they share no parameter, or where units differ."""
    names = [name for name in first.estimates if name in second.estimates]
    if not names:
        raise UsageError(f"{first.recording} and {second.recording}: have no identified parameter in common")
    beyond = -normal_quantile(tail_of_each(len(names)))
    return tuple(_difference(first.estimates[name], second.estimates[name], beyond) for name in names)


def trend_of(name: str, runs: Sequence[Run]) -> Trend:
    """The trend of parameter ``name`` over ``runs``, which all have it. Raises UsageError for fewer than two runs."""
    if len(runs) < 2:
        raise UsageError(f"{name}: a trend needs two runs that identified it, here there are {len(runs)}")
    estimates = [run.estimates[name] for run in runs]
    units = {estimate.unit for estimate in estimates}
    if len(units) > 1:
        raise UsageError(f"{name}: was identified in {' and in '.join(sorted(units))}; choose one rig with --rig")
    values = np.array([estimate.value for estimate in estimates])
    stds = np.array([estimate.std for estimate in estimates])
    combined = combine(values, stds)
    months = np.array([run.started.timestamp() if run.started else np.nan for run in runs]) / (86400 * DAYS_A_MONTH)
    if not np.isfinite(months).all() or np.ptp(months) == 0.0:
        return Trend(combined, None, None)
    return Trend(combined, *_line(months, values, stds))


def _line(times: FloatArray, values: FloatArray, stds: FloatArray) -> tuple[float, float]:
    """Slope and its standard deviation, which grows with scatter beyond the values' own, as in ``combine``."""
    weights, free = 1.0 / stds**2, len(values) - 2
    centred = times - weights @ times / weights.sum()
    information = float(weights @ centred**2)
    slope = float(weights * centred @ values / information)
    left = values - weights @ values / weights.sum() - slope * centred
    scatter = float(weights @ left**2) / free if free else 0.0
    half_width = max(t_quantile(0.975, free) * sqrt(scatter) if free else 0.0, NORMAL_95)
    return slope, half_width / NORMAL_95 / sqrt(information)


def _run(path: Path) -> Run:
    network_file = path.with_suffix(".network.json")
    estimates: dict[str, Estimate] = {}
    metadata: Mapping[str, str] = {}
    try:
        if network_file.is_file():
            network = NortonNetwork.load(network_file)
            estimates, metadata = _estimates(network), network.provenance
            ending = _in_words(estimates.values())
        else:
            metadata, events = read_happenings(path)
            ending = next((event.text for event in reversed(events) if event.kind == "stop"), "no network identified")
    except UsageError as unreadable:
        ending = str(unreadable)
    return Run(path, metadata.get("rig", "?"), metadata.get("session", "?"), _time(metadata), ending, estimates)


def _in_words(estimates: Iterable[Estimate]) -> str:
    """How many values have each status, in words."""
    counts = Counter(estimate.status.value for estimate in estimates)
    return ", ".join(f"{count} {status}" for status, count in counts.items())


def _time(metadata: Mapping[str, str]) -> datetime | None:
    try:
        return datetime.fromisoformat(metadata.get("started", ""))
    except ValueError:
        return None


def _estimates(network: NortonNetwork) -> dict[str, Estimate]:
    """The values in the network file, with the status that the session gave them."""
    variances = dict(zip(network.covariance_names, np.diag(np.atleast_2d(network.covariance)), strict=True))
    status = told_statuses(network.provenance)
    return {
        name: Estimate(name, value, sqrt(variances[name]), unit, Status(status.get(name, Status.VALID.value)))
        for name, (value, unit) in network.parameters().items()
        if name in variances
    }


def _difference(first: Estimate, second: Estimate, beyond: float) -> Difference:
    if first.unit != second.unit:
        raise UsageError(f"{first.name}: is in {first.unit} and in {second.unit}; these rigs cannot be compared")
    value, std = second.value - first.value, sqrt(first.std**2 + second.std**2)
    return Difference(first, second, value, std, abs(value) > beyond * std)
