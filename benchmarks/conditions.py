"""How often the paper's three conditions are judged rightly (IV.B, VI), through the real loop on simulated benches.

Each session is the standard one of its rig. All three conditions are true of a motor, a muscle, springs, an arm that
hangs and one that reaches. Of gears with play the second is not: their torque vanishes over a range. Printed for each
rig and condition: how many sessions judge it rightly, leave it open, and judge it wrongly.

    python benchmarks/conditions.py [--seeds 21-40] [--rigs NAMES] [--json] [--jobs 2]

A session takes 15 to 60 s. Development used seeds up to 20.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

from several import carried_out_by, seeds_in
from wide_family import RIGS

from norton_bench.errors import ExperimentError, SafetyStopError
from norton_bench.rig.load import load_rig
from norton_bench.session.conclusion import conclude_recording
from norton_bench.session.engine import record_session
from norton_bench.session.schema import standard_session

CONDITIONS = ("impedance form", "unique zero", "stable zero dynamics")
GEARS = "sim-gear-train"
NAMES = (
    "sim-odrive",
    "sim-gravity",
    "sim-pneumatic",
    "sim-series-elastic",
    "sim-variable-stiffness",
    GEARS,
    "sim-arm",
)
UNTRUE = {(GEARS, "unique zero")}


@dataclass(frozen=True)
class Outcome:
    """One session: whether each condition is said to hold, None where it is left open; ``error`` says why there is
    none."""

    rig: str
    seed: int
    holds: dict[str, bool | None]
    error: str = ""


def one(task: tuple[str, int]) -> Outcome:
    """The session of a rig and a seed; one that fails leaves its reason."""
    name, seed = task
    rig = replace(load_rig(RIGS / f"{name}.toml"), candump=False)
    with TemporaryDirectory() as folder:
        try:
            recorded = record_session(rig, standard_session(rig), out=Path(folder), seed=seed, live=False)
            result = conclude_recording(recorded.recording, Path(folder))
        except (ExperimentError, SafetyStopError) as error:
            return Outcome(name, seed, {}, str(error))
    return Outcome(name, seed, {each.condition: each.holds for each in result.conditions})


def judged(outcome: Outcome, condition: str) -> str:
    """Rightly, wrongly, or left open."""
    holds = outcome.holds.get(condition)
    if holds is None:
        return "open"
    return "right" if holds is ((outcome.rig, condition) not in UNTRUE) else "wrong"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="21-40", help="first-last")
    parser.add_argument("--rigs", nargs="+", default=list(NAMES), choices=list(NAMES))
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
    said = ", ".join(f"{condition} {judged(outcome, condition)}" for condition in CONDITIONS)
    return f"{outcome.rig}, seed {outcome.seed}: {outcome.error or said}"


def show(found: Sequence[Outcome]) -> None:
    """Counts for each rig and condition."""
    print(f"{'':26}{'':22}{'right':>7}{'open':>7}{'wrong':>7}")
    for name, condition in product(dict.fromkeys(outcome.rig for outcome in found), CONDITIONS):
        verdicts = [judged(each, condition) for each in found if each.rig == name and not each.error]
        counts = "".join(f"{verdicts.count(verdict):7}" for verdict in ("right", "open", "wrong"))
        print(f"{name:26}{condition:22}{counts}")
    print(f"{sum(bool(outcome.error) for outcome in found)} of {len(found)} sessions were not carried out")


if __name__ == "__main__":
    main()
