"""Whether the measured map of the motion source holds the true one: whole sessions on the simulated bench.

Each session is the standard one, recorded through the real loop, then concluded as any is. Counted are the moving
levels of the staircases whose true velocity lies in the 95 % interval given; sessions whose two branches are said to
differ, or whose zero is said not to be unique, on a bench on which neither is so; how far the free motion of the
validation is from what the network foresees; and the torque at the port, of which the simulation knows the truth. Run
with
``python benchmarks/source_map.py [--seeds 1-20] [--quick] [--json] [--rig RIG] [--jobs 2]``; a seed takes about 40 s.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import verdicts
from several import carried_out_by, seeds_in

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError
from norton_bench.identification.branches import SKIPPED_SHARE, TAILS
from norton_bench.identification.results import SourceMap
from norton_bench.identification.source_map import dwells, is_staircase
from norton_bench.procedures.catalogue import make_procedures
from norton_bench.records import Measured
from norton_bench.result import Result
from norton_bench.rig.load import load_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.conclusion import conclude
from norton_bench.session.engine import record_procedures
from norton_bench.session.schema import standard_session
from norton_drivers.registry import load_backend
from norton_sim.backend import SimulatedBackend
from norton_sim.truth import read_truth

RIG = Path(__file__).parents[1] / "rigs" / "sim-odrive.toml"
QUICK_SEED = "1"
LOOK_NS = 500_000
# What is to be reached.
COVERAGE = (0.93, 0.97)
FALSE_ALARMS = 0.05
FREE_ERROR = 0.015


@dataclass(frozen=True)
class Outcome:
    """One session. Arrays are of the moving levels, but torques of all; ``error`` says why there is nothing else."""

    seed: int
    within: list[bool]
    deviations: list[float]  # errors over the deviations given
    std_rad_s: list[float]
    hysteresis: bool
    unique_zero: bool | None
    free_relative: float
    port_nm: list[float]  # as stated, without the sensor's zero
    port_std_nm: list[float]
    true_port_nm: list[float]
    error: str = ""


@dataclass
class Eyes:
    """Looks at the true port torque twice a tick."""

    backend: SimulatedBackend

    def __post_init__(self) -> None:
        self.seen: list[tuple[int, float]] = []
        world = self.backend.world
        world.every(LOOK_NS, self._look, first_ns=world.now_ns + LOOK_NS)

    def _look(self, now_ns: int) -> None:
        self.seen.append((now_ns, self.backend.world.plant.true_port_torque_nm()))

    def means_nm(self, windows: Sequence[tuple[int, int]]) -> list[float]:
        """Of windows of time [ns]."""
        time_ns, torque_nm = np.array([now for now, _ in self.seen]), np.array([torque for _, torque in self.seen])
        return [float(np.mean(torque_nm[slice(*np.searchsorted(time_ns, window))])) for window in windows]


def one(rig_file: Path, seed: int) -> Outcome:
    """The session of one seed; one that fails leaves its reason."""
    try:
        return _one(replace(load_rig(rig_file), candump=False), seed)
    except ExperimentError as error:
        return Outcome(seed, [], [], [], False, None, float("nan"), [], [], [], str(error))


def _one(rig: Rig, seed: int) -> Outcome:
    session = standard_session(rig)
    steps = make_procedures([(step.do, step.options) for step in session.steps], rig, place="standard session")
    backend = load_backend("simulated")(rig.wiring, rig.simulated, seed=seed, place=rig.place)
    assert isinstance(backend, SimulatedBackend)
    eyes = Eyes(backend)
    with TemporaryDirectory() as folder:
        done = record_procedures(rig, session, steps, out=Path(folder), backend=backend, seed=seed)
        found = conclude(
            done.measured,
            rig_text=rig.text,
            metadata=done.metadata,
            live=done.live,
            recording=done.recording,
            out=Path(folder),
        )
    if found.source_map is None or found.validation is None:
        raise ExperimentError("no source map, or nothing to validate on")
    return _judged(found, found.source_map, rig, seed, eyes.means_nm(windows(done.measured)))


def _judged(found: Result, source: SourceMap, rig: Rig, seed: int, true_port_nm: list[float]) -> Outcome:
    assert found.validation is not None
    true = true_velocity(rig, seed, source.command)
    low, high = np.quantile(source.resampled_rad_s, TAILS, axis=0)
    moves = true != 0.0
    hysteresis = source.hysteresis()
    return Outcome(
        seed,
        within=((low <= true) & (true <= high))[moves].tolist(),
        deviations=((source.velocity_rad_s - true) / source.velocity_std_rad_s)[moves].tolist(),
        std_rad_s=source.velocity_std_rad_s[moves].tolist(),
        hysteresis=hysteresis is not None and hysteresis.significant,
        unique_zero=next(each.holds for each in found.conditions if each.condition == "unique zero"),
        free_relative=found.validation.velocity_relative,
        port_nm=source.port_torque_nm.tolist(),
        port_std_nm=source.port_torque_std_nm.tolist(),
        true_port_nm=true_port_nm,
    )


def true_velocity(rig: Rig, seed: int, command: FloatArray) -> FloatArray:
    """Of the free shaft [rad/s], for the torque motor with Coulomb friction (paper, section IV.D)."""
    motor = read_truth(rig.simulated, seed=seed, place=rig.place, command_unit=rig.command.unit).actuator.motor
    torque_nm = motor.Km * motor.Ka * command
    return np.asarray(np.sign(torque_nm) * np.maximum(np.abs(torque_nm) - motor.tau_c, 0.0) / motor.B)


def windows(measured: Measured) -> list[tuple[int, int]]:
    """What of each level is looked at [ns]."""
    found = []
    for segment in filter(is_staircase, measured.segments):
        for _, begin_ns, end_ns in dwells(measured.ticks, segment):
            found.append((round(begin_ns + SKIPPED_SHARE * (end_ns - begin_ns)), end_ns))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", type=Path, default=RIG)
    parser.add_argument("--seeds", help="first-last, 1-20 unless told")
    parser.add_argument("--quick", action="store_true", help=f"seed {QUICK_SEED}: under a minute, few figures")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="sessions at a time")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    options = parser.parse_args()
    seeds = seeds_in(options.seeds or (QUICK_SEED if options.quick else "1-20"))
    found = list(carried_out_by(partial(one, options.rig), seeds, options.jobs, progress_line))
    if options.json:
        json.dump([asdict(outcome) for outcome in found], sys.stdout, indent=2)
    else:
        show(found)


def progress_line(outcome: Outcome) -> str:
    """The session in a line."""
    if outcome.error:
        return f"seed {outcome.seed}: {outcome.error}"
    held = f"{sum(outcome.within)} of {len(outcome.within)} levels"
    said = f"{', branches differ' * outcome.hysteresis}{', zero not unique' * (outcome.unique_zero is False)}"
    return f"seed {outcome.seed}: {held}, free motion {outcome.free_relative:.2%} off{said}"


def show(found: Sequence[Outcome]) -> None:
    """The figures, each with what was to be reached."""
    told = [outcome for outcome in found if not outcome.error]
    print(f"{len(told)} of {len(found)} sessions")
    if not told:
        return
    sessions = len(told)
    levels = np.concatenate([outcome.within for outcome in told]).astype(bool)
    low, high = between_sessions([float(np.mean(outcome.within)) for outcome in told])
    print(
        f"moving levels within their 95 % intervals: {np.count_nonzero(levels)} of {levels.size}, {np.mean(levels):.1%}"
        f" (by session {low:.1%} to {high:.1%}); {COVERAGE[0]:.0%} to {COVERAGE[1]:.0%} wanted"
    )
    deviations, std = (np.concatenate([getattr(each, key) for each in told]) for key in ("deviations", "std_rad_s"))
    print(f"    rms error over deviation {np.sqrt(np.mean(deviations**2)):.2f}; deviation {np.median(std):.3f} rad/s")
    for words, alarms in (
        ("branches said to differ", np.array([outcome.hysteresis for outcome in told])),
        ("zero said not to be unique", np.array([outcome.unique_zero is False for outcome in told])),
    ):
        figure = verdicts.share(alarms)
        print(f"{words}: {np.count_nonzero(alarms)} of {sessions} (95 %: up to {figure.interval[1]:.0%}), ", end="")
        print(f"{FALSE_ALARMS:.0%} allowed")
    free = np.array([outcome.free_relative for outcome in told])
    print(f"free motion off by {np.min(free):.2%} to {np.max(free):.2%}, median {np.median(free):.2%}", end="; ")
    print(f"below {FREE_ERROR:.1%}: {np.count_nonzero(free < FREE_ERROR)} of {sessions}")
    show_torque(told)


def show_torque(told: Sequence[Outcome]) -> None:
    """What was left at the port while levels were held."""
    stated, std, true = (
        np.concatenate([getattr(outcome, key) for outcome in told])
        for key in ("port_nm", "port_std_nm", "true_port_nm")
    )
    means = np.array([np.mean(outcome.true_port_nm) for outcome in told])
    print(f"true torque at the port, mean of each level: rms {1e3 * np.sqrt(np.mean(true**2)):.3f} mN m, ", end="")
    print(f"greatest {1e3 * np.max(np.abs(true)):.3f}; of each session's levels {1e3 * np.mean(means):+.3f}", end=" ")
    print(f"({1e3 * np.min(means):+.3f} to {1e3 * np.max(means):+.3f})")
    held = np.abs(stated - true) <= 1.96 * std
    print(f"    within the 95 % interval of what is stated: {np.mean(held):.1%} of {held.size} levels", end="; ")
    print(f"rms error over deviation {np.sqrt(np.mean(((stated - true) / std) ** 2)):.2f}")


def between_sessions(values: Sequence[float]) -> tuple[float, float]:
    """A 95 % interval of the mean: sessions are independent, their levels are not."""
    half = 1.96 * float(np.std(values, ddof=1)) / np.sqrt(len(values)) if len(values) > 1 else float("nan")
    return float(np.mean(values)) - half, float(np.mean(values)) + half


if __name__ == "__main__":
    main()
