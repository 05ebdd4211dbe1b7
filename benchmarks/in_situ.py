"""How well a motion source is found in situ, through the real loop on simulated benches (paper, sections V and VI.E).

Each session is tared, calibrated where the rig has a torque sensor, and repeats a movement by the step ``in_situ``,
which looks at no torque sensor. Printed for each rig: how many trials; how far the true torque between actuator and
load, below 30 Hz, lies below that of the first trial, in the last three driven ones; and how far the source's path is
from that of the same actuator with nothing on its shaft, as a share of its own rms. Run with
``python benchmarks/in_situ.py [--seeds 1-10] [--rigs NAMES] [--json] [--jobs 2]``; a session takes about 40 s.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError, SafetyStopError
from norton_bench.identification.in_situ import IN_SITU, SourceMotion, in_situ_result
from norton_bench.identification.trials import in_band, number_of, trial_segments
from norton_bench.procedures.catalogue import make_procedures
from norton_bench.procedures.options import CalibrateOptions, InSituOptions, TareOptions
from norton_bench.records import Measured
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.engine import record_procedures
from norton_bench.session.schema import Session, Step
from norton_drivers.registry import load_backend
from norton_sim.backend import SimulatedBackend
from norton_sim.plant import Plant
from norton_sim.truth import read_truth

RIGS = Path(__file__).parents[1] / "rigs"
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
    path_relative: float = float("nan")
    settled: bool = False
    error: str = ""


@dataclass
class Eyes:
    """Looks at the true port torque once a tick."""

    backend: SimulatedBackend
    tick_ns: int

    def __post_init__(self) -> None:
        self.seen: list[tuple[int, float]] = []
        world = self.backend.world
        world.every(self.tick_ns, self._look, first_ns=world.now_ns + self.tick_ns)

    def _look(self, now_ns: int) -> None:
        self.seen.append((now_ns, self.backend.world.plant.true_port_torque_nm()))

    def rms_nm(self, measured: Measured, tick_s: float) -> dict[int, float]:
        """Of each trial, below 30 Hz, its mean included."""
        time_ns, torque_nm = (np.array(each) for each in zip(*self.seen, strict=True))
        found = {}
        for segment in trial_segments(measured, IN_SITU):
            part = slice(*np.searchsorted(time_ns, (segment.start_ns, segment.end_ns)))
            found[number_of(segment)] = float(np.sqrt(np.mean(in_band(torque_nm[part], tick_s) ** 2)))
        return found


def one(name: str, seed: int) -> Outcome:
    """The session of one seed; one that fails leaves its reason."""
    try:
        return _one(replace(load_rig(RIGS / f"{name}.toml"), candump=False), seed)
    except (ExperimentError, SafetyStopError) as error:
        return Outcome(name, seed, error=str(error))


def _one(rig: Rig, seed: int) -> Outcome:
    sensed = rig.wiring.torque_sensor is not None
    calibrate = [Step("calibrate", CalibrateOptions())] if sensed else []
    steps = (Step("tare", TareOptions()), *calibrate, Step(IN_SITU, InSituOptions(**STEPS[rig.name])))
    procedures = make_procedures([(step.do, step.options) for step in steps], rig, place="benchmark")
    backend = load_backend("simulated")(rig.wiring, rig.simulated, seed=seed, place=rig.place)
    assert isinstance(backend, SimulatedBackend)
    eyes = Eyes(backend, rig.tick_ns)
    with TemporaryDirectory() as folder:
        done = record_procedures(
            rig, Session(steps, "benchmark"), procedures, out=Path(folder), backend=backend, seed=seed
        )
    result = in_situ_result(done.measured, rig.tick_s)
    if result is None or result.source is None:
        raise ExperimentError("no source was found")
    true_nm = eyes.rms_nm(done.measured, rig.tick_s)
    driven = [trial.number for trial in result.trials if trial.driven][-LAST:]
    left_nm = float(np.sqrt(np.mean([true_nm[number] ** 2 for number in driven])))
    below_db = float(20 * np.log10(true_nm[1] / left_nm))
    path = path_relative(rig, seed, result.source)
    return Outcome(rig.name, seed, len(result.trials), below_db, path, result.converged)


def path_relative(rig: Rig, seed: int, source: SourceMotion) -> float:
    """The rms error of the source's path, as a share of the rms of the true one about its mean."""
    true = free_path_rad(rig, seed, source.command)
    ticks = np.arange(len(true))
    errors = []
    for delay_s in DELAYS_S:
        error = source.position_rad - np.interp(ticks - delay_s / rig.tick_s, ticks, true)
        errors.append(float(np.std(error)))
    return min(errors) / float(np.std(true))


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
    first, _, last = options.seeds.partition("-")
    for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(threads, "1")
    found: list[Outcome] = []
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        seeds = range(int(first), int(last or first) + 1)
        for job in [pool.submit(one, name, seed) for name, seed in product(options.rigs, seeds)]:
            found.append(job.result())
            print(line_of(found[-1]), file=sys.stderr, flush=True)
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
    return f"{head}{outcome.trials} trials, {outcome.below_db:.1f} dB, path {outcome.path_relative:.2%} off, {end}"


def show(found: Sequence[Outcome]) -> None:
    """The figures of each rig, with their spread."""
    for name in dict.fromkeys(outcome.rig for outcome in found):
        told = [outcome for outcome in found if outcome.rig == name and not outcome.error]
        print(f"{name}: {len(told)} of {sum(outcome.rig == name for outcome in found)} sessions")
        if told:
            below = np.array([outcome.below_db for outcome in told])
            path = np.array([outcome.path_relative for outcome in told])
            print(f"    torque below the first trial's: median {np.median(below):.1f} dB", end=" ")
            print(f"({np.min(below):.1f} to {np.max(below):.1f})")
            print(f"    source's path off by: median {np.median(path):.2%} ({np.min(path):.2%} to {np.max(path):.2%})")


if __name__ == "__main__":
    main()
