"""Logs of machines that nobody here built, with known truth: are the intervals honest, and the terms the right ones?

Every machine is a differential equation of this file, solved by scipy's Radau and by nothing of the project's: a motor
on a current in a loop of its own, with a pendulum behind a torque sensor. Its log has uneven stamps, quantised
position, noise, a command and a torque that are late by times of their own, and a temperature that thins the oil.
Friction is plain, or has stiction that falls with speed, a film that thins, or a share of what the gears transmit.

Printed are, over all machines: the share of 95 % intervals that hold the true value, the rms error in deviations, and
how often the chosen model is the true one. ``python benchmarks/logs.py [--seeds 391-430] [--json]``; a log takes about
20 s. Development used seeds 41 to 60, 271 to 310 and 351 to 390.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from log_figures import Judged, errors_of, fit_of, report
from scipy.integrate import solve_ivp

from norton_bench.arrays import FloatArray
from norton_bench.models.parameters import Status

KINDS = ("coulomb-viscous", "stribeck", "film", "load-dependent", "coulomb-viscous-asymmetric")
MAP = """
[log]
motion = "rotation"
[columns]
time = { name = "t", unit = "s" }
position = { name = "q", unit = "rad" }
command = { name = "i", unit = "A" }
exertion = { name = "tau", unit = "N*m" }
temperature = { name = "temp", unit = "degC" }
[model]
temperature = true
"""
# Of the sign of friction: below this speed it turns round smoothly. Readings are 2 ms apart.
TURN_RAD_S = 2e-3
RATE_HZ, DURATION_S = 500.0, 30.0
COUNTS = 2**17


@dataclass(frozen=True)
class Machine:
    """``values`` by the names of the fit, in SI; ``kind`` is the model that they belong to."""

    kind: str
    values: Mapping[str, float]
    gravity: float
    late_s: tuple[float, float]
    seed: int

    @classmethod
    def of(cls, seed: int) -> "Machine":
        rng = np.random.default_rng(seed)
        kind = KINDS[seed % len(KINDS)]
        inertia, damping, coulomb = 0.02 * rng.uniform(0.5, 2), 0.15 * rng.uniform(0.5, 2), 0.4 * rng.uniform(0.5, 2)
        values = {"torque_gain": 1.5 * rng.uniform(0.7, 1.4), "inertia": inertia, "coulomb_torque": coulomb}
        values |= {"viscous_damping": damping, "viscous_damping_per_degree": -0.01 * damping, "offset": 0.1}
        values |= {"coulomb_torque_per_degree": 0.0}
        late_s = (float(rng.uniform(0.0, 0.004)), float(rng.uniform(0.002, 0.010)))
        if kind == "stribeck":
            values |= {"stribeck_torque": 0.6 * coulomb, "stribeck_velocity": float(rng.uniform(0.4, 0.8))}
        if kind == "film":
            values |= {"film_torque": 0.7 * coulomb, "film_velocity": float(rng.uniform(0.5, 1.0))}
        if kind == "load-dependent":
            values |= {"load_coefficient": float(rng.uniform(0.1, 0.25))}
        if kind == "coulomb-viscous-asymmetric":
            del values["viscous_damping"]
            values |= {"viscous_damping_positive": damping, "viscous_damping_negative": 1.6 * damping}
        return cls(kind, values, float(rng.uniform(1.0, 2.0)), late_s, seed)

    def friction(self, velocity: FloatArray, load: FloatArray, warmer: FloatArray) -> FloatArray:
        """Against the motion, N·m."""
        get = self.values.get
        speed, side = np.abs(velocity), np.tanh(velocity / TURN_RAD_S)
        one_way = np.where(velocity > 0, get("viscous_damping_positive", 0.0), get("viscous_damping_negative", 0.0))
        viscous = get("viscous_damping", 0.0) + one_way + self.values["viscous_damping_per_degree"] * warmer
        dry = self.values["coulomb_torque"] + get("load_coefficient", 0.0) * np.abs(load)
        dry = dry + get("stribeck_torque", 0.0) * np.exp(-((speed / get("stribeck_velocity", 1.0)) ** 2))
        dry = dry - get("film_torque", 0.0) * np.expm1(-speed / get("film_velocity", 1.0))
        return np.asarray(viscous * velocity + dry * side)

    def goal(self) -> Callable[[FloatArray], FloatArray]:
        """The set point over time, rad."""
        rng = np.random.default_rng(self.seed + 10_000)
        hertz, phase = np.array([0.17, 0.41, 0.97, 2.3, 4.1]), rng.uniform(0, 2 * np.pi, 5)
        reach = np.array([1.2, 0.7, 0.35, 0.12, 0.05])
        return lambda t: np.asarray(
            np.tensordot(
                reach, np.sin(2 * np.pi * np.multiply.outer(hertz, t) + phase.reshape((5,) + (1,) * np.ndim(t))), 1
            )
        )

    def log(self) -> dict[str, FloatArray]:
        """Columns of the log, (n,)."""
        goal, value = self.goal(), self.values
        mean = float(np.mean(_warmth_c(np.linspace(0, DURATION_S, 10_000))))

        def current(t: FloatArray, q: FloatArray, v: FloatArray) -> FloatArray:
            return np.asarray(18.0 * (goal(t) - q) - 0.7 * v)

        def slope(t: float, state: FloatArray) -> FloatArray:
            q, v = state
            load = self.gravity * np.sin(q)
            push = value["torque_gain"] * current(t, q, v) - load - value["offset"]
            return np.array([v, (push - self.friction(v, load, _warmth_c(t) - mean)) / value["inertia"]])

        done = solve_ivp(
            slope, (0.0, DURATION_S), [float(goal(np.array(0.0))), 0.0], "Radau", max_step=5e-3, rtol=1e-7, atol=1e-9,
            dense_output=True,
        )  # fmt: skip
        rng = np.random.default_rng(self.seed + 20_000)
        count = int(RATE_HZ * (DURATION_S - 0.1))
        t = 0.05 + (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / RATE_HZ
        q = done.sol(t)[0]
        early_i, early_tau = (t - late for late in self.late_s)
        turn = 2 * np.pi / COUNTS
        return {
            "t": t,
            "q": np.round(q / turn) * turn,
            "i": current(early_i, *done.sol(early_i)) + 0.01 * rng.standard_normal(count),
            "tau": self.gravity * np.sin(done.sol(early_tau)[0]) + 0.01 * rng.standard_normal(count),
            "temp": 25.0 + _warmth_c(t),
        }

    @property
    def truth(self) -> Mapping[str, float]:
        return {**self.values, "command_shift": -self.late_s[0], "exertion_shift": -self.late_s[1]}


def _warmth_c(time_s: FloatArray) -> FloatArray:
    """Above the temperature at the start."""
    return 10.0 * (1 - np.exp(-time_s / 12.0))


def judged(seed: int) -> Judged:
    """One machine: what was chosen, and each error in deviations."""
    machine = Machine.of(seed)
    fit = fit_of(machine.log(), MAP, digits=10)
    errors = errors_of(fit, machine.truth, (Status.VALID, Status.UNEXCITED))
    return {"seed": seed, "true": machine.kind, "chosen": fit.model, "doubtful": fit.doubtful, "errors": errors}


def right_model(every: Sequence[Judged]) -> Mapping[str, object]:
    """How often the chosen model is the true one."""
    return {"right_model": float(np.mean([one["true"] == one["chosen"] for one in every]))}


if __name__ == "__main__":
    report(__doc__, "391-430", judged, lambda one: f"{one['true']}: {one['chosen']}", right_model)
