"""How near the truth a whole identification comes, how near the Cramér-Rao bound, and how honest its intervals are.

Every seed is one standard session on the simulated bench of ``rigs/sim-odrive.toml``, through frames and bytes, with
every true value of actuator and load multiplied by a factor of its own, drawn log-uniformly between 1/2 and 2. The
bench is told nothing; only this program looks at the truth, afterwards. Twice: *plain*, without cogging, and
*disturbed*, with cogging and a torque sensor that answers half a tick later than it did.

The bound is that of both measured noises, the torque sensor's and the encoder's counts, with amplifier, friction, both
delays, the sensor's zero and the path itself unknown, at the true values (``bound.py``). Beside it stands the bound of
the torque sensor's noise alone, as if the encoder told the path exactly. Jitter of the bus only adds to both. Run with
``python benchmarks/identification.py [--seeds 1-100] [--quick] [--json] [--rig RIG] [--fixed] [--jobs 2]``; a seed
takes about 12 s, twice. ``--fixed`` leaves the rig's true values as they are.
"""

import argparse
import json
import os
import re
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import bound
import numpy as np
import verdicts
from several import one_thread_each, seeds_in

from norton_bench.errors import ExperimentError
from norton_bench.identification.expansion import Linearised, information
from norton_bench.identification.fit import network_of
from norton_bench.identification.judged_fit import fit
from norton_bench.identification.motor_values import KNOWN, PHYSICAL
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import Signals, signals
from norton_bench.models.parameters import Status
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.segments import Use
from norton_bench.session.engine import record_session
from norton_bench.session.schema import standard_session
from norton_bench.units import parse_quantity
from norton_sim.truth import Truth, read_truth, true_parameters

RIG = Path(__file__).parents[1] / "rigs" / "sim-odrive.toml"
PLAIN, DISTURBED = "plain", "disturbed"
QUICK_SEED = "1"
WITHIN = 1.96  # deviations, of 95 %
# What is to be reached.
STD_OVER_BOUND = 1.3
COVERAGE = (0.92, 0.98)
VARIED = re.compile(
    r"""^(?P<key>amplifier_gain|amplifier_bandwidth|torque_constant|torque_gain|inertia|viscous_damping|coulomb_torque
    |presliding_stiffness|presliding_damping)(?P<is>\s*=\s*")(?P<value>[0-9.e+-]+)""",
    re.VERBOSE,
)
COGGING = re.compile(r"^cogging\s*=.*\n", re.MULTILINE)
SENSOR_DELAY = re.compile(r'^(serial_delay\s*=\s*")([^"]+)(")', re.MULTILINE)
HALF_A_TICK_S = 0.5e-3


@dataclass(frozen=True)
class Outcome:
    """One parameter of one session: error, deviation given and bounds, all relative to the true value."""

    condition: str
    seed: int
    parameter: str
    error: float
    std: float
    bound: float
    bound_torque_alone: float
    valid: bool
    converged: bool
    data_s: float


def outcomes(rig: Rig, seed: int, condition: str) -> Iterator[Outcome]:
    """Identify, then compare. Nobody reads a log of the bus."""
    quiet = replace(rig, candump=False)
    with TemporaryDirectory() as folder:
        measured = record_session(quiet, standard_session(quiet), out=Path(folder), seed=seed).measured
    stretches = signals(measured, rig.tick_s, Use.IDENTIFY)
    result = fit(measured, command_unit=rig.command.unit, tick_s=rig.tick_s)
    truth = read_truth(rig.simulated, seed=seed, place=rig.place, command_unit=rig.command.unit)
    true = {name: true_parameters(truth, rig.command.unit)[name][0] for name in PHYSICAL}
    best = bounds(stretches, result, true, noise(truth, stretches, rig))
    for name in PHYSICAL:
        estimate = result.estimate(name)
        error, std = estimate.value / true[name] - 1.0, estimate.std / abs(true[name])
        valid = estimate.status is Status.VALID
        data_s = result.samples * rig.tick_s
        yield Outcome(condition, seed, name, error, std, *best[name], valid, result.converged, data_s)


