"""What simulating the plant costs: per substep, per millisecond of bench time, and against scipy's LSODA.

Both integrate the rig's motor alone, in the same run, under the same command, so that the ratio holds whatever the
machine. Run with ``python benchmarks/simulation_speed.py``.
"""

import math
import statistics
import time
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from norton_bench.models.parameters import DahlMotor
from norton_sim.integrator import ENCODER_PERIOD_NS
from norton_sim.packing import pack
from norton_sim.plant import Plant
from norton_sim.truth import Truth, read_truth

RIG = Path(__file__).parents[1] / "rigs" / "sim-odrive.toml"
TICK_NS = 1_000_000
TICKS = 4000
LSODA_TICKS = 200
ROUNDS = 5


def command(tick: int) -> float:
    """Two tones that make the motor reverse."""
    return 0.15 * math.sin(0.02 * tick) + 0.08 * math.sin(0.11 * tick)


def run_plant(truth: Truth, calls_per_tick: int) -> None:
    plant = Plant(truth, 0)
    for tick in range(TICKS):
        plant.command("actuator", command(tick))
        for call in range(1, calls_per_tick + 1):
            plant.advance(tick * TICK_NS + call * TICK_NS // calls_per_tick)


def run_lsoda(motor: DahlMotor) -> None:
    state = np.zeros(3)
    for tick in range(LSODA_TICKS):
        rates = partial(motor_rates, motor, command(tick))
        state = solve_ivp(rates, (0.0, TICK_NS * 1e-9), state, method="LSODA", rtol=1e-6, atol=1e-9).y[:, -1]


def motor_rates(motor: DahlMotor, e_c: float, _time: float, state: NDArray[np.float64]) -> list[float]:
    i, omega, phi = state.tolist()
    return [motor.current_rate(i, e_c), motor.acceleration(i, omega, phi, 0.0), motor.dahl_rate(omega, phi)]


def us_per_tick(work: Callable[[], None], ticks: int) -> float:
    """Median cost of a millisecond of bench time [µs]."""
    costs = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        work()
        costs.append((time.perf_counter() - start) * 1e6 / ticks)
    return statistics.median(costs)


def main() -> None:
    truth = read_truth(tomllib.loads(RIG.read_text())["simulated"], seed=None, place=str(RIG))
    alone = truth.model_copy(update={"load": None})
    Plant(truth, 0).advance(TICK_NS)  # compile first
    substeps = TICK_NS // ENCODER_PERIOD_NS * math.ceil(ENCODER_PERIOD_NS * 1e-9 / pack(truth, "free").substep_s)
    pair = us_per_tick(lambda: run_plant(truth, 1), TICKS)
    quarters = us_per_tick(lambda: run_plant(truth, 4), TICKS)
    free = us_per_tick(lambda: run_plant(alone, 1), TICKS)
    lsoda = us_per_tick(lambda: run_lsoda(alone.actuator.motor), LSODA_TICKS)
    print(f"actuator, sensor and load   {pair:8.1f} µs per ms of bench time ({1000 / pair:.0f} x real time)")
    print(f"  a substep, calls included {pair * 1000 / substeps:8.0f} ns, {substeps} to the millisecond")
    print(f"  in four calls a ms        {quarters:8.1f} µs per ms")
    print(f"motor alone                 {free:8.1f} µs per ms")
    print(f"motor alone, scipy LSODA    {lsoda:8.1f} µs per ms ({lsoda / free:.0f} x the plant's)")


if __name__ == "__main__":
    main()
