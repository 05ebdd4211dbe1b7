"""What identification costs, final and live, beside the tools one would otherwise take.

One record is made through the real path: the standard session on the simulated bench. On it are measured
(a) the final fit of 60 s at 1 kHz beside one scipy LSODA simulation of the same record, (b) how the fit's time grows
with the record, (c) a CasADi multiple-shooting fit of a part of it, (d) what the live identifier costs a sample, and
how near its final values it is after 20 s. Run with ``python benchmarks/fit_speed.py [--quick] [--json]``; ``--quick``
takes less than 50 s on two cores, the whole some minutes. CasADi comes with ``pip install -e '.[benchmarks]'``.

All times are the processor's, on one thread, so that a busy machine spoils no ratio. How scipy is used is said in
lsoda.py: as fast as it goes. The ratio is taken to the faster of two ways of writing the equations. What CasADi is
given, and how, is said in multiple_shooting.py.
"""

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is imported

import lsoda
import numpy as np

from norton_bench.identification.judged_fit import fit
from norton_bench.identification.live import LiveIdentifier
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.results import FitResult, LiveEstimate
from norton_bench.identification.signals import signals
from norton_bench.records import Measured
from norton_bench.rig.load import load_rig
from norton_bench.segments import Use
from norton_bench.session.engine import run_session
from norton_bench.session.schema import Session, standard_session
from norton_sim.tools import true_parameters

RIG = Path(__file__).parents[1] / "rigs" / "sim-odrive.toml"
SEED = 1
PART_NS = 100_000_000
LIVE_AFTER_S = 20.0
RATIO_TARGET, LIVE_TARGET = 0.1, 0.02
# Off in both directions, so that no common factor helps.
START_OFF = (1.3, 0.7, 1.3, 0.7, 1.3, 0.7, 1.3)


@dataclass(frozen=True)
class Extent:
    """How much of everything."""

    lengths_s: tuple[float, ...]
    rounds: int
    simulated_s: float  # of the 60 s that LSODA goes through; its time is scaled to the rest
    shooting_s: float
    repeats: int  # of the session's excitations, to have enough data


FULL = Extent((15.0, 30.0, 60.0, 120.0, 240.0), rounds=3, simulated_s=60.0, shooting_s=10.0, repeats=4)
QUICK = Extent((15.0, 30.0, 60.0), rounds=1, simulated_s=12.0, shooting_s=4.0, repeats=1)
FIT_S = 60.0
FADE_IN_S = 1.0


@dataclass(frozen=True)
class Record:
    """One session's readings; the standard set of excitations ends at ``standard_ns``, the last set at ``end_ns``."""

    measured: Measured
    command_unit: str
    tick_s: float
    truth: dict[str, float]
    start_ns: int
    shaken_ns: int
    standard_ns: int
    end_ns: int

    def excited(self, duration_s: float) -> Measured:
        """The last so many seconds of the excitations: imposed motion, and as much before it as fits."""
        return self.measured.between(self.end_ns - round(duration_s * 1e9), self.end_ns)

    def fit(self, measured: Measured) -> FitResult:
        """Without the records that are simulated for its deviations."""
        return fit(measured, command_unit=self.command_unit, tick_s=self.tick_s, draws=0)

    def honest_fit(self, measured: Measured) -> FitResult:
        return fit(measured, command_unit=self.command_unit, tick_s=self.tick_s)


@dataclass(frozen=True)
class Row:
    """One figure; ``reached`` is None where there is no target."""

    name: str
    value: float | None
    unit: str
    target: float | None = None
    reached: bool | None = None
    note: str = ""


@dataclass
class Table:
    """The figures so far, shown as they come."""

    quiet: bool
    rows: list[Row] = field(default_factory=list)

    def head(self, text: str) -> None:
        if not self.quiet:
            print(f"\n{text}", flush=True)

    def add(
        self, name: str, value: float | None, unit: str = "", *, target: float | None = None, note: str = ""
    ) -> None:
        reached = None if target is None or value is None else bool(value <= target)
        self.rows.append(Row(name, value, unit, target, reached, note))
        if not self.quiet:
            verdict = "" if reached is None else f"at most {target:g}: {'reached' if reached else 'NOT reached'}"
            shown = "-" if value is None else f"{value:.4g} {unit}"
            print(f"  {name:38}{shown:>16}  {verdict}{'  ' if verdict and note else ''}{note}".rstrip(), flush=True)


