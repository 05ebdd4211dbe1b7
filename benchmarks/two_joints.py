"""How right the matrices of an arm of two joints are, and how wrong its equilibrium path is without them.

Every seed is an arm of its own: limbs, posture, stiffness, damping, cross terms, sensors, loads and delays are drawn
(``drawn``), and measured through frames and bytes as ``norton-bench joints`` does it. Then

- every entry of M, B and K is compared with the truth about where the joints stood;
- the motion source is compared with the true free motion, the same arm simulated without loads;
- the equilibrium path, where the muscles pull the arm to at each instant (for the simulated arm a reach of least jerk),
  is estimated from the same free motion in three ways: with all of the impedance, without its damping, and from the
  angles alone, as if the arm were where it is pulled to. What is not known of the impedance becomes error of the path
  (paper, section VI.E; Gomi and Kawato, Science 272, 1996).

    python benchmarks/two_joints.py [--seeds 21-40] [--json] [--jobs 2]

A seed takes some 70 s of one core. Seeds 1 to 20 were used in development.
"""

import argparse
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from several import carried_out_by, seeds_in
from wide_family import changed

from norton_bench.errors import BenchError
from norton_bench.identification.at_ticks import in_band
from norton_bench.joints.arm import JOINTS, Arm, load_arm
from norton_bench.joints.impedance import MATRICES, JointImpedance
from norton_bench.joints.run import ArmResult, run_arm
from norton_bench.procedures.waves import displaced
from norton_drivers.errors import DeviceError
from norton_sim.joined import open_two_joints, true_joints
from norton_sim.plants.two_joints import TwoJointsTruth

SHIPPED = Path(__file__).parents[1] / "rigs" / "two-joints"
MS = 1_000_000
# What is estimated of a path below this; above, noise of the second derivative drowns it.
PATH_HZ = 8.0


@dataclass(frozen=True)
class Measured:
    """``errors`` of the twelve entries in deviations, ``relative`` those of the four of K; path errors are rms, as a
    share of the rms of the true path, of the worse joint."""

    seed: int
    why_not: str = ""
    errors: tuple[float, ...] = ()
    relative: tuple[float, ...] = ()
    misfit: float = float("nan")
    source: float = float("nan")
    with_impedance: float = float("nan")
    without_damping: float = float("nan")
    angles_alone: float = float("nan")


# What is drawn of each joint's rig: shares of what stands in its file, and numbers in the file's own unit.
SHARES = {
    ("simulated.actuator", "stiffness"): (0.4, 2.0),
    ("simulated.actuator", "damping"): (0.5, 2.0),
    ("simulated.load", "inertia"): (0.5, 2.0),
    ("simulated.load", "coulomb_torque"): (0.3, 2.0),
    ("simulated.torque_sensor", "stiffness"): (0.4, 2.0),
    ("simulated.torque_sensor", "noise"): (0.2, 2.5),
}
NUMBERS = {
    ("simulated.actuator", "movement"): (400.0, 900.0),
    ("simulated.actuator", "moving_stiffness"): (0.0, 8.0),
    ("simulated.load", "torque_gain"): (0.8, 1.2),
    ("simulated.torque_sensor", "bias"): (-0.3, 0.3),
    ("simulated.transport", "can_delay"): (100.0, 600.0),
    ("simulated.transport", "serial_delay"): (200.0, 1000.0),
}
COUNTS_BITS = 16, 20
COUNTED = ("actuator", "load", "simulated.actuator", "simulated.load")
# And of the arm.
ELBOW_RAD = 0.6, 2.2
SIZE, MASS = (0.8, 1.25), (0.7, 1.5)
CROSS_STIFFNESS, CROSS_DAMPING = (-3.0, 9.0), (-0.2, 0.35)


