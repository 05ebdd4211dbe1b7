"""Every family of drives and sensors that is shipped, identified through its frames and bytes, against the truth.

A pairing is an actuator's drive, a load's drive (or none) and a torque sensor (or none): that of a shipped rig, some of
them with the sensor of another. Every seed is one standard session on such a bench, whose inertia, damping and friction
are drawn, each up to twice as great or as small as in the rig file. Every number with status ``valid`` is compared with
the truth: coverage of the 95 % intervals, and rms error over the stated deviation.

    python benchmarks/pairings.py [--seeds 11-12] [--only NAME] [--json] [--jobs 2]

A session takes about half a minute of processor time. Seeds from 1001 on are for development.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import verdicts
from several import carried_out_by, seeds_in
from wide_family import RIGS, WITHIN, changed, with_sensor

from norton_bench.errors import BenchError
from norton_bench.models.parameters import Status
from norton_bench.result import Result
from norton_bench.rig.load import parse_rig
from norton_bench.rig.rig import Rig
from norton_bench.session.engine import run_session
from norton_bench.session.schema import standard_session
from norton_drivers.errors import DeviceError
from norton_sim.truth import read_truth, true_parameters

# The rig, and the torque sensor where it is not its own.
PAIRINGS = (
    ("sim-odrive", ""),
    ("sim-odrive", "dbc"),
    ("sim-odrive", "dyn200"),
    ("sim-cia402", ""),
    ("sim-vesc", ""),
    ("sim-vesc", "dyn200"),
    ("sim-mit", ""),
    ("sim-mit", "dbc"),
    ("sim-odrive-uart", ""),
    ("sim-vesc-uart", ""),
    ("sim-simplefoc", ""),
    ("sim-moteus", ""),
    ("sim-moteus", "dyn200"),
    ("sim-moteus-fdcanusb", ""),
    ("sim-damiao", ""),
    ("sim-damiao", "dbc"),
    ("sim-robstride", ""),
    ("sim-robstride", "dyn200"),
    ("sim-cubemars", ""),
    ("sim-dynamixel", ""),
    ("sim-dynamixel-alone", ""),
    ("sim-dynamixel-servo", ""),
    ("sim-feetech", ""),
    ("sim-servo", ""),
    ("sim-mit-velocity", ""),
)
DRAWN = ("inertia", "viscous_damping", "coulomb_torque", "presliding_stiffness", "presliding_damping")
WIDEST = 2.0
SEEDS = "11-12"


@dataclass(frozen=True)
class Value:
    """One stated value, in its own unit."""

    name: str
    value: float
    std: float
    truth: float
    status: str

    @property
    def deviations(self) -> float:
        return (self.value - self.truth) / self.std


@dataclass(frozen=True)
class Outcome:
    """One session: its values, or why there are none."""

    pairing: str
    seed: int
    values: tuple[Value, ...] = ()
    refusal: str = ""

    @property
    def valid(self) -> tuple[Value, ...]:
        return tuple(each for each in self.values if each.status == Status.VALID.value)


def named(pairing: tuple[str, str]) -> str:
    rig, sensor = pairing
    return f"{rig} {sensor}".strip()


def drawn(pairing: tuple[str, str], seed: int) -> str:
    """The rig file of one bench."""
    stem, sensor = pairing
    rng = np.random.default_rng([seed, 20261])
    text = (RIGS / f"{stem}.toml").read_text(encoding="utf-8")
    if sensor:
        text = with_sensor(text, sensor)
    for key in DRAWN:
        factor = float(WIDEST ** rng.uniform(-1.0, 1.0))
        text = changed(text, "simulated.actuator", key, lambda value, factor=factor: f"{value * factor:.6g}")
    return text


def session(task: tuple[tuple[str, str], int]) -> Outcome:
    """As ``identify`` performs it."""
    pairing, seed = task
    name = named(pairing)
    rig = replace(parse_rig(drawn(pairing, seed), place=str(RIGS / f"pairing-{seed}.toml")), candump=False)
    with TemporaryDirectory() as folder:
        try:
            result = run_session(rig, standard_session(rig), out=Path(folder), seed=seed, live=False)
        except (BenchError, DeviceError) as error:
            return Outcome(name, seed, refusal=str(error))
        except Exception as error:  # a defect of the tool: it counts as a refusal without a cause, and the others go on
            return Outcome(name, seed, refusal=f"failed unexpectedly: {error!r}")
    return Outcome(name, seed, values_of(result, rig, seed))


def values_of(result: Result, rig: Rig, seed: int) -> tuple[Value, ...]:
    """Every estimate beside the truth."""
    truth = read_truth(rig.simulated, seed=seed, place=rig.place, command_unit=rig.command.unit)
    true = true_parameters(truth, rig.command.unit)
    return tuple(
        Value(each.name, each.value, each.std, true[each.name][0], each.status.value)
        for each in (result.fit.estimates if result.fit is not None else ())
        if each.name in true
    )


def progress_line(outcome: Outcome) -> str:
    """Errors in deviations; in brackets what is not called valid."""
    head = f"{outcome.pairing:26}{outcome.seed:5}  "
    if outcome.refusal:
        return head + outcome.refusal
    return head + " ".join(
        f"{each.deviations:+.2f}" if each in outcome.valid else f"[{each.status}]" for each in outcome.values
    )


def show(outcomes: Sequence[Outcome]) -> None:
    """One line a pairing, and one for all."""
    done = [each for each in outcomes if not each.refusal]
    print(f"{len(done)} of {len(outcomes)} sessions carried out")
    print(f"{'':26}{'values':>8}{'valid':>7}{'in 95 %':>9}{'rms/std':>9}")
    for name in dict.fromkeys(each.pairing for each in outcomes):
        line(name, [each for each in done if each.pairing == name])
    line("all", done)


def line(name: str, outcomes: Sequence[Outcome]) -> None:
    stated = sum(len(each.values) for each in outcomes)
    deviations = np.array([value.deviations for each in outcomes for value in each.valid])
    if not deviations.size:
        print(f"{name:26}{stated:8}{0:7}")
        return
    held = verdicts.share(np.abs(deviations) <= WITHIN)
    print(
        f"{name:26}{stated:8}{deviations.size:7}{held.value:9.1%}{np.sqrt(np.mean(deviations**2)):9.2f}"
        f"  ({held.interval[0]:.0%} to {held.interval[1]:.0%})"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default=SEEDS, help="first-last")
    parser.add_argument("--only", default="", help="pairings whose name has this in it")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="sessions at a time")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    options = parser.parse_args()
    seeds = seeds_in(options.seeds)
    chosen = [each for each in PAIRINGS if options.only in named(each)]
    tasks = [(pairing, seed) for seed in seeds for pairing in chosen]
    outcomes = list(carried_out_by(session, tasks, options.jobs, progress_line))
    if options.json:
        json.dump([asdict(outcome) for outcome in outcomes], sys.stdout, indent=2)
    else:
        show(outcomes)


if __name__ == "__main__":
    main()
