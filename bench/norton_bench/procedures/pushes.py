"""How hard a repeated movement is pushed off its path, so that the trials tell the impedance along it.

The deflection is foreseen by the mean impedance about the path, as all trials before told it, and by the load's own
inertia and damping.
"""

from collections.abc import Sequence

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.identification.assembly import Machine, Trial
from norton_bench.identification.impedance_along import HIGHEST_HZ
from norton_bench.identification.path_impedance import PathImpedance, motions_rad, path_impedance
from norton_bench.procedures.knowledge import VELOCITY_SHARE
from norton_bench.procedures.waves import multisine
from norton_bench.rig.rig import Rig

# Of the way between the ends of the path: within that, an impedance about it is as good as linear.
DEFLECTION_SHARE = 0.1
# A deflection of less than this, of the one that is wanted, tells too little.
TOO_LITTLE = 0.1
LOWEST_HZ = 0.5


def push_nm(
    load: Machine, trials: Sequence[Trial], pushed: Sequence[Trial], greatest_nm: float, rest_s: float, rig: Rig
) -> FloatArray:
    """What is added to the load torque of the best of ``trials``, (ticks,), in the next push after those of ``pushed``.

    It begins and ends with ``rest_s`` of nothing: a trial is measured from where it rested. Within ``greatest_nm`` with
    the torque that it is added to, and within the rig's velocity limit with the motion; zero where too little is left.
    """
    tick_s, ticks = rig.tick_s, len(trials[0].load_torque_nm)
    rest = np.zeros(round(rest_s / tick_s))
    wave = multisine((ticks - 2 * rest.size) * tick_s, tick_s, low_hz=LOWEST_HZ, high_hz=HIGHEST_HZ, seed=len(pushed))
    wave = np.concatenate([rest, wave, rest])[:ticks]
    best = best_of(trials)
    path_rad = motions_rad(load, [best], tick_s)[0]
    deflection_rad = _deflection_rad(wave, load, path_impedance(load, [*trials, *pushed], tick_s), tick_s)
    velocity_left_rad_s = VELOCITY_SHARE * rig.limits.velocity_rad_s - np.max(np.abs(np.gradient(path_rad, tick_s)))
    wanted = DEFLECTION_SHARE * float(np.ptp(path_rad)) / float(np.max(np.abs(deflection_rad)))
    allowed = min(
        float(velocity_left_rad_s / np.max(np.abs(np.gradient(deflection_rad, tick_s)))),
        greatest_nm - float(np.max(np.abs(best.load_torque_nm))),
    )
    return np.asarray(min(wanted, allowed) * wave if allowed > TOO_LITTLE * wanted else 0.0 * wave)


def best_of(trials: Sequence[Trial]) -> Trial:
    """The one in which the actuator exerted the least."""
    return min(trials, key=lambda each: float(np.std(each.torque_nm)))


def _deflection_rad(wave: FloatArray, load: Machine, about: PathImpedance | None, tick_s: float) -> FloatArray:
    """What a torque (ticks,) moves at most; what is not known of the impedance counts as none."""
    least = np.zeros(3) if about is None else np.maximum(np.subtract(about.values, about.half), 0.0)
    inertia, damping, stiffness = least.tolist()
    size = 2 * len(wave)
    s = 2j * np.pi * np.fft.rfftfreq(size, tick_s)
    impedance = (
        (inertia + load.network.inertia_kgm2) * s**2 + (damping + load.network.viscous_damping_nms_rad) * s + stiffness
    )
    spectrum = np.fft.rfft(wave, size)
    spectrum[1:] /= impedance[1:]
    spectrum[0] = 0.0
    return np.fft.irfft(spectrum, size)[: len(wave)]