def drawn(seed: int, folder: Path) -> Path:
    """The three files of an arm, in ``folder``; returns that of the arm itself."""
    random = np.random.default_rng([seed, 21])

    def number(low: float, high: float) -> float:
        return float(random.uniform(low, high))

    def share(low: float, high: float) -> float:
        return float(low * (high / low) ** random.uniform())

    for joint in JOINTS:
        text = (SHIPPED / f"{joint}.toml").read_text(encoding="utf-8")
        for (section, key), bounds in SHARES.items():
            text = _set(text, section, key, share(*bounds), relative=True)
        for (section, key), bounds in NUMBERS.items():
            text = _set(text, section, key, number(*bounds))
        counts = 2.0 ** random.integers(COUNTS_BITS[0], COUNTS_BITS[1] + 1)
        for section in COUNTED:
            text = _set(text, section, "counts_per_turn", counts)
        (folder / f"{joint}.toml").write_text(text, encoding="utf-8")
    text = (SHIPPED / "arm.toml").read_text(encoding="utf-8")
    size, mass, elbow_rad = share(*SIZE), share(*MASS), number(*ELBOW_RAD)
    for key, factor in {
        **dict.fromkeys(("upper_mass", "lower_mass"), mass),
        **dict.fromkeys(("upper_length", "upper_centre", "lower_centre"), size),
        **dict.fromkeys(("upper_inertia", "lower_inertia"), mass * size**2),
    }.items():
        text = _set(text, "simulated", key, factor, relative=True)
    for section in ("simulated", "links"):
        text = _set(text, section, "elbow", elbow_rad)
    for key in ("shoulder_by_elbow", "elbow_by_shoulder"):
        text = _set(text, "simulated", key, number(*CROSS_STIFFNESS))
        text = _set(text, "simulated", f"{key}_damping", number(*CROSS_DAMPING))
    path = folder / "arm.toml"
    path.write_text(text, encoding="utf-8")
    return path


def _set(text: str, section: str, key: str, number: float, *, relative: bool = False) -> str:
    return changed(text, section, key, lambda value: f"{value * number if relative else number:.8g}")


def measured(seed: int) -> Measured:
    with TemporaryDirectory() as name:
        folder = Path(name)
        arm = load_arm(drawn(seed, folder))
        try:
            result = run_arm(arm, folder, seed=seed)
        except (BenchError, DeviceError) as error:
            return Measured(seed, str(error))
        return judged(seed, arm, result)


def judged(seed: int, arm: Arm, result: ArmResult) -> Measured:
    true = true_joints(arm.benches, arm.simulated, place=arm.place)
    impedance = result.impedance
    links = TwoJointsTruth.model_validate(dict(arm.simulated))
    true["inertia"] = true["inertia"] + links.inertia_kg_m2(impedance.place_rad[1]) - links.inertia_kg_m2(0.0)
    deviations = np.sqrt(np.diag(impedance.covariance)).reshape(3, 2, 2)
    errors = [(impedance.matrices[name] - true[name]) / deviations[place] for place, name in enumerate(MATRICES)]
    relative = (impedance.stiffness - true["stiffness"]) / true["stiffness"]
    free, equilibrium = true_paths(arm, len(result.source.time_s), result.source.time_s[0])
    path, tick_s = result.source.angle_rad, arm.tick_s

    angle, velocity, acceleration = (derivative(path, order, tick_s) for order in range(3))
    pull = acceleration @ impedance.inertia.T + angle @ impedance.stiffness.T
    alone = pull @ np.linalg.inv(impedance.stiffness).T
    return Measured(
        seed,
        errors=tuple(np.concatenate([each.ravel() for each in errors]).tolist()),
        relative=tuple(relative.ravel().tolist()),
        misfit=impedance.misfit,
        source=off(path, free),
        with_impedance=off(lagged(pull + velocity @ impedance.damping.T, impedance, tick_s), equilibrium),
        without_damping=off(alone, equilibrium),
        angles_alone=off(angle, equilibrium),
    )


