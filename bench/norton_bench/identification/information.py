"""What a record tells of each parameter, or what an experiment that is only planned would tell, in the same terms.

The columns and slopes of the fit's own regression, at an estimate that is there already, give the information matrix
JᵀJ / σ²: its inverse is the covariance that noise alone would leave (the Cramér–Rao bound where σ² is the noise's
density). Each stretch's initial friction and the sensor's wandering zero are unknowns too, and are projected out.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from norton_bench.arrays import FloatArray
from norton_bench.identification.fit import PHYSICAL
from norton_bench.identification.kernels import FULL_BAND, Kernel
from norton_bench.identification.quantisation import moving
from norton_bench.identification.regression import COULOMB, DAMPING, GAIN, INERTIA, VISCOUS, Memory, Regression, Shape
from norton_bench.identification.results import FitResult
from norton_bench.identification.signals import FINE, Signals
from norton_bench.models.network import NortonNetwork

# The order of rows and columns. The parameters count relative to themselves, the delays in seconds.
KNOWN = (*PHYSICAL, "command_delay", "motion_delay")
# What nothing has told of yet is known to about this: the box that the fit searches is as wide.
VAGUE_RELATIVE = 3.0
VAGUE_S = 5e-3
# A parameter that came out as nothing has no scale of its own; with this one its relative deviation is vast.
LEAST = 1e-12


@dataclass(frozen=True)
class Excitation:
    """A planned stretch: arrays of shape (ticks,), the motion smooth and imposed, so known ahead."""

    tick_s: float
    command: FloatArray
    position_rad: FloatArray


@dataclass(frozen=True)
class Linearised:
    """Where the information is taken: a network, delays, the band, and the waves of cogging."""

    network: NortonNetwork
    command_delay_s: float
    motion_delay_s: float
    band: Kernel = FULL_BAND
    cogging: tuple[float, ...] = ()

    @classmethod
    def at(cls, result: FitResult) -> "Linearised":
        waves = tuple(wave.periods_per_turn for wave in result.cogging)
        return cls(result.network, result.command_delay_s, result.motion_delay_s, result.band, waves)

    @property
    def shape(self) -> Shape:
        network = self.network
        s_per_rad = network.presliding_stiffness_nm_rad / network.coulomb_torque_nm
        return Shape(network.amplifier_bandwidth_rad_s, s_per_rad, self.command_delay_s, self.motion_delay_s)

    @property
    def linear(self) -> FloatArray:
        """In the order of the regression's first five columns."""
        network = self.network
        values = np.zeros(5)
        values[GAIN], values[INERTIA] = network.torque_gain, network.inertia_kgm2
        values[VISCOUS], values[COULOMB] = network.viscous_damping_nms_rad, network.coulomb_torque_nm
        values[DAMPING] = network.presliding_damping_nms_rad
        return values


def noise_density_nm(result: FitResult) -> float:
    """The deviation of white noise, a sample a tick, whose rms behind the fit's low-pass is that of its residual."""
    return float(result.torque_rms_nm / np.sqrt(result.band.energy(0)))


