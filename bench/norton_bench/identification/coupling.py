"""The spring between the two motors, as far as the torque sensor's readings feel it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from norton_bench.arrays import FloatArray

# A stiff sensor twists too little for its damping to be seen; no bolted joint has less than this share of critical.
LEAST_DAMPING_RATIO = 0.005
# Of critical damping: from that to a joint's that rubs, and beyond (Bachmann et al., Vibration Problems in Structures,
# 1995, app. C).
RATIOS = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
# A ringing is heard where readings are likelier for one end of these than for the other by very strong evidence, as a
# logarithm (Kass and Raftery, J. Am. Stat. Assoc. 90, 1995).
AUDIBLE = 5.0
# Of the search, which ends where steps are a small part of what is known.
MOST_TRIES = 30
CLOSE, LITTLE_LIKELIER = 0.02, 0.1
SMALLEST_NMS_RAD = 1e-12  # of a damping that somebody knows for sure
# Steps of the curvature: of the stiffness, in deviations, and of the damping's logarithm.
PROBES = (0.2, 0.1)


def least_damping_nms_rad(stiffness_nm_rad: float, mobility_1_kgm2: float) -> float:
    """Of a spring between two inertias; ``mobility_1_kgm2`` is the sum of their inverses."""
    return 2 * LEAST_DAMPING_RATIO * sqrt(max(stiffness_nm_rad, 0.0) / mobility_1_kgm2)


@dataclass(frozen=True)
class Coupling:
    """What the calibration tells of it and of the load drive, whose delay is on the torque's clock.

    Steps of the commands reach the sensor through it faster than its readings come, and sampling folds them down into
    the band that is fitted. ``command_nm`` (m,) was sent to the load drive at ``sent_s`` (m,).
    """

    stiffness_nm_rad: float
    stiffness_std_nm_rad: float
    damping_nms_rad: float
    damping_std_nms_rad: float
    load_inertia_kgm2: float
    load_gain: float
    load_bandwidth_rad_s: float
    load_delay_s: float
    sent_s: FloatArray
    command_nm: FloatArray
    load_released_at_zero: bool = False  # as in records.Chain

    def drawn(self, random: np.random.Generator) -> "Coupling":
        """One of the springs that this may be: where its resonance lies near the rate of the readings, a little more or
        less of either decides how much of the steps the readings fold down."""
        stiffer = self.stiffer(random.standard_normal())
        damping_nms_rad = self.damping_nms_rad + self.damping_std_nms_rad * random.standard_normal()
        return replace(stiffer, damping_nms_rad=damping_nms_rad)

    def stiffer(self, deviations: float) -> "Coupling":
        """By so many deviations of the stiffness's logarithm."""
        factor = float(np.exp(deviations * self.stiffness_std_nm_rad / self.stiffness_nm_rad))
        return replace(self, stiffness_nm_rad=self.stiffness_nm_rad * factor)

    def resonance_hz(self, inertia_kgm2: float) -> float:
        """At which both inertias ring on the spring, that of the actuator being ``inertia_kgm2``."""
        mobility = 1.0 / inertia_kgm2 + 1.0 / self.load_inertia_kgm2
        return sqrt(self.stiffness_nm_rad * mobility) / (2 * pi)

    def damped(self, ratio: float, inertia_kgm2: float) -> "Coupling":
        """The same spring with this share of critical damping."""
        mobility = 1.0 / inertia_kgm2 + 1.0 / self.load_inertia_kgm2
        return replace(self, damping_nms_rad=2 * ratio * sqrt(self.stiffness_nm_rad / mobility))

    def response(self, frequency_hz: FloatArray, inertia_kgm2: float) -> npt.NDArray[np.complex128]:
        """Torque of the spring over the difference of the accelerations that drive its ends [N m s²/rad], (n,)."""
        mobility = 1.0 / inertia_kgm2 + 1.0 / self.load_inertia_kgm2
        s = 2j * np.pi * frequency_hz
        damping = max(self.damping_nms_rad, least_damping_nms_rad(self.stiffness_nm_rad, mobility))
        spring = self.stiffness_nm_rad + damping * s
        return np.asarray(spring / (s**2 + mobility * spring))


def likeliest(coupling: Coupling, inertia_kgm2: float, gain: Callable[[Coupling], float]) -> Coupling:
    """The same with the likeliest spring, and how well that is known then.

    The calibration hardly tells the damping of a stiff spring, but sampled ringing may show it: ``gain`` is the
    logarithm of a spring's likelihood, but for a constant. What the calibration tells is the prior, normal. The search
    begins at the best of some shares of critical damping; the deviations are those of a normal peak (Laplace).
    """
    if np.ptp([gain(coupling.damped(ratio, inertia_kgm2)) for ratio in (RATIOS[0], RATIOS[-1])]) < AUDIBLE:
        return coupling

    def spring(at: FloatArray) -> Coupling:
        return coupling.stiffer(float(at[0])).damped(float(np.exp(at[1])), inertia_kgm2)

    def cost(at: FloatArray) -> float:
        tried = spring(at)
        off = (tried.damping_nms_rad - coupling.damping_nms_rad) / max(coupling.damping_std_nms_rad, SMALLEST_NMS_RAD)
        return 0.5 * float(at[0] ** 2 + off**2) - gain(tried)

    start = min((np.array([0.0, np.log(ratio)]) for ratio in RATIOS), key=cost)
    simplex = start + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.5]])
    best = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": MOST_TRIES, "xatol": CLOSE, "fatol": LITTLE_LIKELIER},
    ).x
    best[1] = np.clip(best[1], np.log(LEAST_DAMPING_RATIO), 0.0)
    found, least = spring(best), cost(best)
    stiffer, damped = (_deviation(cost(best - step), least, cost(best + step), max(step)) for step in np.diag(PROBES))
    relative = coupling.stiffness_std_nm_rad / coupling.stiffness_nm_rad
    return replace(
        found,
        stiffness_std_nm_rad=found.stiffness_nm_rad * relative * min(stiffer, 1.0),
        damping_std_nms_rad=min(found.damping_nms_rad * damped, coupling.damping_std_nms_rad),
    )


def _deviation(before: float, least: float, after: float, step: float) -> float:
    """Of a normal peak, from negative logarithms at it and a step to either side; infinite where they are flat."""
    curvature = (before - 2.0 * least + after) / step**2
    return 1.0 / sqrt(curvature) if curvature > 0.0 else float("inf")