def derivative(path: np.ndarray, order: int, tick_s: float) -> np.ndarray:
    """Of a path (ticks, 2) from rest to rest, below PATH_HZ; a smooth step takes its ends off, and is put back."""
    step = displaced(1.0, len(path) * tick_s, tick_s)
    steps = step.position_rad, step.velocity_rad_s, step.acceleration_rad_s2
    end = path[-1] - path[0]
    rest = path - path[0] - steps[0][:, None] * end
    inside = np.stack([in_band(rest[:, joint], tick_s, PATH_HZ, order) for joint in range(2)], axis=1)
    return inside + steps[order][:, None] * end + (path[0] if order == 0 else 0.0)


def lagged(pull: np.ndarray, impedance: JointImpedance, tick_s: float) -> np.ndarray:
    """x of B dx/dt + K x = pull, from rest."""
    x, rows = np.zeros(2), []
    step = np.linalg.inv(impedance.damping / tick_s + impedance.stiffness)
    for each in pull:
        x = step @ (each + impedance.damping @ x / tick_s)
        rows.append(x)
    return np.array(rows)


def true_paths(arm: Arm, ticks: int, start_s: float) -> tuple[np.ndarray, np.ndarray]:
    """The free motion of the arm without its loads, and the path that its muscles pull it along; (ticks, 2)."""
    backends = open_two_joints(arm.benches, arm.simulated, seed=None, place=arm.place)
    plants = [backend.world.plant for backend in backends]
    for plant in plants:
        plant.uncouple()
    free, pulled = [], []
    for tick in range(ticks):
        if tick == round(-start_s / arm.tick_s):
            for plant, command in zip(plants, arm.reach.commands, strict=True):
                plant.command("actuator", command)
        backends[0].world.advance((tick + 1) * MS)
        free.append([plant.true_position_rad("actuator") for plant in plants])
        pulled.append([float(plant.mechanics.state[2, 0]) for plant in plants])
    return np.array(free), np.array(pulled)


def off(path: np.ndarray, true: np.ndarray) -> float:
    """rms error over rms, of the worse joint."""
    return float(np.max(np.sqrt(np.mean((path - true) ** 2, axis=0) / np.mean(true**2, axis=0))))


def report(results: list[Measured]) -> dict[str, object]:
    done = [each for each in results if not each.why_not]
    errors = np.array([each.errors for each in done])
    relative = np.abs([each.relative for each in done])
    spread = {
        name: [float(value) for value in np.percentile([getattr(each, name) for each in done], (0, 50, 100))]
        for name in ("misfit", "source", "with_impedance", "without_damping", "angles_alone")
    }
    return {
        "arms": len(results),
        "carried_out": len(done),
        "coverage": float(np.mean(np.abs(errors) <= 1.96)),
        "coverage_by_matrix": {
            name: float(np.mean(np.abs(errors[:, 4 * k : 4 * k + 4]) <= 1.96)) for k, name in enumerate(MATRICES)
        },
        "rms_over_deviation": float(np.sqrt(np.mean(errors**2))),
        "greatest": float(np.max(np.abs(errors))),
        "stiffness_off": [float(value) for value in np.percentile(relative, (50, 95, 100))],
        "stiffness_within_3_percent": float(np.mean(relative <= 0.03)),
        "least_median_greatest": spread,
        "refused": {str(each.seed): each.why_not for each in results if each.why_not},
        "each": [asdict(each) for each in results],
    }


def line(each: Measured) -> str:
    """Of progress."""
    if each.why_not:
        return f"{each.seed:4d} {each.why_not}"
    errors = " ".join(f"{error:+.1f}" for error in each.errors)
    paths = f"{each.source:.1%} {each.with_impedance:.1%} {each.without_damping:.1%} {each.angles_alone:.1%}"
    return f"{each.seed:4d} {errors}  misfit {each.misfit:.2f}  paths {paths}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="21-40")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    summary = report(list(carried_out_by(measured, seeds_in(arguments.seeds), arguments.jobs, line)))
    if arguments.json:
        print(json.dumps(summary, indent=2))
        return
    for name, value in summary.items():
        if name != "each":
            print(f"{name}: {value}")


if __name__ == "__main__":
    main()
