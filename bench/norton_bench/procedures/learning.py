"""Iterative learning of the load torque: each trial corrects the models of both machines for the next one.

On each side of the port a model gives the torque for the measured motion and command. Its error is

    e_actuator = τ − τ̂_actuator(command, θ)          e_load = −τ − τ̂_load(load torque, θ_load)

Along nearly the same movement the error is nearly the same. So the next trial is computed from the corrected models:
the actuator's free motion, and the load torque that makes the load follow it, with the load's friction, its amplifier's
lag and its delay undone. Errors are filtered without delay. The corrections of several trials are averaged; the
weight of a trial is greater the less torque there was at the port. Frequencies with nothing but noise are left out.

It converges where the ratio of the true response (torque to motion) to that of the models differs from 1 by less than
1: gains may be wrong by almost 100 %, and phases by 60°. Below the 30 Hz that are corrected, half a tick is 5°.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.control.preview import delayed
from norton_bench.identification.assembly import LoadTaken, Machine, Trial
from norton_bench.identification.at_ticks import TickReadings, in_band
from norton_bench.identification.in_situ import Exerted
from norton_bench.identification.trials import TrialFigures, averaged, diverge, settled

# The spectrum is averaged over this number of lines to estimate the noise.
LINES = 41


@dataclass(frozen=True)
class Models:
    """The models of both sides of the port."""

    actuator: Machine
    load: Machine


@dataclass(frozen=True, eq=False)
class Correction:
    """The errors of both models in one trial [N m], (ticks,), and the weight of that trial."""

    actuator_nm: FloatArray
    load_nm: FloatArray
    weight: float


def correction(
    models: Models,
    command: FloatArray,
    load_torque_nm: FloatArray,
    measured: TickReadings,
    torque_nm: FloatArray,
    tick_s: float,
) -> Correction:
    """The correction from a trial with ``command`` and ``load_torque_nm`` sent, and the port torque ``torque_nm``, all
    (ticks,).

    The mean error of the load is taken as the drift of the torque sensor's bias since the calibration of the load.
    """
    actuator = torque_nm - models.actuator.torque_nm(command, measured.position_rad, tick_s)
    load = -torque_nm - models.load.torque_nm(load_torque_nm, measured.load_position_rad, tick_s)
    bias_nm = -float(np.mean(load))
    near = in_band(torque_nm - bias_nm, tick_s)
    weight = 1.0 / max(float(np.mean(near**2)), 1e-18)
    return Correction(in_band(actuator - bias_nm, tick_s), in_band(load + bias_nm, tick_s), weight)


def next_load_torque(
    models: Models, command: FloatArray, corrections: Sequence[Correction], noise_nm: float, tick_s: float
) -> FloatArray:
    """The load torque to send, (ticks,), that should leave the port without torque under ``command``.

    ``noise_nm`` is that of one torque reading.
    """
    actuator_nm, load_nm = mean_corrections(corrections, len(command), noise_nm)
    actuator, load = models.actuator, models.load
    # The lag of the amplifier is inverted, so that the correction acts on the shaft itself.
    position, _, _ = actuator.network.free_motion(command + actuator.command_for(actuator_nm, tick_s), tick_s)
    motion = delayed(position, tick_s, actuator.command_delay_s)
    needed_nm = -load.network.torque(np.zeros(len(command)), motion, tick_s) - load_nm
    return load.command_for(needed_nm, tick_s)


def mean_corrections(corrections: Sequence[Correction], ticks: int, noise_nm: float) -> tuple[FloatArray, FloatArray]:
    """The weighted means of the corrections of both models [N m], without the frequencies that contain only noise."""
    if not corrections:
        return np.zeros(ticks), np.zeros(ticks)
    weights = np.array([each.weight for each in corrections])
    weights /= weights.sum()
    deviation_nm = noise_nm * float(np.linalg.norm(weights))
    actuator = weights @ np.stack([each.actuator_nm for each in corrections])
    load = weights @ np.stack([each.load_nm for each in corrections])
    return above_noise(actuator, deviation_nm), above_noise(load, deviation_nm)


def above_noise(values: FloatArray, deviation_nm: float) -> FloatArray:
    """``values`` (ticks,) with every frequency scaled by the share of its power that white noise does not explain."""
    size = 2 * len(values)
    spectrum = np.fft.rfft(values, size)
    power = np.convolve(np.abs(spectrum) ** 2, np.full(LINES, 1 / LINES), "same")
    share = np.clip(1.0 - len(values) * deviation_nm**2 / np.maximum(power, 1e-300), 0.0, 1.0)
    return np.fft.irfft(spectrum * share, size)[: len(values)]


@dataclass(frozen=True, eq=False)
class Assembly:
    """Both machines of an in-situ experiment, and sentences about where their values come from.

    ``actuator`` is None where no model describes it: its response is learned from the trials.
    """

    load: Machine
    actuator: Machine | None
    said: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class InSitu:
    """The state of an in-situ experiment. ``order`` has for every trial, past and future, whether it is driven.

    ``sized`` is False as long as the greatest ``command`` that is not too fast is unknown. ``pushed`` are the trials
    that were pushed off the path after it was found.
    """

    assembly: Assembly | None = None
    command: FloatArray = field(default_factory=lambda: np.empty(0))
    order: tuple[bool, ...] = ()
    sized: bool = True
    trials: tuple[Exerted, ...] = ()
    readings: tuple[Trial, ...] = ()
    pushed: tuple[Trial, ...] = ()
    finished: bool = False

    @property
    def load(self) -> LoadTaken:
        """The load's values for the recording; only after the assembly was shaken."""
        assert self.assembly is not None
        return LoadTaken(self.assembly.load, self.assembly.said, len(self.command))


# Corrections are averaged until their noise has a quarter of the power of a single one: one more saves 5 %.
AVERAGED = 4


@dataclass(frozen=True, eq=False)
class Iteration:
    """The state of a repeated movement: its trials, their corrections, and whether they converge.

    ``command`` (ticks,) is the actuator's, the same in every trial; ``start_rad`` is where the load stands when one
    begins. ``reasons`` say, once ``finished``, why it has not converged.
    """

    command: FloatArray
    start_rad: float
    trials: tuple[TrialFigures, ...] = ()
    corrections: tuple[Correction, ...] = ()
    finished: bool = False
    reasons: tuple[str, ...] = ()

    def after(self, trial: TrialFigures, correction: Correction) -> "Iteration":
        return replace(self, trials=(*self.trials, trial), corrections=(*self.corrections, correction))

    @property
    def converged(self) -> bool:
        return self.finished and not self.reasons

    @property
    def settled(self) -> bool:
        return settled(self.trials)

    @property
    def averaged(self) -> bool:
        """Whether another trial would hardly reduce the noise in the correction."""
        return averaged(len(self.trials)) >= AVERAGED

    @property
    def diverges(self) -> bool:
        return diverge(self.trials)

    def ended(self, *reasons: str) -> "Iteration":
        return replace(self, finished=True, reasons=reasons)
