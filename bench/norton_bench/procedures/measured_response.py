"""Learning a repeated movement from the actuator's measured response, without a model of it (paper, section V).

Near one movement a small change of the motion changes the torque at the port. With the same command in each trial k

    x_k = x0 − Y τ_k

at each frequency: ``x0`` is the motion source, ``Y`` the admittance of the connection, both unknown. The trials differ
in the torque of the load drive, so both follow by least squares. ``Y`` is smoothed over neighbouring frequencies, and
reduced by what chance may have added. The next trial moves the load along the estimate of ``x0``.

What is left of the torque is multiplied by 1 − Ŷ/Y from trial to trial. So an error of ``Ŷ`` makes it slower, and only
one of more than 100 % makes it diverge, as where the stiffness changes much while the actuator moves. So after each
trial that was worse than the best one, the step from the load torque of the best one is half as large.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal.windows import tukey

from norton_bench.arrays import FloatArray
from norton_bench.identification.assembly import Machine, Trial
from norton_bench.identification.at_ticks import in_band
from norton_bench.identification.in_situ import in_band_motion
from norton_bench.identification.path_impedance import exerted_nm, motions_rad

# The admittance is smoothed over this width: a resonance narrower than that is not followed.
SMOOTH_HZ = 2.0
# A movement begins and ends at rest, for longer than this. Within it what is added to the motion comes and goes.
EDGE_S = 0.2
NOTHING = 1e-300
# A step of less than that is none.
LEAST_RAD = 1e-6


def load_torque_towards_source(
    load: Machine, trials: Sequence[Trial], fastest_rad_s: float, tick_s: float
) -> FloatArray:
    """The load torque to send, (ticks,), with which the load should go along with the actuator, by ``trials``.

    ``trials`` has at least one; the load was driven in all but the first. No motion faster than ``fastest_rad_s`` is
    aimed at.
    """
    motions, torques = motions_rad(load, trials, tick_s), exerted_nm(trials, tick_s)
    seen, towards_source = _source(motions, torques, tick_s)
    motion = in_band_motion(seen, tick_s)
    step = in_band(towards_source, tick_s) * tukey(len(motion), min(2 * EDGE_S / (tick_s * len(motion)), 1.0))
    while np.max(np.abs(np.gradient(motion + step, tick_s))) > fastest_rad_s and np.any(step):
        step = step / 2 if np.max(np.abs(step)) > LEAST_RAD else np.zeros(len(step))
    needed_nm = -load.network.torque(np.zeros(len(motion)), motion + step, tick_s)
    best = int(np.argmin(np.mean(torques**2, axis=1)))
    share = 0.5 ** (len(trials) - 1 - best)
    return share * load.command_for(needed_nm, tick_s) + (1.0 - share) * trials[best].load_torque_nm


def _source(motions: FloatArray, torques: FloatArray, tick_s: float) -> tuple[FloatArray, FloatArray]:
    """A motion that was seen, (ticks,), and what is to be added for the motion source; arrays (trials, ticks)."""
    weights = 1.0 / np.maximum(np.mean(torques**2, axis=1), NOTHING)
    weights /= weights.sum()
    motion, torque = weights @ motions, weights @ torques
    size = 2 * len(motion)
    admittance = _admittance(motions - motion, torques - torque, weights, tick_s)
    return motion, np.fft.irfft(admittance * np.fft.rfft(torque, size), size)[: len(motion)]


def _admittance(motions: FloatArray, torques: FloatArray, weights: FloatArray, tick_s: float) -> NDArray[np.complex128]:
    """``Y`` [rad/(N m)] at the frequencies of a real transform of twice the ticks; arrays (trials, ticks)."""
    size = 2 * motions.shape[1]
    moved, exerted = np.fft.rfft(motions, size), np.fft.rfft(torques, size)
    lines = 2 * int(SMOOTH_HZ * size * tick_s / 2) + 1
    cross = _smooth(weights @ (moved * exerted.conj()), lines)
    power = _smooth(weights @ np.abs(exerted) ** 2, lines).real
    motion_power = _smooth(weights @ np.abs(moved) ** 2, lines).real
    coherence = np.minimum(np.abs(cross) ** 2 / np.maximum(power * motion_power, NOTHING), 1.0)
    # Twice the ticks give every second line anew; the mean motion and torque took one trial.
    independent = max((len(weights) - 1) * lines / 2, 2.0)
    # Chance makes a coherence γ² look like γ² + (1 − γ²)/n on average.
    true_coherence = np.clip((coherence - 1.0 / independent) / (1.0 - 1.0 / independent), 0.0, 1.0)
    explained = true_coherence / np.maximum(coherence, NOTHING)
    return np.asarray(-explained * cross / np.maximum(power, NOTHING), dtype=np.complex128)


def _smooth(values: NDArray[np.complex128], lines: int) -> NDArray[np.complex128]:
    """The mean over neighbouring ``lines``; below zero frequency their conjugates."""
    half = lines // 2
    mirrored = np.concatenate([values[half:0:-1].conj(), values, np.zeros(half)])
    return np.asarray(np.convolve(mirrored, np.full(lines, 1.0 / lines), "valid"), dtype=np.complex128)
