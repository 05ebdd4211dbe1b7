"""The spring between the two motors, as far as the torque sensor's readings feel it."""

from dataclasses import dataclass, replace
from math import exp, pi, sqrt

import numpy as np
import numpy.typing as npt

from norton_bench.arrays import FloatArray

# A stiff sensor twists too little for its damping to be seen; no bolted joint has less than this share of critical.
LEAST_DAMPING_RATIO = 0.005
# Of :meth:`Coupling.moved`.
UNKNOWNS = 6
# Joints have damping ratios from 0.005 to 0.16 (Bachmann et al., Vibration Problems in Structures, 1995, app. C): the
# geometric mean, and the deviation of the logarithm with which 95 % lie in this range.
DAMPING_RATIO, DAMPING_STD = 0.028, 0.88
# An amplifier is not quite a first-order lag at such a frequency. Deviations of the motor's phase, in periods (30°),
# and of the logarithm of either motor's amplitude: 95 % lie between half of what the lag says and twice as much.
MOTOR_PHASE_WAVES, AMPLITUDE_STD = 1.0 / 12.0, 0.35
IMPLAUSIBLE = 3.0  # deviations
# Least and greatest deviation of the stiffness's logarithm: it changes with temperature; a factor of 7 either way.
STIFFNESS_STD = (1e-3, 1.0)


def least_damping_nms_rad(stiffness_nm_rad: float, mobility_1_kgm2: float) -> float:
    """Of a spring between two inertias; ``mobility_1_kgm2`` is the sum of their inverses."""
    return 2 * LEAST_DAMPING_RATIO * sqrt(max(stiffness_nm_rad, 0.0) / mobility_1_kgm2)


def surely_damped_nms_rad(value: float, std: float, stiffness_nm_rad: float, mobility_1_kgm2: float) -> float:
    """The damping that a joint has at least with a probability of 95 %, which was measured as ``value`` ± ``std``.

    By Bayes' theorem, from what is known of damping ratios of joints: a measurement that tells nothing leaves that.
    """
    critical = 2.0 * sqrt(max(stiffness_nm_rad, 1e-300) / mobility_1_kgm2)
    steps = np.linspace(-6.0, 6.0, 2001)  # of the logarithm of the ratio, in deviations
    damping = critical * DAMPING_RATIO * np.exp(DAMPING_STD * steps)
    doubt = 0.5 * steps**2 + 0.5 * ((damping - value) / max(std, 1e-300)) ** 2
    likely = np.cumsum(np.exp(np.min(doubt) - doubt))
    surely = float(np.interp(0.05, likely / likely[-1], damping))
    return max(surely, least_damping_nms_rad(stiffness_nm_rad, mobility_1_kgm2))


@dataclass(frozen=True)
class Coupling:
    """What the calibration tells of it and of the load drive, whose delay is on the torque's clock.

    Steps of the commands reach the sensor through it faster than its readings come, and sampling folds them down into
    the band that is fitted. ``command_nm`` (m,) was sent to the load drive at ``sent_s`` (m,).

    Once it was found in the readings (``ringing``), either motor drives it with ``amplitude`` times the torque, and an
    extra delay, of what its parameters say: these were found at lower frequencies. ``covariance_root`` (UNKNOWNS,
    UNKNOWNS) is then the Cholesky factor of the covariance.
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
    motor_extra_delay_s: float = 0.0
    load_extra_delay_s: float = 0.0
    motor_amplitude: float = 1.0
    load_amplitude: float = 1.0
    covariance_root: FloatArray | None = None

    def drawn(self, random: np.random.Generator) -> "Coupling":
        """One of the springs that this may be: where its resonance lies near the rate of the readings, a little more or
        less of either decides how much of the steps the readings fold down."""
        if self.covariance_root is not None:
            return self.moved(self.covariance_root @ random.standard_normal(UNKNOWNS))
        stiffer = self.stiffer(random.standard_normal())
        damping_nms_rad = self.damping_nms_rad + self.damping_std_nms_rad * random.standard_normal()
        return replace(stiffer, damping_nms_rad=damping_nms_rad)

    def moved(self, change: FloatArray) -> "Coupling":
        """By ``change`` (UNKNOWNS,): of the logarithms of stiffness and damping, of both delays [s], of the logarithms
        of both amplitudes."""
        return replace(
            self,
            stiffness_nm_rad=self.stiffness_nm_rad * exp(change[0]),
            damping_nms_rad=self.damping_nms_rad * exp(change[1]),
            motor_extra_delay_s=self.motor_extra_delay_s + float(change[2]),
            load_extra_delay_s=self.load_extra_delay_s + float(change[3]),
            motor_amplitude=self.motor_amplitude * exp(change[4]),
            load_amplitude=self.load_amplitude * exp(change[5]),
        )

    def stiffer(self, deviations: float) -> "Coupling":
        """By so many deviations of the stiffness's logarithm."""
        factor = float(np.exp(deviations * self.stiffness_std_nm_rad / self.stiffness_nm_rad))
        return replace(self, stiffness_nm_rad=self.stiffness_nm_rad * factor)

    def mobility_1_kgm2(self, inertia_kgm2: float) -> float:
        """Of both inertias, that of the actuator being ``inertia_kgm2``."""
        return 1.0 / inertia_kgm2 + 1.0 / self.load_inertia_kgm2

    def resonance_hz(self, inertia_kgm2: float) -> float:
        """At which both inertias ring on the spring."""
        return sqrt(self.stiffness_nm_rad * self.mobility_1_kgm2(inertia_kgm2)) / (2 * pi)

    def damped(self, ratio: float, inertia_kgm2: float) -> "Coupling":
        """The same spring with this share of critical damping."""
        mobility = self.mobility_1_kgm2(inertia_kgm2)
        return replace(self, damping_nms_rad=2 * ratio * sqrt(self.stiffness_nm_rad / mobility))

    def least_damped_nms_rad(self, inertia_kgm2: float) -> float:
        """Its damping, or the least of a joint where that is more."""
        least = least_damping_nms_rad(self.stiffness_nm_rad, self.mobility_1_kgm2(inertia_kgm2))
        return max(self.damping_nms_rad, least)

    def response(self, frequency_hz: FloatArray, inertia_kgm2: float) -> npt.NDArray[np.complex128]:
        """Torque of the spring over the difference of the accelerations that drive its ends [N m s²/rad], (n,)."""
        mobility = self.mobility_1_kgm2(inertia_kgm2)
        s = 2j * np.pi * frequency_hz
        spring = self.stiffness_nm_rad + self.least_damped_nms_rad(inertia_kgm2) * s
        return np.asarray(spring / (s**2 + mobility * spring))


