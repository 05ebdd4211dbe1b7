"""Earlier runs, read from their files: the result of each, the difference of two, a parameter over time."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from math import sqrt
from pathlib import Path

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.distributions import normal_quantile, t_quantile
from norton_bench.errors import UsageError
from norton_bench.identification.statistics import NORMAL_95, Combined, combine, tail_of_each
from norton_bench.models.network import CONDITIONS, NortonNetwork, told, told_deviations, told_statuses
from norton_bench.models.parameters import Estimate, Status
from norton_bench.networks.findings import VERDICTS
from norton_bench.recording.reader import read_happenings
from norton_bench.rig.rig import NO_MODEL

DAYS_A_MONTH = 30.0


@dataclass(frozen=True)
class Run:
    """One recording. ``started`` is None where the file has no such entry; ``ending`` says in words how it ended.

    ``estimates`` and ``conditions`` (the verdict on each) are those of its network file, by name; empty where there is
    no such file, or where it does not say.
    """

    recording: Path
    rig: str
    session: str
    started: datetime | None
    ending: str
    estimates: dict[str, Estimate]
    conditions: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Difference:
    """``second`` minus ``first``, with the standard deviation for independent sessions [unit of both]."""

    first: Estimate
    second: Estimate
    value: float
    std: float
    shows: bool  # at 95 %, corrected for how many parameters were looked at


@dataclass(frozen=True)
class Comparison:
    """Two runs: the difference of each parameter that both have, and those that have not the same unit in both."""

    differences: tuple[Difference, ...]
    left_out: tuple[tuple[Estimate, Estimate], ...] = ()


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


def compare(first: Run, second: Run) -> Comparison:
    """The difference of each parameter. Raises UsageError where they share none in one unit."""
    pairs = [(each, second.estimates[name]) for name, each in first.estimates.items() if name in second.estimates]
    if not pairs:
        raise UsageError(f"{first.recording} and {second.recording}: have no identified parameter in common")
    alike = [(one, other) for one, other in pairs if one.unit == other.unit]
    if not alike:
        names = ", ".join(one.name for one, _ in pairs)
        raise UsageError(f"{first.recording} and {second.recording}: have {names}, each in two units; compare others")
    beyond = -normal_quantile(tail_of_each(len(alike)))
    return Comparison(
        tuple(_difference(one, other, beyond) for one, other in alike),
        tuple((one, other) for one, other in pairs if one.unit != other.unit),
    )


def trend_of(name: str, runs: Sequence[Run]) -> Trend:
    """The trend of parameter ``name`` over ``runs`` of one rig, which all have it. Raises UsageError for fewer than
    two runs, and for several rigs: the mean of different actuators is the value of none."""
    rigs = sorted({run.rig for run in runs})
    if len(rigs) > 1:
        raise UsageError(f"{name}: was identified on {', '.join(rigs)}; choose one with --rig")
    if len(runs) < 2:
        raise UsageError(f"{name}: a trend needs two runs that identified it, here there are {len(runs)}")
    estimates = [run.estimates[name] for run in runs]
    units = {estimate.unit for estimate in estimates}
    if len(units) > 1:
        raise UsageError(f"{name}: was identified in {' and in '.join(sorted(units))}; these runs have no mean")
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
    verdicts: dict[str, str] = {}
    metadata: Mapping[str, str] = {}
    try:
        if network_file.is_file():
            network = NortonNetwork.load(network_file)
            estimates, metadata = _estimates(network), network.provenance
            verdicts = told(metadata, CONDITIONS)
            ending = _in_words(estimates.values(), verdicts)
        else:
            metadata, events = read_happenings(path)
            stop = next((event.text for event in reversed(events) if event.kind == "stop"), None)
            ending = _without_network(path, metadata) if stop is None else stop
    except UsageError as unreadable:
        ending = str(unreadable)
    name, session = metadata.get("rig", "?"), metadata.get("session", "?")
    return Run(path, name, session, _time(metadata), ending, estimates, verdicts)


def _without_network(path: Path, metadata: Mapping[str, str]) -> str:
    if metadata.get("model") == NO_MODEL:
        return "tables, no model"
    if path.with_suffix(".report.html").is_file():
        return "no network saved: no value is a result, its report says why"
    return "no network identified"


def _in_words(estimates: Iterable[Estimate], verdicts: Mapping[str, str]) -> str:
    """How many values have each status, and what was found of the conditions."""
    counts = Counter(estimate.status.value for estimate in estimates)
    words = ", ".join(f"{count} {status}" for status, count in counts.items())
    if not verdicts:
        return words
    others = [f"{name} {verdict}" for name, verdict in verdicts.items() if verdict != VERDICTS[True]]
    return f"{words}; {', '.join(others) or 'conditions hold'}"


def _time(metadata: Mapping[str, str]) -> datetime | None:
    try:
        return datetime.fromisoformat(metadata.get("started", ""))
    except ValueError:
        return None


def _estimates(network: NortonNetwork) -> dict[str, Estimate]:
    """The values in the network file, with the deviation and the status that the session gave them."""
    status, stds = told_statuses(network.provenance), told_deviations(network)
    return {
        name: Estimate(name, value, stds[name], unit, Status(status.get(name, Status.VALID.value)))
        for name, (value, unit) in _values(network).items()
        if name in stds
    }


def _values(network: NortonNetwork) -> dict[str, tuple[float, str]]:
    """Value and unit of each parameter of the network and of its terms."""
    unit = network.command_unit
    of_terms = {
        each.name: (value, each.unit_for(unit))
        for term in network.terms
        for each, value in zip(term.term.parameters, term.values, strict=True)
    }
    return network.parameters() | of_terms


def _difference(first: Estimate, second: Estimate, beyond: float) -> Difference:
    value, std = second.value - first.value, sqrt(first.std**2 + second.std**2)
    return Difference(first, second, value, std, abs(value) > beyond * std)
