"""How right the tool is on benches unlike the shipped ones: what it states, against the truth, on a wide family.

Every seed is one standard session on a simulated bench of its own, through frames and bytes: one of four drives and
three torque sensors, all true values drawn independently (``drawn``). The bench is told nothing; only this program
looks at the truth, afterwards. A session that is refused is counted, with the reason. Of those carried out, every
number with status ``valid`` is compared with the truth: coverage of the 95 % intervals, rms error over the stated
deviation, rms error over the Cramér-Rao bound (``bound.py``), by parameter, drive, sensor, and by tenths of noise and
counts.

    python benchmarks/wide_family.py [--seeds 401-520] [--quick] [--json] [--keep DIR] [--again DIR] [--jobs 2]

A session takes about a minute of processor time. ``--keep`` leaves the recordings in a folder; ``--again`` evaluates
such a folder once more without repeating the sessions. Seeds up to 400, and from 1001 to 5000, were used in
development: figures are published from others.
"""

import argparse
import json
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import verdicts
from identification import bounds, noise
from several import carried_out_by, seeds_in

from norton_bench.errors import BenchError
from norton_bench.identification.cleaning import clean
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import signals
from norton_bench.models.parameters import Status
from norton_bench.recording.reader import read_recording
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use
from norton_bench.session.conclusion import conclude_recording
from norton_bench.session.engine import record_session
from norton_bench.session.schema import standard_session
from norton_drivers.errors import DeviceError
from norton_sim.truth import read_truth, true_parameters

RIGS = Path(__file__).parents[1] / "rigs"
DRIVES = ("odrive", "cia402", "vesc", "mit")
SENSORS = {"bota": "sim-odrive", "dyn200": "sim-dyn200", "dbc": "sim-dbc"}
QUICK_SEEDS = "1-4"
ALL_SEEDS = "401-520"
WITHIN = 1.96  # deviations, of 95 %
SECTION = re.compile(r"^\[(?P<name>[^\]]+)\]", re.MULTILINE)
NORMAL_MEDIAN = 0.6745  # of the absolute value, in deviations
TENTHS = 10


@dataclass(frozen=True)
class Bench:
    """What is drawn of one bench that the figures are sorted by."""

    seed: int
    drive: str
    sensor: str
    noise_nm: float
    counts: int


@dataclass(frozen=True)
class Number:
    """One stated value. Error, deviation and bound are relative to the true value."""

    parameter: str
    error: float
    std: float
    bound: float
    status: str


@dataclass(frozen=True)
class Outcome:
    """One session: its numbers, or why there are none."""

    bench: Bench
    numbers: tuple[Number, ...] = ()
    refusal: str = ""


def drawn(seed: int) -> tuple[Bench, str]:
    """The bench of this seed, and its rig file."""
    rng = np.random.default_rng([seed, 20260])
    drive, sensor = str(rng.choice(DRIVES)), str(rng.choice(list(SENSORS)))
    text = with_sensor((RIGS / f"sim-{drive}.toml").read_text(encoding="utf-8"), sensor)

    def times(section: str, key: str, factor: float) -> None:
        nonlocal text
        text = changed(text, section, key, lambda value: f"{value * factor_of(factor):.6g}")

    def factor_of(widest: float) -> float:
        return float(widest ** rng.uniform(-1.0, 1.0))

    def between(section: str, key: str, low: float, high: float) -> float:
        """Log-uniform where both ends are positive, else uniform."""
        nonlocal text
        value = float(low * (high / low) ** rng.uniform()) if low > 0 else float(rng.uniform(low, high))
        text = changed(text, section, key, lambda _: f"{value:.6g}")
        return value

    friction = ("inertia", "viscous_damping", "coulomb_torque", "presliding_stiffness", "presliding_damping")
    for section, widest in (("simulated.actuator", 5.0), ("simulated.load", 4.0)):
        for key in friction:
            times(section, key, widest)
    between("simulated.actuator", "amplifier_bandwidth", 150.0, 2500.0)
    between("simulated.load", "torque_gain", 0.6, 1.3)
    between("simulated.torque_sensor", "stiffness", 40.0, 2000.0)
    noise_nm = 1e-3 * between("simulated.torque_sensor", "noise", 0.2, 5.0)
    between("simulated.torque_sensor", "bias", -20.0, 20.0)
    between("simulated.torque_sensor", "drift", -2e-5, 2e-5)
    between("simulated.transport", "can_delay", 100.0, 800.0)
    between("simulated.transport", "serial_delay", 200.0, 1500.0)
    between("simulated.transport", "can_jitter", 10.0, 300.0)
    between("simulated.transport", "serial_jitter", 10.0, 300.0)
    counts = [2 ** int(rng.integers(12, 21)) for _ in range(2)]
    for section, count in zip(("actuator", "load"), counts, strict=True):
        for table in (section, f"simulated.{section}"):
            text = changed(text, table, "counts_per_turn", lambda _, count=count: str(count), missing_ok=True)
    amplitude_mnm, periods = 0.05 * 60.0 ** rng.uniform(), int(rng.integers(12, 85))
    cogging = f'cogging = {{ amplitude = "{amplitude_mnm:.4g} mN*m", periods_per_turn = {periods} }}\n'
    text = re.sub(r"^cogging\s*=.*\n", cogging if rng.uniform() < 0.7 else "", text, flags=re.MULTILINE)
    return Bench(seed, drive, sensor, noise_nm, counts[0]), text