@dataclass(frozen=True)
class Prior:
    """What is known of the spring before, normally distributed over the unknowns of ``Coupling.moved``, independent.

    Delays are known to within half a period of the oscillation.
    """

    centre: Coupling
    std: FloatArray  # (UNKNOWNS,)
    inertia_kgm2: float

    @classmethod
    def of(cls, calibrated: Coupling, inertia_kgm2: float) -> "Prior":
        """From a calibration; from damping ratios of bolted joints if they say more of the damping."""
        stiffness = float(np.clip(calibrated.stiffness_std_nm_rad / calibrated.stiffness_nm_rad, *STIFFNESS_STD))
        damping = calibrated.damping_std_nms_rad / max(calibrated.damping_nms_rad, 1e-300)
        if damping > DAMPING_STD:
            damping, calibrated = DAMPING_STD, calibrated.damped(DAMPING_RATIO, inertia_kgm2)
        half_s = 0.5 / calibrated.resonance_hz(inertia_kgm2)
        std = np.array([stiffness, damping, half_s, half_s, AMPLITUDE_STD, AMPLITUDE_STD])
        return cls(calibrated, std, inertia_kgm2)

    def with_motor_known(self) -> "Prior":
        """The same once the fit, which gives the motor's delay, is free of the ringing."""
        std = self.std.copy()
        std[2] *= 2.0 * MOTOR_PHASE_WAVES
        return replace(self, std=std)

    def off(self, spring: Coupling) -> FloatArray:
        """Distance of a spring from the centre, in the unknowns of ``Coupling.moved``, (UNKNOWNS,)."""
        centre = self.centre
        return np.array(
            [
                np.log(spring.stiffness_nm_rad / centre.stiffness_nm_rad),
                np.log(spring.damping_nms_rad / centre.damping_nms_rad),
                spring.motor_extra_delay_s - centre.motor_extra_delay_s,
                spring.load_extra_delay_s - centre.load_extra_delay_s,
                np.log(spring.motor_amplitude / centre.motor_amplitude),
                np.log(spring.load_amplitude / centre.load_amplitude),
            ]
        )

    def cost(self, spring: Coupling) -> float:
        """Negative log-density relative to the centre."""
        return 0.5 * float(np.sum((self.off(spring) / self.std) ** 2))

    def implausible(self, spring: Coupling) -> bool:
        """Whether no motor has such an amplitude: the load's commands then follow the sensor's noise."""
        return bool(np.any(np.abs(self.off(spring)[4:]) > IMPLAUSIBLE * self.std[4:]))

    def possible(self, spring: Coupling) -> Coupling:
        """The same with its damping ratio held between the least of a joint and 1."""
        low, high = (spring.damped(ratio, self.inertia_kgm2).damping_nms_rad for ratio in (LEAST_DAMPING_RATIO, 1.0))
        return replace(spring, damping_nms_rad=min(max(spring.damping_nms_rad, low), high))
