"""How near the truth a whole identification comes: the standard session on the simulated bench, seed by seed.

Every seed runs ``rigs/sim-odrive.toml`` as it is and, with ``--vary``, with every true value of actuator and load
multiplied by its own factor, drawn log-uniformly between 1/2 and 2. The bench is not told; only this program looks at
the truth, afterwards. Run with ``python benchmarks/identification.py [--rig RIG] [--seeds 1-20] [--vary] [--json]``;
a seed takes about 15 s.
"""

import argparse
import json
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bench.models.parameters import Status
from bench.rig.load import parse_rig
from bench.rig.rig import Rig
from bench.session.engine import run_session
from bench.session.schema import standard_session
from sim_backend.tools import true_parameters

RIG = Path(__file__).parents[1] / "rigs" / "sim-odrive.toml"
# What the project promises of each, relative.
PROMISED = {
    "torque_gain": 0.03,
    "amplifier_bandwidth": 0.15,
    "inertia": 0.03,
    "viscous_damping": 0.03,
    "coulomb_torque": 0.03,
    "presliding_stiffness": 0.03,
    "presliding_damping": 0.15,
}
VARIED = re.compile(
    r"""^(?P<key>amplifier_gain|amplifier_bandwidth|torque_constant|torque_gain|inertia|viscous_damping|coulomb_torque
    |presliding_stiffness|presliding_damping)(?P<is>\s*=\s*")(?P<value>[0-9.e+-]+)""",
    re.VERBOSE,
)


@dataclass(frozen=True)
class Outcome:
    """One parameter of one seed: its error and its deviation, both relative to the true value."""

    seed: int
    parameter: str
    error: float
    std: float
    valid: bool


def outcomes(rig: Rig, seed: int) -> Iterator[Outcome]:
    """Identify, then compare."""
    with TemporaryDirectory() as folder:
        result = run_session(rig, standard_session(rig), out=Path(folder), seed=seed)
    fit = result.conclusion.fit
    assert fit is not None
    truth = true_parameters(rig.simulated, seed=seed, place=rig.place, command_unit=rig.command.unit)
    for name in PROMISED:
        estimate, true = fit.estimate(name), truth[name][0]
        yield Outcome(
            seed, name, estimate.value / true - 1.0, estimate.std / abs(true), estimate.status is Status.VALID
        )


def varied(text: str, seed: int) -> str:
    """The rig file with every true value of the machines multiplied by a factor of its own."""
    rng = np.random.default_rng(seed)
    head, mark, truth = text.partition("[simulated]")
    lines = []
    for line in truth.splitlines():
        factor = 2.0 ** rng.uniform(-1.0, 1.0)
        lines.append(VARIED.sub(lambda m, f=factor: f"{m['key']}{m['is']}{float(m['value']) * f:.6g}", line))
    return head + mark + "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rig", type=Path, default=RIG)
    parser.add_argument("--seeds", default="1-20", help="first-last")
    parser.add_argument("--vary", action="store_true", help="another true actuator and load for every seed")
    parser.add_argument("--json", action="store_true", help="data only, on stdout")
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    text = options.rig.read_text(encoding="utf-8")
    found: list[Outcome] = []
    for seed in range(int(first), int(last or first) + 1):
        rig = parse_rig(varied(text, seed) if options.vary else text, place=str(options.rig))
        found += outcomes(rig, seed)
        print(f"seed {seed}: {seed_line(found[-len(PROMISED) :])}", file=sys.stderr, flush=True)
    if options.json:
        json.dump([vars(outcome) for outcome in found], sys.stdout, indent=2)
    else:
        show(found)


def seed_line(outcomes_of_seed: list[Outcome]) -> str:
    """Errors in per cent, in the order of PROMISED."""
    return " ".join(f"{100 * outcome.error:+.2f}" for outcome in outcomes_of_seed)


def show(found: list[Outcome]) -> None:
    """One line a parameter, then the coverage."""
    print(f"{'parameter':22}{'mean error':>11}{'rms':>8}{'greatest':>10}{'promised':>10}{'std':>8}{'within 3 std':>14}")
    for name, promised in PROMISED.items():
        rows = [outcome for outcome in found if outcome.parameter == name]
        errors, stds = np.array([row.error for row in rows]), np.array([row.std for row in rows])
        inside = int(np.sum(np.abs(errors) <= 3 * stds))
        print(
            f"{name:22}{np.mean(errors):>+11.2%}{np.sqrt(np.mean(errors**2)):>8.2%}{np.max(np.abs(errors)):>10.2%}"
            f"{promised:>10.0%}{np.median(stds):>8.2%}{inside:>8d} / {len(rows)}"
        )
    inside = sum(abs(outcome.error) <= 3 * outcome.std for outcome in found)
    print(f"{inside} of {len(found)} estimates within 3 std; {sum(outcome.valid for outcome in found)} called valid")


if __name__ == "__main__":
    main()