def record(repeats: int) -> Record:
    """The standard session without its validation, its excitations ``repeats`` times."""
    rig = load_rig(RIG)
    steps = [step for step in standard_session(rig).steps if step.do != "validate"]
    once = [step for step in steps if step.do not in ("tare", "calibrate")]
    session = Session((*steps, *once * (repeats - 1)), "fit_speed")
    with TemporaryDirectory() as folder:
        measured = run_session(rig, session, out=Path(folder), seed=SEED).measured
    truth = true_parameters(rig.simulated, seed=SEED, place=rig.place, command_unit=rig.command.unit)
    ends_ns = [s.end_ns for s in measured.segments if s.use is Use.IDENTIFY and s.name == "multisine"]
    return Record(
        measured,
        rig.command.unit,
        rig.tick_s,
        {name: truth[name][0] for name in PHYSICAL},
        int(measured.ticks["tick_ns"][0]),
        next(s.start_ns for s in measured.segments if s.use is Use.CALIBRATE),
        ends_ns[1],  # the multisines of free and of imposed motion close each set
        ends_ns[-1],
    )


def timed(work: Callable[[], object]) -> float:
    begun_s = time.process_time()
    work()
    return time.process_time() - begun_s


def against_lsoda(made: Record, extent: Extent, table: Table) -> None:
    """(a): in turns, in the same run; medians."""
    whole, found = made.excited(FIT_S), made.fit(made.excited(FIT_S))
    stretches = signals(made.excited(extent.simulated_s), made.tick_s, Use.IDENTIFY)
    factor = FIT_S / sum(len(each.time_s) * made.tick_s for each in stretches)
    fits, plain, compiled = [], [], []
    for _ in range(extent.rounds):
        fits.append(timed(lambda: made.fit(whole)))
        plain.append(factor * lsoda.simulate(stretches, found, compiled=False))
        compiled.append(factor * lsoda.simulate(stretches, found, compiled=True))
        fits.append(timed(lambda: made.fit(whole)))
    seconds = {name: statistics.median(times) for name, times in (("fit", fits), ("py", plain), ("jit", compiled))}
    part = "" if factor < 1.5 else f"from {extent.simulated_s:g} s of the record, scaled"
    table.head(f"(a) final fit of {FIT_S:g} s at 1 kHz, beside one simulation of the same record")
    table.add("final fit", seconds["fit"], "s")
    table.add("final fit with the records simulated for its deviations", timed(lambda: made.honest_fit(whole)), "s")
    table.add("one LSODA simulation", seconds["py"], "s", note=part)
    table.add("one LSODA simulation, compiled equations", seconds["jit"], "s", note=part)
    table.add("fit / simulation", seconds["fit"] / min(seconds["py"], seconds["jit"]), target=RATIO_TARGET)


def with_length(made: Record, extent: Extent, table: Table) -> None:
    """(b)."""
    times = []
    table.head("(b) the fit's time with the record's length")
    for length_s in extent.lengths_s:
        part = made.excited(length_s)
        times.append(statistics.median(timed(lambda part=part: made.fit(part)) for _ in range(extent.rounds)))
        table.add(f"final fit of {length_s:g} s", times[-1], "s", note=f"{1e3 * times[-1] / length_s:.0f} ms a second")
    exponent = float(np.polyfit(np.log(extent.lengths_s), np.log(times), 1)[0])
    # Short parts differ in what they hold, and so in the steps that a fit takes.
    telling = extent.lengths_s[-1] >= 8 * extent.lengths_s[0]
    note = "1: linear" if telling else "1: linear; too short a range to tell"
    table.add("exponent", exponent, target=1.1 if telling else None, note=note)