@dataclass(frozen=True)
class Slopes:
    """Change of the torque with every unknown, at every sample that is used.

    ``wanted`` (9, samples) in the order of KNOWN; ``others`` (k, samples), of cogging and of the sensor's zero;
    ``memory``, of the friction after each rest; ``errors`` (9,), what readings' own errors add to the squares of
    ``wanted``. ``regression`` says which samples those are.
    """

    regression: Regression
    wanted: FloatArray
    others: FloatArray
    memory: Memory
    errors: FloatArray

    @classmethod
    def of(cls, stretches: tuple[Signals, ...], at: Linearised) -> "Slopes":
        regression = replace(Regression.of(stretches, at.band), cogging=at.cogging)
        shape, linear = at.shape, at.linear
        columns, memory = regression.columns(shape)
        slope_bandwidth, slope_s, slope_command, slope_motion = regression.jacobian(shape, columns, linear)
        scale = np.maximum(np.abs(linear), LEAST)
        own = columns[:5] * scale[:, None]
        # s is σ0/τc: with σ0 held, a greater τc makes the contact softer relative to its strength.
        wanted = np.stack(
            [own[GAIN], slope_bandwidth, own[INERTIA], own[VISCOUS], own[COULOMB] - slope_s, slope_s, own[DAMPING],
             slope_command, slope_motion]
        )  # fmt: skip
        errors = np.zeros(len(KNOWN))
        contamination = regression.contamination() * scale**2
        for row, column in ((KNOWN.index("inertia"), INERTIA), (KNOWN.index("viscous_damping"), VISCOUS)):
            errors[row] = contamination[column]
        return cls(regression, wanted, columns[5:], memory, errors)

    @cached_property
    def products(self) -> FloatArray:
        """Products of ``wanted`` without what any other unknown could explain as well, shape (9, 9)."""
        wanted, others = self.memory.taken_off(self.wanted), self.memory.taken_off(self.others)
        return without(wanted @ wanted.T, others @ wanted.T, others @ others.T)

    def motion_share(self) -> FloatArray:
        """By how much each of ``wanted`` is motion: errors of readings look like it, and tell nothing. Shape (9,)."""
        squares = np.diag(self.products)
        left = np.maximum(squares - self.errors, 0.0)
        return np.sqrt(np.divide(left, squares, out=np.zeros_like(left), where=squares > 0.0))


def information(stretches: tuple[Signals, ...], at: Linearised, noise_nm: float) -> FloatArray:
    """The information matrix of ``stretches``, shape (9, 9), in the order of KNOWN; ``noise_nm`` is white, a tick."""
    slopes = Slopes.of(stretches, at)
    share = slopes.motion_share()
    return np.asarray(slopes.products * np.outer(share, share) / noise_nm**2)


def information_of_plan(
    excitation: Excitation, at: Linearised, noise_nm: float, *, position_resolution_rad: float = 0.0
) -> FloatArray:
    """The same, of what is only planned; what the encoder's counts would hide is left out as the fit would."""
    return information((planned_signals(excitation, position_resolution_rad),), at, noise_nm)


def planned_signals(excitation: Excitation, position_resolution_rad: float) -> Signals:
    """An ideal record of the plan."""
    tick_s, ticks = excitation.tick_s, len(excitation.command)
    time_s = np.asarray(np.arange(ticks) * tick_s, dtype=np.float64)
    fine_s = np.arange(ticks * FINE) * (tick_s / FINE)
    path = np.asarray(CubicSpline(time_s, excitation.position_rad)(np.minimum(fine_s, time_s[-1])), dtype=np.float64)
    usable = moving(excitation.position_rad, position_resolution_rad)
    return Signals(
        tick_s=tick_s,
        origin_ns=0,
        time_s=time_s,
        position_rad=path,
        path_rad=path,
        sent_s=time_s,
        command=np.ascontiguousarray(excitation.command, dtype=np.float64),
        segment=np.zeros(ticks, dtype=np.int64),
        usable=usable if usable.any() else np.ones(ticks, dtype=bool),
        rests=np.zeros(0, dtype=np.int64),
        torque_nm=np.zeros(ticks),
    )


def vague() -> FloatArray:
    """The information of somebody who knows next to nothing, shape (9, 9): it makes every matrix invertible."""
    deviations = np.array([VAGUE_RELATIVE] * 7 + [VAGUE_S] * 2)
    return np.diag(deviations**-2.0)


def deviations(matrix: FloatArray) -> FloatArray:
    """The standard deviations that ``matrix`` leaves, shape (9,), relative (delays: seconds)."""
    scale = np.sqrt(np.diag(matrix))
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(matrix / np.outer(scale, scale)))) / scale)


def without(own: FloatArray, shared: FloatArray, nuisance: FloatArray) -> FloatArray:
    """Products ``own`` (k, k) of what is wanted, without what a nuisance could explain as well.

    ``shared`` (m, k) are the products of nuisance and wanted, ``nuisance`` (m, m) its own.
    """
    lengths = np.sqrt(np.diag(nuisance))
    there = lengths > 0
    scale = lengths[there]
    shared = shared[there] / scale[:, None]
    explained = np.linalg.lstsq(nuisance[np.ix_(there, there)] / np.outer(scale, scale), shared, rcond=1e-12)[0]
    matrix = own - shared.T @ explained
    return np.asarray(0.5 * (matrix + matrix.T))