def noise(truth: Truth, stretches: tuple[Signals, ...], rig: Rig) -> bound.Noise:
    """What torque sensor, encoder and wire add to a reading, by their true values.

    The shaft may stand anywhere within the step in which its position comes, be it the encoder's count or the drive's
    word. A drive in MIT mode, or a moteus, reads when a command arrives, and answers: the time from command to answer
    then tells half of the variance of either's travel.
    """
    answers_commands = rig.wiring.actuator.driver in ("mit", "moteus")
    travel_s = truth.transport.can_jitter_ns * 1e-9 / np.sqrt(3)
    if answers_commands:
        travel_s /= np.sqrt(2)
    step_rad = max(2 * np.pi / truth.actuator.counts_per_turn, stretches[0].counts.width)
    return bound.Noise(
        truth.torque_sensor.noise_nm, step_rad / np.sqrt(12), travel_s if answers_commands else 0.0, travel_s
    )


def bounds(
    stretches: tuple[Signals, ...], result: FitResult, true: dict[str, float], noise: bound.Noise
) -> dict[str, tuple[float, float]]:
    """Cramér-Rao, relative, by parameter: of both noises, and of the torque sensor's alone."""
    known = [replace(result.estimate(name), value=value) for name, value in true.items()]
    network = network_of(known, result.network.command_unit)
    at = replace(Linearised.at(result), network=network, band=bound.WIDE_BAND)
    both = bound.information(stretches, at, noise, motion_band=result.band)
    alone = information(stretches, at, noise.torque_nm)
    deviations = [np.sqrt(np.diag(np.linalg.pinv(matrix, hermitian=True))) for matrix in (both, alone)]
    return {name: (float(least), float(of_torque)) for name, least, of_torque in zip(KNOWN, *deviations, strict=True)}


def varied(text: str, seed: int) -> str:
    """The rig file with every true value of the machines multiplied by a factor of its own."""
    rng = np.random.default_rng(seed)
    head, mark, truth = text.partition("[simulated]")
    lines = []
    for line in truth.splitlines():
        factor = 2.0 ** rng.uniform(-1.0, 1.0)
        lines.append(VARIED.sub(lambda m, f=factor: f"{m['key']}{m['is']}{float(m['value']) * f:.6g}", line))
    return head + mark + "\n".join(lines) + "\n"


def under(text: str, condition: str) -> str:
    """The rig file with its disturbances, or without."""
    if condition == PLAIN:
        return COGGING.sub("", text)
    return SENSOR_DELAY.sub(lambda m: f"{m[1]}{parse_quantity(m[2], 's') + HALF_A_TICK_S:.6g} s{m[3]}", text)


def one(rig_file: Path, seed: int, condition: str, *, fixed: bool) -> list[Outcome]:
    """One session of one seed; one that fails leaves outcomes without numbers."""
    text = under(rig_file.read_text(encoding="utf-8"), condition)
    rig = parse_rig(text if fixed else varied(text, seed), place=str(rig_file))
    try:
        return list(outcomes(rig, seed, condition))
    except ExperimentError as error:
        print(f"seed {seed} {condition}: {error}", file=sys.stderr, flush=True)
        nothing = (float("nan"),) * 4
        return [Outcome(condition, seed, name, *nothing, False, False, 0.0) for name in PHYSICAL]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", type=Path, default=RIG)
    parser.add_argument("--seeds", help="first-last, 1-100 unless told")
    parser.add_argument("--fixed", action="store_true", help="the rig's own true values for every seed")
    parser.add_argument("--quick", action="store_true", help=f"seed {QUICK_SEED}: half a minute, few figures")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="sessions at a time")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    options = parser.parse_args()
    seeds = seeds_in(options.seeds or (QUICK_SEED if options.quick else "1-100"))
    one_thread_each()
    todo = list(product(seeds, (PLAIN, DISTURBED)))
    found: list[Outcome] = []
    # Fresh processes: what one session leaves behind in memory is not the next one's business.
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        jobs = [pool.submit(one, options.rig, seed, condition, fixed=options.fixed) for seed, condition in todo]
        try:
            for job in jobs:
                found += job.result()
                print(progress_line(found[-len(PHYSICAL) :]), file=sys.stderr, flush=True)
        except KeyboardInterrupt:  # what is done is shown
            pool.shutdown(cancel_futures=True)
    summaries = {condition: summary([o for o in found if o.condition == condition]) for condition in (PLAIN, DISTURBED)}
    if options.json:
        json.dump({"conditions": summaries, "outcomes": [asdict(outcome) for outcome in found]}, sys.stdout, indent=2)
    else:
        for condition, figures in summaries.items():
            show(condition, figures)


