"""How well a motion source is found in situ, through the real loop on simulated benches (paper, sections V and VI.E).

Each session is tared, calibrated where the rig has a torque sensor, and repeats a movement by the step ``in_situ``,
which looks at no torque sensor. The load's inertia and its Coulomb friction are drawn anew for each session: 1 to 8
times, and half to twice, those of the rig. Printed for each rig: how far the true torque between actuator and load,
below 30 Hz, lies below that of the first trial, in the last three driven ones, and whether it is within what the
session says may be hidden; how far the source's path is from that of the same actuator with nothing on its shaft, as a
share of its own rms, beside that of the loaded actuator; and how many sessions say that there is nothing more to learn.
Run with ``python benchmarks/in_situ.py [--seeds 1-10] [--rigs NAMES] [--json] [--jobs 2]``; a session takes about 40 s.
Development used seeds from 101 on.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from several import carried_out_by, seeds_in
from source_map import LOOK_NS, Eyes
from wide_family import RIGS, changed

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError, SafetyStopError
from norton_bench.identification.at_ticks import in_band, readings_at_ticks
from norton_bench.identification.in_situ import IN_SITU, in_situ_result
from norton_bench.identification.trials import number_of, trial_segments
from norton_bench.procedures.catalogue import make_procedures
from norton_bench.procedures.options import CalibrateOptions, InSituOptions, TareOptions
from norton_bench.records import Measured
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.engine import record_procedures
from norton_bench.session.schema import Session, Step
from norton_drivers.registry import load_backend
from norton_sim.backend import SimulatedBackend
from norton_sim.plant import Plant
from norton_sim.truth import read_truth

# An arm reaches to where it is told; all else follows a multisine. The load's damping is known where nothing tells it.
STEPS: dict[str, dict[str, Any]] = {
    "sim-in-situ": {"viscous_damping_nms_rad": 3.16e-4},
    "sim-odrive": {},
    "sim-series-elastic": {},
    "sim-variable-stiffness": {},
    "sim-gear-train": {},
    "sim-pneumatic": {},
    "sim-arm": {"hold_s": 0.5},
}
# The factors between which the load's values are drawn.
LOAD = {"inertia": (1.0, 8.0), "coulomb_torque": (0.5, 2.0)}
LAST = 3
# The commands and the readings travel for a time that the source does not tell.
DELAYS_S = np.arange(0.0, 4e-3, 1e-4)
REST_S = 3.0


@dataclass(frozen=True)
class Outcome:
    """One session; ``error`` says why there is nothing else."""

    rig: str
    seed: int
    trials: int = 0
    below_db: float = float("nan")
    left_nm: float = float("nan")
    hidden_nm: float = float("nan")
    path_relative: float = float("nan")
    loaded_relative: float = float("nan")
    settled: bool = False
    error: str = ""


def one(task: tuple[str, int]) -> Outcome:
    """The session of a rig and a seed; one that fails leaves its reason."""
    name, seed = task
    try:
        return _one(replace(_rig(name, seed), candump=False), seed)
    except (ExperimentError, SafetyStopError) as error:
        return Outcome(name, seed, error=str(error))


def _rig(name: str, seed: int) -> Rig:
    """With another load in each session."""
    text, random = (RIGS / f"{name}.toml").read_text(encoding="utf-8"), np.random.default_rng(seed)
    for key, (low, high) in LOAD.items():
        factor = low * (high / low) ** random.uniform()
        text = changed(text, "simulated.load", key, partial(_times, factor))
    return parse_rig(text, place=str(RIGS / f"{name}.toml"))


def _times(factor: float, value: float) -> str:
    return f"{factor * value:.4g}"


def _one(rig: Rig, seed: int) -> Outcome:
    sensed = rig.wiring.torque_sensor is not None
    calibrate = [Step("calibrate", CalibrateOptions())] if sensed else []
    steps = (Step("tare", TareOptions()), *calibrate, Step(IN_SITU, InSituOptions(**STEPS[rig.name])))
    procedures = make_procedures([(step.do, step.options) for step in steps], rig, place="benchmark")
    backend = load_backend("simulated")(rig.wiring, rig.simulated, seed=seed, place=rig.place)
    assert isinstance(backend, SimulatedBackend)
    eyes = Eyes(backend)
    with TemporaryDirectory() as folder:
        done = record_procedures(
            rig, Session(steps, "benchmark"), procedures, out=Path(folder), backend=backend, seed=seed
        )
    result = in_situ_result(done.measured, rig.tick_s)
    if result is None or result.source is None:
        raise ExperimentError("no source was found")
    true_nm = rms_nm(eyes, done.measured)
    driven = [trial for trial in result.trials if trial.driven][-LAST:]
    left_nm = float(np.sqrt(np.mean([true_nm[trial.number] ** 2 for trial in driven])))
    source = result.source
    true_rad = free_path_rad(rig, seed, source.command)
    first = readings_at_ticks(done.measured, trial_segments(done.measured, IN_SITU)[0], len(true_rad), rig.tick_s)
    return Outcome(
        rig.name,
        seed,
        trials=len(result.trials),
        below_db=float(20 * np.log10(true_nm[1] / left_nm)),
        left_nm=left_nm,
        hidden_nm=float(np.hypot(driven[-1].with_noise_nm, driven[-1].hidden_nm)),
        path_relative=off_relative(source.position_rad, true_rad, rig.tick_s),
        loaded_relative=off_relative(first.position_rad, true_rad, rig.tick_s),
        settled=result.converged,
    )


def rms_nm(eyes: Eyes, measured: Measured) -> dict[int, float]:
    """The true torque of each trial, below 30 Hz, its mean included."""
    time_ns, torque_nm = (np.array(each) for each in zip(*eyes.seen, strict=True))
    found = {}
    for segment in trial_segments(measured, IN_SITU):
        part = slice(*np.searchsorted(time_ns, (segment.start_ns, segment.end_ns)))
        found[number_of(segment)] = float(np.sqrt(np.mean(in_band(torque_nm[part], LOOK_NS * 1e-9) ** 2)))
    return found


def off_relative(path_rad: FloatArray, true_rad: FloatArray, tick_s: float) -> float:
    """The rms error of a path, as a share of the rms of the true one about its mean."""
    ticks = np.arange(len(true_rad))
    delayed = (np.interp(ticks - delay_s / tick_s, ticks, true_rad) for delay_s in DELAYS_S)
    return min(float(np.std(path_rad - each)) for each in delayed) / float(np.std(true_rad))


def free_path_rad(rig: Rig, seed: int, command: FloatArray) -> FloatArray:
    """The same actuator's, with nothing on its shaft, from rest under the first of the commands."""
    truth = read_truth(
        rig.simulated,
        seed=seed,
        place=rig.place,
        command_unit=rig.command.unit,
        modulation_unit=None if rig.modulation is None else rig.modulation.unit,
    )
    plant, position = Plant(truth.model_copy(update={"load": None}), seed, "free"), np.zeros(len(command))
    plant.command("actuator", float(command[0]))
    begin_ns = round(REST_S * 1e9)
    plant.advance(begin_ns)
    for tick, value in enumerate(command):
        position[tick] = plant.true_position_rad("actuator")
        plant.command("actuator", float(value))
        plant.advance(begin_ns + (tick + 1) * rig.tick_ns)
    return position


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1-10", help="first-last")
    parser.add_argument("--rigs", nargs="+", default=list(STEPS), choices=list(STEPS))
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="sessions at a time")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    options = parser.parse_args()
    tasks = product(options.rigs, seeds_in(options.seeds))
    found = list(carried_out_by(one, tasks, options.jobs, line_of))
    if options.json:
        json.dump([asdict(outcome) for outcome in found], sys.stdout, indent=2)
    else:
        show(found)


