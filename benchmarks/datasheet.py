"""How often the data sheet's 95 % intervals hold the truth, figure by figure, on benches of a wide family.

Every seed is a bench and a recording of its own (``wide_family.py --keep``, which also draws the truth). Each recording
is fitted as ``norton-bench datasheet`` does it; every figure whose parameters are valid is compared with what its
formula gives for the true parameters (tests/bench/models checks the formulas by simulation). Cogging is compared
with the true amplitude at the true order; a line at another order counts as false.

    python benchmarks/datasheet.py KEPT [--seeds 121-265] [--jobs 1] [--lines FILE] [--json]

KEPT is the folder that ``wide_family.py --keep`` filled. Some fifteen seconds of processor time a recording. With
``--lines`` each recording's outcome is written to FILE as it comes, and what stands there is not evaluated again. The
published figures come from seeds 121-265: those below and from 1001 on are for development.
"""

import argparse
import json
import re
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import verdicts
from several import carried_out_by, seeds_in
from wide_family import RIGS, drawn, span

from norton_bench.datasheet.evidence import Evidence
from norton_bench.datasheet.ripple import CHANCE
from norton_bench.datasheet.sheet import sheet_of_result
from norton_bench.errors import BenchError
from norton_bench.identification.cleaning import clean
from norton_bench.identification.judged_fit import fit_judged
from norton_bench.identification.motor_values import PHYSICAL
from norton_bench.identification.residual_tests import diagnose
from norton_bench.models.derived import derived
from norton_bench.models.network import NortonNetwork
from norton_bench.models.parameters import Status
from norton_bench.recording.reader import read_recording
from norton_bench.result import Result
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_sim.truth import read_truth, true_parameters

LEAST, MOST = 0.93, 0.97  # of the share that is to be held
COGGING = "cogging"
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
    """One recording; nothing where it was refused, with the reason. ``false_lines`` are orders at which a torque was
    told and the bench has none."""

    seed: int
    figures: tuple[Told, ...] = ()
    refusal: str = ""
    false_lines: tuple[float, ...] = ()


def evaluated(seed: int, kept: Path) -> Outcome:
    """The sheet of one recording beside the truth."""
    _, text = drawn(seed)
    rig = parse_rig(text, place=str(RIGS / f"wide-{seed}.toml"))
    recordings = sorted((kept / str(seed)).glob("**/*.mcap"))
    if not recordings:
        return Outcome(seed, refusal="no recording was kept")
    try:
        recording = read_recording(recordings[-1], raw_frames=False)
        fit = fit_judged(clean(recording.measured), command_unit=rig.command.unit, tick_s=rig.tick_s)
    except BenchError as error:
        return Outcome(seed, refusal=str(error))
    result = Result(
        recording.metadata["rig"],
        recording.rig_text,
        recording.metadata,
        recordings[-1],
        recording.measured,
        fit=fit.result,
        residuals=diagnose(fit.result, fit.stretches),
    )
    sheet = sheet_of_result(result)
    true = {figure.key: figure.value for figure in derived(true_network(rig, seed), sheet.points)}
    told = tuple(
        Told(seed, f.key, true[f.key], f.value, f.interval, f.status is Status.VALID)
        for f in sheet.figures()
        if f.key in true
    )
    return with_lines(Outcome(seed, told), sheet.evidence, true_cogging(text))


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


def with_lines(outcome: Outcome, evidence: Evidence, true: tuple[float, int] | None) -> Outcome:
    """The true line where it stands out, and any other torque that does; the simulated drives have no ripple."""
    figures, false = list(outcome.figures), []
    for order in evidence.orders:
        wave, periods = order.cogging_nm, order.periods_per_turn
        true_one = true is not None and periods == true[1]
        if true_one and wave.shows:
            ends = (wave.amplitude - wave.half_width, wave.amplitude + wave.half_width)
            figures.append(Told(outcome.seed, COGGING, true[0], wave.amplitude, ends, valid=True))
        if order.ripple.shows or (wave.shows and not true_one):
            false.append(periods)
    return replace(outcome, figures=tuple(figures), false_lines=tuple(false))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kept", type=Path, help="folder of wide_family.py --keep")
    parser.add_argument("--seeds", default="121-265", help="first-last")
    parser.add_argument("--jobs", type=int, default=1, help="recordings at a time")
    parser.add_argument("--lines", type=Path, help="write each outcome to this file, and go on where it ends")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    options = parser.parse_args()
    seeds = seeds_in(options.seeds)
    outcomes = [each for each in read(options.lines) if each.seed in seeds]
    missing = [seed for seed in seeds if seed not in {each.seed for each in outcomes}]
    for outcome in carried_out_by(partial(evaluated, kept=options.kept), missing, options.jobs, progress_line):
        outcomes.append(outcome)
        if options.lines:
            with options.lines.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(outcome)) + "\n")
    if options.json:
        json.dump([asdict(outcome) for outcome in outcomes], sys.stdout, indent=2)
    else:
        show(outcomes)


def read(lines: Path | None) -> list[Outcome]:
    """What was written before."""
    if lines is None or not lines.exists():
        return []
    every = [json.loads(line) for line in lines.read_text(encoding="utf-8").splitlines()]
    return [
        Outcome(
            each["seed"],
            tuple(Told(**told | {"interval": tuple(told["interval"])}) for told in each["figures"]),
            each["refusal"],
            tuple(each["false_lines"]),
        )
        for each in every
    ]


def progress_line(outcome: Outcome) -> str:
    """Which valid figures did not hold the truth."""
    valid = [told for told in outcome.figures if told.valid]
    off = ", ".join(told.name for told in valid if not told.holds)
    told = outcome.refusal or f"{len(valid)} of {len(outcome.figures)} valid; off: {off or 'none'}"
    return f"{outcome.seed:5} {told}" + "".join(f"; false line at {each:g}" for each in outcome.false_lines)


def show(outcomes: Sequence[Outcome]) -> None:
    """One line a figure: how many were valid, how many held the truth, and between what that share lies."""
    done = [outcome for outcome in outcomes if not outcome.refusal]
    told = [figure for outcome in done for figure in outcome.figures]
    print(f"{len(done)} of {len(outcomes)} recordings; aim {LEAST:.0%} to {MOST:.0%}")
    print(f"{'':40}{'figures':>8}{'valid':>7}{'in 95 %':>9}{'interval':>18}  aim")
    for name in dict.fromkeys(figure.name for figure in told):
        line(name, [figure for figure in told if figure.name == name])
    line("all", told)
    clean = verdicts.share(np.array([not outcome.false_lines for outcome in done], dtype=bool))
    low, high = clean.interval
    print(
        f"no false line in {clean.value:.1%} of recordings ({low:.1%} … {high:.1%}), of which {1 - CHANCE:.0%} is asked"
    )


def line(name: str, told: Sequence[Told]) -> None:
    """Of one figure."""
    held = np.array([figure.holds for figure in told if figure.valid], dtype=bool)
    share = verdicts.share(held)
    low, high = share.interval
    verdict = verdicts.WORDS[share.within(LEAST, MOST, held.size)] if held.size else ""
    print(f"{name:40}{len(told):8}{held.size:7}{share.value:9.1%}{f'{low:.1%} … {high:.1%}':>18}  {verdict}")


if __name__ == "__main__":
    main()
