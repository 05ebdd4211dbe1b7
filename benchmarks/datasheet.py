"""How often the data sheet's 95 % intervals hold the truth, figure by figure, on benches of a wide family.

Every seed is a bench and a recording of its own (``wide_family.py --keep``, which also draws the truth). Each recording
is fitted as ``norton-bench datasheet`` does it; every figure whose parameters are valid is compared with what its
formula gives for the true parameters (tests/bench/datasheet checks the formulas by simulation). Cogging is compared
with the true amplitude at the true order; a line at another order counts as false.

    python benchmarks/datasheet.py KEPT [--seeds 1-120] [--jobs 1] [--json]

KEPT is the folder that ``wide_family.py --keep`` filled. Some fifteen seconds of processor time a recording. Seeds from
1001 on are for development: the published figures come from seeds 1-120.
"""

import argparse
import json
import os
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import pi
from pathlib import Path

import numpy as np
import verdicts
from wide_family import RIGS, carried_out_by, drawn, span

from norton_bench.datasheet.evidence import Evidence
from norton_bench.datasheet.sheet import sheet_of_fit
from norton_bench.errors import BenchError
from norton_bench.identification.fit import PHYSICAL
from norton_bench.identification.judged_fit import fit_judged
from norton_bench.identification.residuals.diagnosis import diagnose
from norton_bench.identification.soundness.recording import sound
from norton_bench.models.derived import derived
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Status
from norton_bench.recording.reader import read_recording
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_sim.truth import read_truth, true_parameters

LEAST, MOST = 0.93, 0.97  # of the share that is to be held
COGGING, FALSE_LINES = "cogging", "lines where there are none"
AMPLITUDE = re.compile(r'amplitude = "([0-9.e+-]+) mN\*m", periods_per_turn = (\d+)')


@dataclass(frozen=True)
class Told:
    """One figure of one recording beside the truth."""

    seed: int
    name: str
    true: float
    value: float
    interval: tuple[float, float]
    valid: bool

    @property
    def holds(self) -> bool:
        return self.interval[0] <= self.true <= self.interval[1]


@dataclass(frozen=True)
class Outcome:
    """One recording; nothing where it was refused, with the reason."""

    seed: int
    figures: tuple[Told, ...] = ()
    refusal: str = ""


def evaluated(seed: int, kept: Path) -> Outcome:
    """The sheet of one recording beside the truth."""
    _, text = drawn(seed)
    rig = parse_rig(text, place=str(RIGS / f"wide-{seed}.toml"))
    recordings = sorted((kept / str(seed)).glob("**/*.mcap"))
    if not recordings:
        return Outcome(seed, refusal="no recording was kept")
    recording = read_recording(recordings[-1], raw_frames=False)
    try:
        fit = fit_judged(sound(recording.measured), command_unit=rig.command.unit, tick_s=rig.tick_s)
    except BenchError as error:
        return Outcome(seed, refusal=str(error))
    sheet = sheet_of_fit(fit.result, recording, diagnose(fit.result, fit.stretches), file=str(recordings[-1]))
    true = {figure.key: figure.value for figure in derived(true_network(rig, seed), sheet.points)}
    told = tuple(
        Told(seed, f.key, true[f.key], f.value, f.interval, f.status is Status.VALID)
        for f in sheet.figures()
        if f.key in true
    )
    return Outcome(seed, (*told, *cogging(seed, sheet.evidence, true_cogging(text))))


def true_network(rig: Rig, seed: int) -> NortonNetwork:
    """The network that the simulated motor has; it needs some covariance, of which nothing is asked."""
    truth = true_parameters(read_truth(rig.simulated, seed=seed, place=rig.place, command_unit=rig.command.unit))
    nothing = tuple((0.0,) * len(PHYSICAL) for _ in PHYSICAL)
    values = {name: truth[name][0] for name in PHYSICAL}
    return NortonNetwork.of_parameters(values, rig.command.unit, covariance_names=PHYSICAL, covariance=nothing)


def true_cogging(text: str) -> tuple[float, int] | None:
    """Amplitude [N m] and periods a turn of the actuator's; None where it has none."""
    first, last = span(text, "simulated.actuator")
    found = AMPLITUDE.search(text[first:last])
    return (1e-3 * float(found[1]), int(found[2])) if found else None


def cogging(seed: int, evidence: Evidence, true: tuple[float, int] | None) -> Iterator[Told]:
    """Every line that stands out, beside the true one."""
    for order in evidence.orders:
        wave = order.cogging_nm
        ends = (wave.amplitude - wave.half_width, wave.amplitude + wave.half_width)
        if wave.shows and true is not None and order.periods_per_turn == true[1]:
            yield Told(seed, COGGING, true[0], wave.amplitude, ends, valid=True)
        elif wave.shows:
            yield Told(seed, FALSE_LINES, 0.0, wave.amplitude, ends, valid=True)
        if order.ripple.shows:
            wave = order.ripple
            yield Told(seed, FALSE_LINES, 0.0, wave.amplitude, (0.0, pi), valid=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kept", type=Path, help="folder of wide_family.py --keep")
    parser.add_argument("--seeds", default="1-120", help="first-last")
    parser.add_argument("--jobs", type=int, default=1, help="recordings at a time")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    options = parser.parse_args()
    for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(threads, "1")
    first, _, last = options.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    outcomes = list(carried_out_by(partial(evaluated, kept=options.kept), seeds, options.jobs, progress_line))
    if options.json:
        json.dump([asdict(outcome) for outcome in outcomes], sys.stdout, indent=2)
    else:
        show(outcomes)


def progress_line(outcome: Outcome) -> str:
    """Which valid figures did not hold the truth."""
    valid = [told for told in outcome.figures if told.valid]
    off = ", ".join(told.name for told in valid if not told.holds)
    return (
        f"{outcome.seed:5} {outcome.refusal or f'{len(valid)} of {len(outcome.figures)} valid'}; off: {off or 'none'}"
    )


def show(outcomes: Sequence[Outcome]) -> None:
    """One line a figure: how many were valid, how many held the truth, and between what that share lies."""
    done = [outcome for outcome in outcomes if not outcome.refusal]
    told = [figure for outcome in done for figure in outcome.figures]
    print(f"{len(done)} of {len(outcomes)} recordings; aim {LEAST:.0%} to {MOST:.0%}")
    print(f"{'':40}{'figures':>8}{'valid':>7}{'in 95 %':>9}{'interval':>18}  aim")
    for name in dict.fromkeys(figure.name for figure in told):
        line(name, [figure for figure in told if figure.name == name])
    line("all", [figure for figure in told if figure.name != FALSE_LINES])


def line(name: str, told: Sequence[Told]) -> None:
    """Of one figure."""
    held = np.array([figure.holds for figure in told if figure.valid], dtype=bool)
    share = verdicts.share(held)
    low, high = share.interval
    verdict = verdicts.WORDS[share.within(LEAST, MOST, held.size)] if held.size else ""
    print(f"{name:40}{len(told):8}{held.size:7}{share.value:9.1%}{f'{low:.1%} … {high:.1%}':>18}  {verdict}")


if __name__ == "__main__":
    main()
