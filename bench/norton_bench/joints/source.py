"""The motion source of an arm: how both joints move together while no torque acts at either port (section V).

What torque was left there, the load drives being late, is accounted for with the impedance of both joints:
θ_N = θ + Z⁻¹ τ. Z is that of the posture; along a movement it differs, and the correction is wrong by as much.
"""

from dataclasses import dataclass

import numpy as np

from norton_bench.arrays import ComplexArray, FloatArray
from norton_bench.distributions import t_quantile
from norton_bench.errors import ExperimentError
from norton_bench.identification.at_ticks import low_pass, readings_at_ticks, sent_at_ticks
from norton_bench.joints.experiment import OUT, REACH, SETTLE_S
from norton_bench.joints.impedance import LEVEL, JointImpedance
from norton_bench.records import Measured

# What the port's torque is accounted for up to; above, an arm is too heavy to answer.
HIGHEST_HZ = 15.0
LEFT_OUT = 1  # a first reach begins where the friction of the loads left the arm
FEWEST = 2  # to see how much reaches differ
LEAST_SHARE = 0.98  # of its ticks, of a reach that counts as whole


@dataclass(frozen=True)
class SourcePath:
    """The mean over trials, from ``time_s`` = 0, at which the commands change; shape (ticks, 2), shoulder and elbow.

    ``half_rad`` is the half-width of its 95 % interval at each tick, from how the trials differ. ``torque_nm`` is the
    rms torque that was left at each port, ``corrected_rad`` the rms of what was accounted for.
    """

    time_s: FloatArray
    angle_rad: FloatArray
    half_rad: FloatArray
    trials: int
    torque_nm: tuple[float, float]
    corrected_rad: tuple[float, float]


def source_path(joints: tuple[Measured, ...], impedance: JointImpedance, tick_s: float) -> SourcePath:
    """Of the way out, from what each joint measured. Raises ExperimentError where too few trials are there."""
    names = [each.name for each in joints[0].segments if each.procedure == REACH and each.name.startswith(OUT)]
    if len(names) < LEFT_OUT + FEWEST:
        raise ExperimentError(f"there are {len(names)} reaches, of which the first says nothing; the source needs more")
    motions, torques = zip(*(_trial(joints, name, tick_s) for name in names[LEFT_OUT:]), strict=True)
    ticks = max(map(len, motions))
    whole = [place for place, each in enumerate(motions) if len(each) >= LEAST_SHARE * ticks]
    ticks = min(len(motions[place]) for place in whole)
    angle, torque = (np.stack([values[place][:ticks] for place in whole]) for values in (motions, torques))
    if len(angle) < FEWEST:
        raise ExperimentError("fewer than two whole reaches are in the recording after the first one")
    corrections = np.stack([_answer(each, impedance, tick_s) for each in torque])
    paths = angle + corrections
    settle = round(SETTLE_S / tick_s)
    paths = paths - paths[:, :settle].mean(axis=(0, 1))
    deviation = np.std(paths, axis=0, ddof=1) / np.sqrt(len(paths))
    return SourcePath(
        time_s=np.asarray((np.arange(ticks) - settle) * tick_s, dtype=np.float64),
        angle_rad=paths.mean(axis=0),
        half_rad=t_quantile(LEVEL, len(paths) - 1) * deviation,
        trials=len(paths),
        torque_nm=_of_joints(torque),
        corrected_rad=_of_joints(corrections),
    )


def _of_joints(values: FloatArray) -> tuple[float, float]:
    shoulder, elbow = np.sqrt(np.mean(values**2, axis=(0, 1)))
    return float(shoulder), float(elbow)


def _trial(joints: tuple[Measured, ...], name: str, tick_s: float) -> tuple[FloatArray, FloatArray]:
    """Angles, and torques as the loop had them, without the bias of the sensor; both of shape (ticks, 2)."""
    angles, torques = [], []
    for measured in joints:
        segment = next(each for each in measured.segments if each.procedure == REACH and each.name == name)
        ticks = round((segment.end_ns - segment.start_ns) * 1e-9 / tick_s)
        angles.append(readings_at_ticks(measured, segment, ticks, tick_s).position_rad)
        torques.append(sent_at_ticks(measured, segment, "torque_nm", ticks, tick_s))
    ticks = min(map(len, angles))
    return (
        np.stack([each[:ticks] for each in angles], axis=-1),
        np.stack([each[:ticks] for each in torques], axis=-1),
    )


def _answer(torque_nm: FloatArray, impedance: JointImpedance, tick_s: float) -> FloatArray:
    """Z⁻¹ τ in the time of a trial, both (ticks, 2); what acts at its beginning is taken to have acted before, too."""
    ticks = len(torque_nm)
    size = 4 * ticks
    held = np.concatenate([torque_nm, _faded(torque_nm[-1], torque_nm[0], size - ticks)])
    s: ComplexArray = np.asarray(2j * np.pi * np.fft.rfftfreq(size, tick_s))
    spectrum = np.fft.rfft(held, axis=0) * low_pass(size, tick_s, HIGHEST_HZ)[:, None]
    answer = np.einsum("nij,nj->ni", np.linalg.inv(impedance.at(s)), spectrum)
    return np.asarray(np.fft.irfft(answer, size, axis=0)[:ticks])


def _faded(first: FloatArray, last: FloatArray, ticks: int) -> FloatArray:
    """From one value to another along half a cosine, (ticks, 2): what is periodic has then no steps."""
    share = 0.5 * (1.0 - np.cos(np.pi * (np.arange(ticks) + 0.5) / ticks))[:, None]
    return first + (last - first) * share
