"""Logs of a motor behind a torque sensor as laboratories have them: coarse encoders, slow rates, delays, little load.

Every machine is simulated by this file alone, in steps of 20 µs with friction that stops and holds the shaft (Moreau's
time stepping). Inertia, damping, friction and the load's gravity are drawn over a factor of ten, the torque gain of
four; the rate is 100 to 1000 Hz, the encoder has 2^12, 2^14 or 2^17 counts; the command is held for a sample; command
and torque are up to 4 and 10 ms late, or in time; stamps are even or not. The map says nothing but the columns.

Printed are the share of 95 % intervals of valid values that hold the truth, in all and by value, and the rms error in
deviations. ``python benchmarks/coarse_logs.py [--seeds 381-440] [--json]``; a log takes 2 to 10 s. Development used
seeds from 1 to 144 and 321 to 380.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from log_figures import Judged, errors_of, fit_of, report, within
from numba import njit

from norton_bench.arrays import FloatArray
from norton_bench.models.parameters import Status

MAP = """
[log]
motion = "rotation"
[columns]
time = { name = "t", unit = "s" }
position = { name = "q", unit = "rad" }
command = { name = "i", unit = "A" }
exertion = { name = "tau", unit = "N*m" }
"""
STEP_S, DURATION_S = 2e-5, 30.0
RATES_HZ, BITS, JITTERS = (100, 200, 500, 1000), (12, 14, 17), (0.0, 0.2)
GOAL_HZ, GOAL_RAD = np.array([0.13, 0.37, 0.9, 2.1]), np.array([0.8, 0.4, 0.2, 0.08])


@njit
def _motion(
    goal: FloatArray, every: int, inertia: float, damping: float, coulomb: float, offset: float, gain: float,
    gravity: float, proportional: float, derivative: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Position, current and load's torque at every step; the current is held for ``every`` steps."""
    position, current, load = np.empty(goal.size), np.empty(goal.size), np.empty(goal.size)
    q, v, held = 0.0, 0.0, 0.0
    stop = STEP_S * coulomb / inertia / (1 + STEP_S * damping / inertia)
    for k in range(goal.size):
        if k % every == 0:
            held = proportional * (goal[k] - q) - derivative * v
        pull = gravity * np.sin(q)
        free = (v + STEP_S * (gain * held - pull - offset) / inertia) / (1 + STEP_S * damping / inertia)
        v = np.sign(free) * max(abs(free) - stop, 0.0)
        q += STEP_S * v
        position[k], current[k], load[k] = q, held, pull
    return position, current, load


@dataclass(frozen=True)
class Machine:
    """``truth`` by the names of the fit, in SI; ``columns`` is its log, (n,) each."""

    rate_hz: int
    counts: int
    truth: Mapping[str, float]
    columns: Mapping[str, FloatArray]

    @classmethod
    def of(cls, seed: int) -> "Machine":
        rng = np.random.default_rng(seed)

        def spread(low: float, high: float) -> float:
            return float(np.exp(rng.uniform(np.log(low), np.log(high))))

        rate_hz, counts, jitter = int(rng.choice(RATES_HZ)), 2 ** int(rng.choice(BITS)), float(rng.choice(JITTERS))
        inertia, damping, coulomb = 0.08 * spread(0.3, 3), 0.12 * spread(0.3, 3), 0.25 * spread(0.3, 3)
        gain, offset, gravity = 0.8 * spread(0.5, 2), float(rng.uniform(-0.1, 0.1)), spread(0.3, 3)
        late_s = [0.0 if rng.random() < 0.3 else float(rng.uniform(0.0, most)) for most in (0.004, 0.010)]
        bandwidth, faster, larger = spread(6, 20), spread(0.7, 1.5), spread(0.5, 1.5)
        time_s = np.arange(round(DURATION_S / STEP_S)) * STEP_S
        phase = rng.uniform(0, 2 * np.pi, GOAL_HZ.size)
        goal = larger * GOAL_RAD @ np.sin(2 * np.pi * faster * np.outer(GOAL_HZ, time_s) + phase[:, None])
        loop = inertia * bandwidth / gain
        motion = _motion(
            goal, round(1 / rate_hz / STEP_S), inertia, damping, coulomb, offset, gain, gravity, 3 * loop * bandwidth,
            2 * loop,
        )  # fmt: skip
        count = int((DURATION_S - 0.1) * rate_hz)
        at = 0.05 + (np.arange(count) + rng.uniform(0.25, 0.75) + jitter * rng.uniform(-1, 1, count)) / rate_hz
        position, load = (np.interp(at - late, time_s, motion[k]) for k, late in ((0, 0.0), (2, late_s[1])))
        current = motion[1][((at - late_s[0]) / STEP_S).astype(int)]
        turn = 2 * np.pi / counts
        columns = {
            "t": at,
            "q": np.round(position / turn) * turn,
            "i": current + 0.005 * np.std(current) * rng.standard_normal(count),
            "tau": load + spread(0.002, 0.02) * np.std(load) * rng.standard_normal(count),
        }
        # When within a sample the command was held is drawn, too: its delay is not counted.
        truth = {"torque_gain": gain, "inertia": inertia, "viscous_damping": damping, "coulomb_torque": coulomb}
        return cls(rate_hz, counts, truth | {"offset": offset, "exertion_shift": -late_s[1]}, columns)


def judged(seed: int) -> Judged:
    """One machine: what was chosen, and each valid value's error in deviations."""
    machine = Machine.of(seed)
    fit = fit_of(machine.columns, MAP, digits=8)
    errors = errors_of(fit, machine.truth, (Status.VALID,))
    return {"seed": seed, "rate_hz": machine.rate_hz, "counts": machine.counts, "model": fit.model, "errors": errors}


def coverage_of_each(every: Sequence[Judged]) -> Mapping[str, object]:
    """The share of intervals that hold the truth, for each value."""
    names = dict.fromkeys(name for one in every for name in one["errors"])
    of = {name: [one["errors"][name] for one in every if name in one["errors"]] for name in names}
    return {"coverage_of": {name: within(errors) for name, errors in of.items()}}


if __name__ == "__main__":
    report(
        __doc__,
        "381-440",
        judged,
        lambda one: f"{one['rate_hz']} Hz, {one['counts']} counts: {one['model']}",
        coverage_of_each,
    )