def line_of(outcome: Outcome) -> str:
    """The session in a line."""
    head = f"{outcome.rig}, seed {outcome.seed}: "
    if outcome.error:
        return head + outcome.error
    end = "settled" if outcome.settled else "not settled"
    left = f"{1e3 * outcome.left_nm:.2f} mN m left of {1e3 * outcome.hidden_nm:.2f} said"
    path = f"path {outcome.path_relative:.2%} off, loaded {outcome.loaded_relative:.2%}"
    return f"{head}{outcome.trials} trials, {outcome.below_db:.1f} dB, {left}, {path}, {end}"


def show(found: Sequence[Outcome]) -> None:
    """The figures of each rig, with their spread."""
    for name in dict.fromkeys(outcome.rig for outcome in found):
        told = [outcome for outcome in found if outcome.rig == name and not outcome.error]
        print(f"{name}: {len(told)} of {sum(outcome.rig == name for outcome in found)} sessions")
        if told:
            below = np.array([outcome.below_db for outcome in told])
            print(f"    torque below the first trial's: median {np.median(below):.1f} dB", end=" ")
            print(f"({np.min(below):.1f} to {np.max(below):.1f}); within what is said", end=" ")
            print(f"{sum(outcome.left_nm <= outcome.hidden_nm for outcome in told)} of {len(told)}")
            for what, key in (("source's path", "path_relative"), ("loaded path", "loaded_relative")):
                off = np.array([getattr(outcome, key) for outcome in told])
                print(f"    {what} off by: median {np.median(off):.2%} ({np.min(off):.2%} to {np.max(off):.2%})")
            trials = [outcome.trials for outcome in told]
            print(f"    {min(trials)} to {max(trials)} trials; nothing more to learn in", end=" ")
            print(f"{sum(outcome.settled for outcome in told)} of {len(told)}")


if __name__ == "__main__":
    main()