def changed(text: str, section: str, key: str, value: Callable[[float], str], *, missing_ok: bool = False) -> str:
    """The rig file with the number of one key replaced; its unit stays."""
    start, end = span(text, section)
    number = re.compile(rf'^(?P<head>{key}\s*=\s*"?)(?P<value>[-+0-9.e]+)', re.MULTILINE)
    body, count = number.subn(lambda m: m["head"] + value(float(m["value"])), text[start:end], count=1)
    if not count and not missing_ok:
        raise KeyError(f"[{section}] {key}")
    return text[:start] + body + text[end:]


def span(text: str, section: str) -> tuple[int, int]:
    """Where a section of the rig file begins and ends."""
    headers = list(SECTION.finditer(text))
    at = next(i for i, header in enumerate(headers) if header["name"] == section)
    return headers[at].start(), headers[at + 1].start() if at + 1 < len(headers) else len(text)


def with_sensor(text: str, sensor: str) -> str:
    """The rig file with the torque sensor of another one."""
    other = (RIGS / f"{SENSORS[sensor]}.toml").read_text(encoding="utf-8")
    for section in ("torque_sensor", "simulated.torque_sensor", "simulated.transport"):
        (start, end), (first, last) = span(text, section), span(other, section)
        text = text[:start] + other[first:last].rstrip() + "\n\n" + text[end:]
    if "serial_delay" not in text:
        text = text.rstrip() + '\nserial_delay = "400 us"\nserial_jitter = "100 us"\n'
    return text


def session(seed: int, keep: Path | None) -> Outcome:
    """One session, recorded and concluded as ``identify --no-live`` does it."""
    bench, text = drawn(seed)
    rig = replace(parse_rig(text, place=str(RIGS / f"wide-{seed}.toml")), candump=False)
    with nullcontext(keep) if keep else TemporaryDirectory() as folder:
        out = Path(folder) / str(seed)
        try:
            recording = record_session(rig, standard_session(rig), out=out, seed=seed, live=False).recording
        except Exception as error:
            return Outcome(bench, refusal=refusal(error))
        return evaluated(bench, rig, recording)


def refusal(error: Exception) -> str:
    """A defect of the tool counts as a refusal without a cause, and the others go on."""
    return str(error) if isinstance(error, BenchError | DeviceError) else f"failed unexpectedly: {error!r}"


def again(seed: int, kept: Path) -> Outcome | None:
    """The same from a recording that was kept; None where there is none."""
    bench, text = drawn(seed)
    rig = parse_rig(text, place=str(RIGS / f"wide-{seed}.toml"))
    recordings = sorted((kept / str(seed)).glob("**/*.mcap"))
    return evaluated(bench, rig, recordings[-1]) if recordings else None


def evaluated(bench: Bench, rig: Rig, recording: Path) -> Outcome:
    with TemporaryDirectory() as folder:
        try:
            result = conclude_recording(recording, Path(folder))
        except Exception as error:
            return Outcome(bench, refusal=refusal(error))
    if result.fit is None:
        return Outcome(bench, refusal="nothing was identified")
    return Outcome(bench, numbers_of(result.fit, rig, bench.seed, recording))


