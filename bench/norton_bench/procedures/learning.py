"""What one trial teaches the next: by how much the models of both machines miss what was measured, tick by tick.

On either side of the port a model says which torque belongs to the motion and the command that were measured:

    lack_actuator = τ − τ̂_actuator(command, θ)          lack_load = −τ − τ̂_load(load torque, θ_load)

Along nearly the same movement a model lacks nearly the same. So the next trial is computed from the models with what
they lack: the actuator's free motion, and the load torque that takes the load along with it, its friction, its
amplifier's lag and its delay undone. What is learnt is filtered without delay; lessons are averaged, each the more the
less torque there was when it was learnt, and frequencies that noise alone explains are left out.

It converges where the true answer of torque to motion, over that of the models, is nearer to 1 than 1: gains may be off
by almost their own size, and phases by 60°. Below the 30 Hz that are taught, half a tick is 5°.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control.preview import delayed
from norton_bench.identification.in_situ import Machine
from norton_bench.identification.trials import Seen, in_band

# The spectrum is averaged over so many lines to tell what is noise.
LINES = 41


@dataclass(frozen=True)
class Models:
    """Both sides of the port."""

    actuator: Machine
    load: Machine


@dataclass(frozen=True, eq=False)
class Lesson:
    """What the models lacked in one trial [N m], (ticks,), and how much that counts."""

    actuator_nm: FloatArray
    load_nm: FloatArray
    weight: float


def lesson(
    models: Models, command: FloatArray, load_torque_nm: FloatArray, found: Seen, torque_nm: FloatArray, tick_s: float
) -> Lesson:
    """Of a trial with ``command`` and ``load_torque_nm`` sent, and the port torque ``torque_nm``, all (ticks,).

    The load's mean lack is taken for the torque's bias since the load was calibrated.
    """
    actuator = torque_nm - models.actuator.torque_nm(command, found.position_rad, tick_s)
    load = -torque_nm - models.load.torque_nm(load_torque_nm, found.load_position_rad, tick_s)
    bias_nm = -float(np.mean(load))
    near = in_band(torque_nm - bias_nm, tick_s)
    weight = 1.0 / max(float(np.mean(near**2)), 1e-18)
    return Lesson(in_band(actuator - bias_nm, tick_s), in_band(load + bias_nm, tick_s), weight)


def next_load_torque(
    models: Models, command: FloatArray, lessons: Sequence[Lesson], noise_nm: float, tick_s: float
) -> FloatArray:
    """The load torque to send, (ticks,), that should leave the port without torque under ``command``.

    ``noise_nm`` is that of one torque reading.
    """
    actuator_lacks, load_lacks = lacks(lessons, len(command), noise_nm)
    actuator, load = models.actuator, models.load
    # As a command it passes the amplifier, which is undone: the lack then acts on the shaft itself.
    position, _, _ = actuator.network.free_motion(command + actuator.command_for(actuator_lacks, tick_s), tick_s)
    motion = delayed(position, tick_s, actuator.command_delay_s)
    needed_nm = -load.network.torque(np.zeros(len(command)), motion, tick_s) - load_lacks
    return load.command_for(needed_nm, tick_s)


def lacks(lessons: Sequence[Lesson], ticks: int, noise_nm: float) -> tuple[FloatArray, FloatArray]:
    """The weighted means of what the models lacked, without what noise alone may have made of them."""
    if not lessons:
        return np.zeros(ticks), np.zeros(ticks)
    weights = np.array([each.weight for each in lessons])
    weights /= weights.sum()
    deviation_nm = noise_nm * float(np.linalg.norm(weights))
    actuator = weights @ np.stack([each.actuator_nm for each in lessons])
    load = weights @ np.stack([each.load_nm for each in lessons])
    return above_noise(actuator, deviation_nm), above_noise(load, deviation_nm)


def above_noise(values: FloatArray, deviation_nm: float) -> FloatArray:
    """``values`` (ticks,) with every frequency scaled by the share of its power that white noise does not explain."""
    size = 2 * len(values)
    spectrum = np.fft.rfft(values, size)
    power = np.convolve(np.abs(spectrum) ** 2, np.full(LINES, 1 / LINES), "same")
    share = np.clip(1.0 - len(values) * deviation_nm**2 / np.maximum(power, 1e-300), 0.0, 1.0)
    return np.fft.irfft(spectrum * share, size)[: len(values)]
