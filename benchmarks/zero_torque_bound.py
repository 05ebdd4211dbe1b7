"""What feedback of the torque could reach at best in the zero-torque experiment of ``benchmarks/zero_torque.py``.

The load torque that the free motion needs is computed from the true machines; a controller can know it only as it was
a delay earlier. Printed for two delays: one without noise that repeats what was needed then, and the best linear
predictor from torques with the sensor's noise, fitted by least squares to this very kind of movement (a Wiener
predictor). Neither sees an encoder. What is not predicted stands at the port by the actuator's share of the inertia:
both are taken to slide. Run with ``python benchmarks/zero_torque_bound.py``.
"""

from math import log10

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.models.network import NortonNetwork
from norton_bench.procedures.waves import multisine

ACTUATOR = NortonNetwork(0.9, 600.0, 5e-5, 1e-3, 0.02, 10.0, 0.01, command_unit="N*m")
LOAD = NortonNetwork(0.95, 1000.0, 1.2e-4, 3e-4, 8e-3, 8.0, 0.005, command_unit="N*m")
# Highest frequency [Hz] and amplitude of the command, and what the undriven port sees of it [N m].
COMMANDS = ((3.0, 0.08, 10.8e-3), (10.0, 0.1, 13.7e-3))
DELAYS_S = (1.5e-3, 2.5e-3)
NOISE_NM = 1e-3
TICK_S, FINE, DURATION_S = 1e-3, 2, 8.0
SEEDS = (2, 3, 4, 5)  # the first is the movement that counts
TAPS = 60


def disturbance_nm(highest_hz: float, amplitude: float, seed: int) -> FloatArray:
    """What the port would see if nothing were done, on a grid of FINE instants a tick."""
    wave = multisine(DURATION_S, TICK_S, low_hz=0.2, high_hz=highest_hz, seed=seed, slope=-0.5)
    step_s = TICK_S / FINE
    position, _, _ = ACTUATOR.free_motion(np.repeat(amplitude * wave, FINE), step_s)
    needed = -LOAD.torque(np.zeros(len(position)), position, step_s)
    share = ACTUATOR.inertia_kgm2 / (ACTUATOR.inertia_kgm2 + LOAD.inertia_kgm2)
    return np.asarray(share * needed)


def later(values: FloatArray, instants: int) -> FloatArray:
    return np.concatenate([np.zeros(instants), values])[: len(values)]


def repeated_nm(fine: FloatArray, instants: int) -> float:
    """RMS of what is left by a controller that repeats what was needed."""
    return float(np.sqrt(np.mean((fine - later(fine, instants)) ** 2)))


def predicted_nm(movements: list[FloatArray], instants: int) -> float:
    """RMS of what the best linear predictor leaves of the first movement, from noisy readings."""
    random = np.random.default_rng(0)
    seen = [later(fine, instants)[::FINE] for fine in movements]
    noisy = [each + random.normal(0.0, NOISE_NM, len(each)) for each in seen]
    rows = np.concatenate([np.stack([later(each, tap) for tap in range(TAPS)], axis=1) for each in noisy])
    wanted = np.concatenate([fine[::FINE] for fine in movements])
    left = wanted - rows @ np.linalg.lstsq(rows, wanted, rcond=None)[0]
    return float(np.sqrt(np.mean(left[: len(seen[0])] ** 2)))


def main() -> None:
    for highest_hz, amplitude, undriven_nm in COMMANDS:
        movements = [disturbance_nm(highest_hz, amplitude, seed) for seed in SEEDS]
        for delay_s in DELAYS_S:
            instants = round(delay_s * FINE / TICK_S)
            for how, left_nm in (
                ("repeated, no noise", repeated_nm(movements[0], instants)),
                ("best linear predictor, 1 mN m of noise", predicted_nm(movements, instants)),
            ):
                below_db = 20 * log10(undriven_nm / left_nm)
                print(f"to {highest_hz:g} Hz, {1e3 * delay_s:g} ms: {how}: {below_db:.1f} dB below undriven")


if __name__ == "__main__":
    main()
