"""How well the stiffness of an arm is found at each instant of its movement, in situ, through the real loop.

Each session is tared, calibrated, and repeats a movement of the simulated arm (``rigs/sim-arm.toml``) by the step
``in_situ`` with ``pushes``. Stiffness at rest, what a reach adds to it, the duration of a reach, and the load's inertia
and friction are drawn anew for each. Printed: the rms error of the stiffness along the path, as a share of its own
mean, and the share of instants inside the 95 % interval; beside it, by the same trials, what two other methods find
(van de Ruit et al., Annual Reviews in Control 52, 2021, compares such): each piece of the movement by itself, as if
nothing changed within it, and each instant by itself, from the ensemble of trials.

    python benchmarks/stiffness_along.py [--seeds 1-10] [--json] [--jobs 2]

A session takes about 40 s. Development used seeds from 101 on.
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
from in_situ import LOAD
from several import carried_out_by, seeds_in
from wide_family import RIGS, changed

from norton_bench.arrays import FloatArray
from norton_bench.errors import ExperimentError, SafetyStopError
from norton_bench.identification.assembly import Trial, load_taken
from norton_bench.identification.at_ticks import in_band
from norton_bench.identification.in_situ import IN_SITU, in_situ_result, pushed_segments
from norton_bench.identification.path_impedance import exerted_nm, motions_rad
from norton_bench.procedures.options import CalibrateOptions, InSituOptions, TareOptions
from norton_bench.recording.reader import read_recording
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.engine import record_session
from norton_bench.session.schema import Session, Step

HOLD_S, PUSHES = 0.5, 8
# Between which the arm's values are drawn: shares of the rig's, and the duration of a reach [s].
ARM = {"stiffness": (0.5, 2.0), "moving_stiffness": (0.3, 3.0)}
REACH_S = (0.25, 0.45)
# Pieces that are taken for constant, and an instant, which holds what the torque's band lets pass.
PIECES_S = {"pieces of 400 ms": 0.4, "pieces of 200 ms": 0.2, "pieces of 100 ms": 0.1, "each instant": 0.016}
DELAYS_S = np.arange(0.0, 6e-3, 2e-4)


@dataclass(frozen=True)
class Outcome:
    """One session; ``error`` says why there is nothing else. Errors are relative to the mean stiffness."""

    seed: int
    off_relative: float = float("nan")
    held: float = float("nan")
    half_relative: float = float("nan")
    resolution_s: float = float("nan")
    others: dict[str, float] | None = None
    error: str = ""


def one(seed: int) -> Outcome:
    """The session of a seed; one that fails leaves its reason."""
    try:
        return _one(seed)
    except (ExperimentError, SafetyStopError) as error:
        return Outcome(seed, error=str(error))


def drawn(seed: int) -> tuple[Rig, FloatArray]:
    """The rig, and the arm's stiffness at rest, what is added to it [N m/rad], and the duration of a reach [s]."""
    text, random = (RIGS / "sim-arm.toml").read_text(encoding="utf-8"), np.random.default_rng(seed)
    values = []
    for section, ranges in (("simulated.load", LOAD), ("simulated.actuator", ARM)):
        for key, (low, high) in ranges.items():
            factor = low * (high / low) ** random.uniform()
            text = changed(text, section, key, partial(_noted, values, factor))
    reach_s = round(random.uniform(*REACH_S), 3)
    text = changed(text, "simulated.actuator", "movement", lambda _: f"{1e3 * reach_s:g}")
    return parse_rig(text, place=str(RIGS / "sim-arm.toml")), np.array([*values[len(LOAD) :], reach_s])


def _noted(values: list[float], factor: float, value: float) -> str:
    written = f"{factor * value:.4g}"
    values.append(float(written))
    return written


def _one(seed: int) -> Outcome:
    rig, arm = drawn(seed)
    in_situ = InSituOptions(hold_s=HOLD_S, pushes=PUSHES)
    steps = (Step("tare", TareOptions()), Step("calibrate", CalibrateOptions()), Step(IN_SITU, in_situ))
    with TemporaryDirectory() as folder:
        session = Session(steps, "benchmark")
        recorded = record_session(replace(rig, candump=False), session, out=Path(folder), seed=seed, live=False)
        measured = read_recording(recorded.recording, raw_frames=False).measured
    result, load = in_situ_result(measured, rig.tick_s), load_taken(measured.events)
    if load is None or result is None or result.source is None or result.along is None:
        raise ExperimentError("no impedance was found along the path")
    along, command = result.along, result.source.command
    true, delay_s = true_nm_rad(along.time_s, along.stiffness_nm_rad, command, arm, rig)
    trials = [Trial.of(measured, each, load, rig.tick_s) for each in pushed_segments(measured)]
    motions, torques = motions_rad(load.machine, trials, rig.tick_s), exerted_nm(trials, rig.tick_s)
    others = {}
    for name, piece_s in PIECES_S.items():
        at_s, stiffness = by_pieces(motions, torques, piece_s, rig.tick_s)
        inside = (at_s >= along.time_s[0]) & (at_s <= along.time_s[-1])
        truth = stiffness_nm_rad(at_s[inside] - delay_s, command, arm, rig)
        others[name] = _relative(stiffness[inside], truth)
    return Outcome(
        seed,
        _relative(along.stiffness_nm_rad, true),
        float(np.mean(np.abs(along.stiffness_nm_rad - true) <= along.stiffness_half_nm_rad)),
        float(np.median(along.stiffness_half_nm_rad) / np.mean(true)),
        along.resolution_s,
        others,
    )