def numbers_of(result: FitResult, rig: Rig, seed: int, recording: Path) -> tuple[Number, ...]:
    """Every estimate beside the truth. A bound that cannot be computed is NaN."""
    truth = read_truth(rig.simulated, seed=seed, place=rig.place, command_unit=rig.command.unit)
    true = {name: true_parameters(truth, rig.command.unit)[name][0] for name in PHYSICAL}
    measured = clean(read_recording(recording, raw_frames=False).measured).measured
    stretches = signals(measured, rig.tick_s, Use.IDENTIFY)
    best = bounds(stretches, result, true, noise(truth, stretches, rig))
    return tuple(
        Number(
            name,
            result.estimate(name).value / true[name] - 1.0,
            result.estimate(name).std / abs(true[name]),
            best[name][0],
            result.estimate(name).status.value,
        )
        for name in PHYSICAL
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", help=f"first-last; {ALL_SEEDS} by default")
    parser.add_argument("--quick", action="store_true", help=f"seeds {QUICK_SEEDS}: two minutes")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="sessions at a time")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    parser.add_argument("--keep", type=Path, help="leave the recordings in this folder")
    parser.add_argument("--again", type=Path, help="evaluate the recordings of this folder once more")
    options = parser.parse_args()
    seeds = seeds_in(options.seeds or (QUICK_SEEDS if options.quick else ALL_SEEDS))
    work = partial(again, kept=options.again) if options.again else partial(session, keep=options.keep)
    outcomes = list(carried_out(work, seeds, options.jobs))
    if options.json:
        json.dump([asdict(outcome) for outcome in outcomes], sys.stdout, indent=2)
    else:
        show(outcomes)


def carried_out(work: Callable[[int], Outcome | None], seeds: Iterable[int], jobs: int) -> Iterator[Outcome]:
    """Every session in turn, with a line of progress on stderr."""
    yield from carried_out_by(work, seeds, jobs, progress_line)


def progress_line(outcome: Outcome) -> str:
    """Errors in deviations, in the order of PHYSICAL; in brackets what is not called valid."""
    bench = outcome.bench
    head = f"{bench.seed:5} {bench.drive:7}{bench.sensor:7}{bench.noise_nm * 1e3:5.2f} mN*m {bench.counts:7} counts: "
    if outcome.refusal:
        return head + outcome.refusal
    return head + " ".join(
        f"{n.error / n.std:+.2f}" if n.status == Status.VALID.value else f"[{n.status}]" for n in outcome.numbers
    )


def show(outcomes: Sequence[Outcome]) -> None:
    """What was carried out, then one line for each group."""
    done = [outcome for outcome in outcomes if not outcome.refusal]
    print(f"{len(done)} of {len(outcomes)} sessions carried out")
    valid = [(o.bench, n) for o in done for n in o.numbers if n.status == Status.VALID.value]
    print(f"{len(valid)} of {sum(len(o.numbers) for o in done)} values valid")
    print(f"{'':32}{'values':>7}{'in 95 %':>9}{'rms/std':>9}{'median/bound':>14}{'std/bound':>11}")
    line("all", [n for _, n in valid])
    for name in PHYSICAL:
        line(name, [n for _, n in valid if n.parameter == name])
    for drive in DRIVES:
        line(f"drive {drive}", [n for bench, n in valid if bench.drive == drive])
    for sensor in SENSORS:
        line(f"sensor {sensor}", [n for bench, n in valid if bench.sensor == sensor])
    for quantity, unit in (("noise_nm", "N*m"), ("counts", "counts")):
        tenths = np.quantile([getattr(o.bench, quantity) for o in outcomes], np.linspace(0, 1, TENTHS + 1))
        edges = np.unique(tenths)
        edges[-1] = np.nextafter(edges[-1], np.inf)
        for low, high in pairwise(edges):
            within = [n for bench, n in valid if low <= getattr(bench, quantity) < high]
            line(f"{low:.4g} to {high:.4g} {unit}", within)


def line(name: str, numbers: Sequence[Number]) -> None:
    """Over the bound stand the median error, as a deviation (a normal error's median is 0.6745 of it), and the median
    of the deviations that are stated."""
    if not numbers:
        return
    error, std, bound = np.array([(n.error, n.std, n.bound) for n in numbers]).T
    figure = verdicts.share(np.abs(error) <= WITHIN * std)
    print(
        f"{name:32}{len(numbers):7}{figure.value:9.1%}{np.sqrt(np.mean((error / std) ** 2)):9.2f}"
        f"{np.nanmedian(np.abs(error / bound)) / NORMAL_MEDIAN:14.2f}{np.nanmedian(std / bound):11.2f}"
    )


if __name__ == "__main__":
    main()