def progress_line(session: Sequence[Outcome]) -> str:
    """Errors in deviations, in the order of PHYSICAL."""
    z = " ".join(f"{outcome.error / outcome.std:+.2f}" for outcome in session)
    return f"seed {session[0].seed} {session[0].condition}: errors in std {z}"


def summary(found: Sequence[Outcome]) -> dict[str, Any]:
    """Figures of one condition, by parameter and in all; what too few sessions cannot tell is None."""
    told = [o for o in found if o.converged]
    sessions = len(told) // len(PHYSICAL)
    counted = {"sessions": len(found) // len(PHYSICAL), "converged": sessions}
    if not told:
        return {**counted, "parameters": {}, "coverage_reached": None, "std_over_bound_reached": None}
    coverage = verdicts.share(np.array([abs(o.error) <= WITHIN * o.std for o in told]))
    ratios = [np.array([o.error / o.bound for o in told if o.parameter == name]) for name in PHYSICAL]
    over_bound = [verdicts.rms(ratio, len(PHYSICAL)).within(0.0, STD_OVER_BOUND, sessions) for ratio in ratios]
    return {
        **counted,
        "data_s": float(np.mean([o.data_s for o in told])),
        "parameters": {name: of_parameter([o for o in told if o.parameter == name]) for name in PHYSICAL},
        "coverage_95": coverage.value,
        "coverage_95_interval": coverage.interval,
        "coverage_reached": coverage.within(*COVERAGE, sessions),
        "std_over_bound_reached": verdicts.every(over_bound),
    }


def of_parameter(rows: Sequence[Outcome]) -> dict[str, float]:
    """Figures of one parameter, from sessions that converged.

    ``std_over_bound`` is the rms error over the bound, so that a bias counts too; ``std_given_over_bound`` is what the
    bench itself says of it.
    """
    error = np.array([row.error for row in rows])
    std, least, of_torque = np.array([(row.std, row.bound, row.bound_torque_alone) for row in rows]).T
    return {
        "mean_error": float(np.mean(error)),
        "rms_error": float(np.sqrt(np.mean(error**2))),
        "greatest_error": float(np.max(np.abs(error))),
        "std_given": float(np.median(std)),
        "std_given_over_bound": float(np.median(std / least)),
        "bound": float(np.median(least)),
        "bound_torque_alone": float(np.median(of_torque)),
        "std_over_bound": float(np.sqrt(np.mean((error / least) ** 2))),
        "std_over_bound_torque_alone": float(np.sqrt(np.mean((error / of_torque) ** 2))),
        "error_over_std_given": float(np.sqrt(np.mean((error / std) ** 2))),
        "coverage_95": float(np.mean(np.abs(error) <= WITHIN * std)),
        "valid": float(np.mean([row.valid for row in rows])),
    }


def show(condition: str, figures: dict[str, Any]) -> None:
    """One line a parameter, then the whole."""
    print(f"{condition}: {figures['converged']} of {figures['sessions']} sessions converged", end="")
    if not figures["converged"]:
        print("\n")
        return
    print(f", {figures['data_s']:.0f} s used")
    print(
        f"{'':22}{'mean':>9}{'rms':>9}{'greatest':>10}{'std given':>11}{'/ bound':>9}{'bound':>9}{'rms /':>7}", end=""
    )
    print(f"{'of torque alone':>17}{'rms /':>7}{'in 95 %':>9}")
    for name, row in figures["parameters"].items():
        print(
            f"{name:22}{row['mean_error']:>+9.3%}{row['rms_error']:>9.3%}{row['greatest_error']:>10.2%}"
            f"{row['std_given']:>11.3%}{row['std_given_over_bound']:>9.2f}{row['bound']:>9.3%}"
            f"{row['std_over_bound']:>7.2f}{row['bound_torque_alone']:>17.3%}"
            f"{row['std_over_bound_torque_alone']:>7.2f}{row['coverage_95']:>9.0%}"
        )
    low, high = figures["coverage_95_interval"]
    print(f"in all {figures['coverage_95']:.1%} of the 95 % intervals hold the truth ({low:.0%}-{high:.0%})", end="; ")
    print(f"92-98 %: {verdicts.WORDS[figures['coverage_reached']]}", end="; ")
    print(f"every rms error within {STD_OVER_BOUND} bounds: {verdicts.WORDS[figures['std_over_bound_reached']]}\n")


if __name__ == "__main__":
    main()
