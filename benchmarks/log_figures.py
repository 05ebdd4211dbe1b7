"""What the benchmarks of logs share: a log written and fitted, its errors in deviations, and the figures of many."""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from several import seeds_in

from norton_bench.arrays import FloatArray
from norton_bench.logs.column_map import parse_map
from norton_bench.logs.fit import Request, fit_logs
from norton_bench.logs.results import LogFit
from norton_bench.models.parameters import HALF_INTERVAL, Status

# What one machine came to; its ``errors`` are in deviations, by name.
Judged = Mapping[str, Any]


def fit_of(columns: Mapping[str, FloatArray], text: str, digits: int) -> LogFit:
    """Of a CSV with these columns, by the map ``text``."""
    with TemporaryDirectory() as folder:
        path, table = Path(folder) / "log.csv", np.stack(list(columns.values()), axis=1)
        np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt=f"%.{digits}g")
        return fit_logs(Request((path,), parse_map(text, place="the benchmark's map")))


def errors_of(fit: LogFit, truth: Mapping[str, float], statuses: Sequence[Status]) -> dict[str, float]:
    """The error of each value that is known and has one of these statuses, in deviations."""
    return {
        each.name: (each.value - truth[each.name]) / each.std
        for each in fit.estimates
        if each.name in truth and each.status in statuses
    }


def within(errors: Sequence[float]) -> float:
    """The share of errors in their 95 % intervals."""
    return float(np.mean(np.abs(errors) < HALF_INTERVAL))


def report(
    doc: str | None,
    seeds: str,
    judged: Callable[[int], Judged],
    heading: Callable[[Judged], str],
    further: Callable[[Sequence[Judged]], Mapping[str, object]],
) -> None:
    """Prints each machine of the seeds asked for, ``seeds`` by default, and the figures of all, ``further`` too."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default=seeds)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    every: list[Judged] = []
    for seed in seeds_in(options.seeds):
        every.append(judged(seed))
        if not options.json:
            told = ", ".join(f"{name} {error:+.1f}" for name, error in every[-1]["errors"].items())
            print(f"{seed} {heading(every[-1])}; {told}", flush=True)
    errors = [error for one in every for error in one["errors"].values()]
    figures = {
        "logs": len(every),
        "intervals": len(errors),
        "coverage": within(errors),
        "rms_error_in_deviations": float(np.sqrt(np.mean(np.square(errors)))),
        **further(every),
    }
    print(json.dumps({"figures": figures, "logs": every}, indent=2) if options.json else json.dumps(figures, indent=2))