def against_casadi(made: Record, extent: Extent, table: Table) -> None:
    """(c): on the multisines of imposed motion, which excite everything."""
    table.head(f"(c) {extent.shooting_s:g} s of imposed multisines: the final fit, and multiple shooting by CasADi")
    begin_ns = next(s.start_ns for s in made.measured.segments if (s.procedure, s.name) == ("imposed", "multisine"))
    begin_ns += round(FADE_IN_S * 1e9)
    part = made.measured.between(begin_ns, begin_ns + round(extent.shooting_s * 1e9))
    ours_s = statistics.median(timed(lambda: made.fit(part)) for _ in range(extent.rounds))
    ours = made.fit(part)
    table.add("final fit", ours_s, "s", note=f"{ours_s / extent.shooting_s:.2f} s a second of data; no initial guess")
    if find_spec("casadi") is None:
        table.add("multiple shooting", None, note="CasADi is not installed: pip install -e '.[benchmarks]'")
        return
    import multiple_shooting  # noqa: PLC0415  (with a dependency of its own)

    longest = max(signals(part, made.tick_s, Use.IDENTIFY), key=lambda each: each.time_s.size)
    start = {name: made.truth[name] * off for name, off in zip(PHYSICAL, START_OFF, strict=True)}
    theirs = multiple_shooting.fit_by_shooting(multiple_shooting.aligned(longest, ours), start)
    took_s = theirs.build_s + theirs.solve_s
    note = f"{took_s / extent.shooting_s:.2f} s a second of data; {theirs.iterations} iterations from 30 % off"
    table.add("multiple shooting", took_s, "s", note=note + ("" if theirs.converged else "; did NOT converge"))
    table.add("multiple shooting / final fit", took_s / ours_s)
    for name in PHYSICAL:
        truth = made.truth[name]
        error, other = 100 * (ours.estimate(name).value / truth - 1), 100 * (theirs.values[name] / truth - 1)
        table.add(f"error of {name.replace('_', ' ')}", error, "%", note=f"multiple shooting {other:+.2f} %")


def live(made: Record, table: Table) -> None:
    """(d): in parts of 100 ms from the first tick to the end of the standard excitations."""
    identifier = LiveIdentifier(made.command_unit, made.tick_s)
    parts = [
        made.measured.between(at, min(at + PART_NS, made.standard_ns))
        for at in range(made.start_ns, made.standard_ns, PART_NS)
    ]
    states, costs = [], []
    for part in parts:
        begun_s = time.process_time()
        states.append(identifier.update(part))
        costs.append(time.process_time() - begun_s)
    final = made.fit(made.measured.between(made.start_ns, made.standard_ns))
    each_us = 1e6 * sum(costs) / sum(len(part.ticks) for part in parts)
    table.head("(d) live, in parts of 100 ms")
    table.add("cost a sample", each_us, "µs", note=f"{1e-4 * each_us / made.tick_s:.1f} % of a core")
    table.add("costliest part", 1e3 * max(costs), "ms", note="in a process of its own where time does not wait")
    for origin_ns, what in ((made.start_ns, "the session's first tick"), (made.shaken_ns, "data that tell begin")):
        since(states, final, origin_ns, what, table)


def since(states: list[LiveEstimate], final: FitResult, origin_ns: int, what: str, table: Table) -> None:
    """How far each live parameter still was from what it ended at, and from the final fit."""
    table.head(f"    {LIVE_AFTER_S:g} s after {what}: difference from the last live value")
    at = max((s for s in states if s.stamp_ns <= origin_ns + LIVE_AFTER_S * 1e9), key=lambda s: s.stamp_ns)
    early = {estimate.name: estimate for estimate in at.estimates}
    for last in states[-1].estimates:
        if last.name not in early:
            table.add(last.name, None, "%", target=100 * LIVE_TARGET, note="no estimate yet")
            continue
        value, ended = early[last.name].value, final.estimate(last.name).value
        note = f"{early[last.name].status.value}; {100 * (value / ended - 1):+.2f} % from the final fit"
        table.add(last.name, 100 * abs(value / last.value - 1), "%", target=100 * LIVE_TARGET, note=note)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="less of everything, in less than 50 s")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    options = parser.parse_args()
    extent = QUICK if options.quick else FULL
    begun_s = time.perf_counter()
    table = Table(quiet=options.json)
    made = record(extent.repeats)
    against_lsoda(made, extent, table)
    with_length(made, extent, table)
    against_casadi(made, extent, table)
    live(made, table)
    table.head("")
    table.add("the whole run", time.perf_counter() - begun_s, "s", target=50.0 if options.quick else None)
    if options.json:
        json.dump([asdict(row) for row in table.rows], sys.stdout, indent=2)


if __name__ == "__main__":
    main()