def _relative(found: FloatArray, true: FloatArray) -> float:
    return float(np.sqrt(np.mean((found - true) ** 2)) / np.mean(true))


def true_nm_rad(
    at_s: FloatArray, found: FloatArray, command: FloatArray, arm: FloatArray, rig: Rig
) -> tuple[FloatArray, float]:
    """The true stiffness, with the delay of command and readings that fits best, and that delay."""
    each = [(stiffness_nm_rad(at_s - delay_s, command, arm, rig), float(delay_s)) for delay_s in DELAYS_S]
    return min(each, key=lambda one: float(np.sum((one[0] - found) ** 2)))


def stiffness_nm_rad(at_s: FloatArray, command: FloatArray, arm: FloatArray, rig: Rig) -> FloatArray:
    """At the load's encoder, the coupling included, in newton metres as the load drive counts them."""
    at_rest, added, reach_s = arm
    changes_s = np.flatnonzero(np.diff(command)) * rig.tick_s + rig.tick_s
    since_s = at_s - np.concatenate([[-np.inf], changes_s])[np.searchsorted(changes_s, at_s, side="right")]
    progress = np.clip(since_s / reach_s, 0.0, 1.0)
    own = at_rest + added * 16.0 * progress**2 * (1.0 - progress) ** 2
    gain, coupling = (_number(rig, *path) for path in (("load", "torque_gain"), ("torque_sensor", "stiffness")))
    return np.asarray(1.0 / (gain / own + gain / coupling))


def _number(rig: Rig, section: str, key: str) -> float:
    return float(str(rig.simulated[section][key]).split()[0])


def by_pieces(motions: FloatArray, torques: FloatArray, piece_s: float, tick_s: float) -> tuple[FloatArray, FloatArray]:
    """The middles of pieces, each half a piece after the last, and the stiffness in each, by least squares of inertia,
    damping and stiffness: as if nothing changed within a piece, and as if the others told nothing of it."""
    differences = motions - motions.mean(axis=0)
    derivatives = [differences]
    for _ in range(2):
        derivatives.append(np.gradient(derivatives[-1], tick_s, axis=1))
    rows = -np.stack([in_band(each, tick_s) for each in derivatives], axis=-1)
    wanted = torques - torques.mean(axis=0)
    length = max(round(piece_s / tick_s), 1)
    starts = np.arange(0, motions.shape[1] - length, max(length // 2, 1))
    found = [_stiffness(rows[:, start : start + length], wanted[:, start : start + length]) for start in starts]
    return (starts + length / 2) * tick_s, np.array(found)


def _stiffness(rows: FloatArray, torques: FloatArray) -> float:
    flat = rows.reshape(-1, 3)
    size = np.sqrt(np.mean(flat**2, axis=0)) + 1e-300
    return float(np.linalg.lstsq(flat / size, torques.reshape(-1), rcond=None)[0][0] / size[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1-10", help="first-last")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="sessions at a time")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    options = parser.parse_args()
    found = list(carried_out_by(one, seeds_in(options.seeds), options.jobs, line_of))
    if options.json:
        json.dump([asdict(outcome) for outcome in found], sys.stdout, indent=2)
    else:
        show(found)


def line_of(outcome: Outcome) -> str:
    """The session in a line."""
    if outcome.error or outcome.others is None:
        return f"seed {outcome.seed}: {outcome.error}"
    others = ", ".join(f"{name} {value:.1%}" for name, value in outcome.others.items())
    return (
        f"seed {outcome.seed}: {outcome.off_relative:.2%} off (half interval {outcome.half_relative:.2%}, "
        f"{outcome.held:.0%} held, resolved to {1e3 * outcome.resolution_s:.0f} ms); {others}"
    )


def show(found: Sequence[Outcome]) -> None:
    """Medians, and from least to greatest."""
    told = [outcome for outcome in found if not outcome.error]
    print(f"{len(told)} of {len(found)} sessions; rms error of the stiffness along the path, of its mean:")
    if not told:
        return
    columns = {"splines": [outcome.off_relative for outcome in told]}
    for name in PIECES_S:
        columns[name] = [(outcome.others or {})[name] for outcome in told]
    for name, values in columns.items():
        print(f"    {name:18} {np.median(values):7.2%} ({np.min(values):.2%} to {np.max(values):.2%})")
    held = [outcome.held for outcome in told]
    print(f"inside the 95 % interval: {np.mean(held):.1%} of all instants ({np.min(held):.0%} to {np.max(held):.0%})")


if __name__ == "__main__":
    main()
