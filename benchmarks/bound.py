"""The Cramér-Rao bound of a record whose torque sensor and encoder are noisy, and whose instants are uneven.

    r = τ(θ, c; p) + n,    y = θ + q,    n white of the torque sensor, q of the encoder

Nothing is presumed of the path θ but that the readings' band holds it, and nothing of the instants at which commands c
act but how far they scatter. Then what a reading of the torque tells of the parameters is as uncertain as the torque
that the *read* path and the commands as *sent* explain: the covariance of r − τ(y) is

    Σ = σ² + H Q Hᵀ + S M⁻¹ D Dᵀ M⁻ᵀ Sᵀ,    H = ∂τ/∂θ = V + G L⁻¹ C

and the information on p is Jᵀ Σ⁻¹ J, what is wanted of it without the nuisances (see ``information``). V holds inertia
and damping, which know only the readings around; C is what a step of the path does to the friction's share h, L⁻¹ how
h remembers it, G what h means to the torque. D is what a late command leaves out of the torque, M⁻¹ how the amplifier's
lag makes up for it, S which ticks are looked at. All are banded, L⁻¹ and M⁻¹ are not: Σ x = b is solved with them
written out as unknowns of their own, in time proportional to the record's length. Q has the errors of counts, of a
variance of count²/12, and what the shaft turns in the scatter of the instants at which it is read.

Torque and encoder are read at instants of their own: between its readings either is interpolated in the band in which
all this is looked at, and a shift by part of a reading leaves H Hᵀ as it is. Errors of counts are taken as independent.
Where the shaft turns by less than a count a reading neighbours err alike; the bound then promises more than can be had.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.linalg import splu

from norton_bench.arrays import FloatArray
from norton_bench.identification import loops
from norton_bench.identification.expansion import Linearised, Slopes, without
from norton_bench.identification.kernels import Kernel
from norton_bench.identification.motor_values import KNOWN
from norton_bench.identification.rows import Rows
from norton_bench.identification.signals import FINE, Signals

# The bound counts what the fit's own low-pass leaves out.
WIDE_BAND = Kernel(cutoff=0.30, half_width=8.0)


@dataclass(frozen=True)
class Noise:
    """Deviations of one reading of the torque sensor and of the encoder, both white, and of the instants at which the
    encoder is read and at which a command acts."""

    torque_nm: float
    position_rad: float
    reading_s: float = 0.0
    command_s: float = 0.0

    def a_tick(self, signals: Signals) -> "Noise":
        """The same densities as noise of one value a tick: from readings that come less often more is left."""
        torque, position = (
            float(np.sqrt(max(period_s / signals.tick_s, 1.0)))
            for period_s in (signals.torque_period_s, signals.position_period_s)
        )
        return Noise(self.torque_nm * torque, self.position_rad * position, self.reading_s * position, self.command_s)


@dataclass(frozen=True)
class PathResponse:
    """H = V + G L⁻¹ C of one stretch [N·m/rad]: V and G (used, ticks), L and C (ticks, ticks), and of its commands M
    and D (ticks, ticks) [N·m/s]; all sparse. ``velocity_rad_s`` (ticks,)."""

    direct: sparse.csr_array  # V
    held: sparse.csr_array  # G
    memory: sparse.csr_array  # L
    entry: sparse.csr_array  # C
    lag: sparse.csr_array  # M
    late: sparse.dia_array  # D
    velocity_rad_s: FloatArray
    used: npt.NDArray[np.int64]

    @classmethod
    def along(cls, rows: Rows, at: Linearised) -> "PathResponse":
        """At the true network, along the path that was read, on the torque's time."""
        network, s_per_rad = at.network, at.shape.s_per_rad
        path, velocity = rows.of_fine_signal(rows.signals.path_rad, (0, 1), at.motion_delay_s)
        count = path.size
        h = loops.friction_bank(path, path[0], np.array([s_per_rad]), np.zeros(1))[0]
        way = np.diff(path, prepend=path[0])
        kept = np.exp(-s_per_rad * np.abs(way))
        # h⁺ = side + (h − side) kept
        slope = s_per_rad * (1.0 - np.sign(way) * np.concatenate([[0.0], h[:-1]])) * kept
        before = sparse.eye_array(count, k=-1)
        # dh/dt = s (ω − |ω| h)
        damping = network.viscous_damping_nms_rad + network.presliding_damping_nms_rad * (1.0 - np.sign(velocity) * h)
        held = network.presliding_damping_nms_rad * np.abs(velocity) - network.coulomb_torque_nm
        rate, acceleration = (_derivative(rows, order, count) for order in (1, 2))
        direct = -network.inertia_kgm2 * acceleration - sparse.diags_array(damping) @ rate
        used = rows.usable
        return cls(
            direct.tocsr()[used],
            sparse.diags_array(held).tocsr()[used],
            (sparse.eye_array(count) - sparse.diags_array(kept) @ before).tocsr(),
            (sparse.diags_array(slope) @ (sparse.eye_array(count) - before)).tocsr(),
            *_lateness(rows.signals, at),
            velocity,
            used,
        )

    def weighed(self, noise: Noise, columns: FloatArray) -> FloatArray:
        """Σ⁻¹ times each of ``columns``, shape (k, used) like them."""
        used, ticks = self.direct.shape
        read = sparse.diags_array(np.hypot(noise.position_rad, noise.reading_s * self.velocity_rad_s))
        direct, entry = self.direct @ read, self.entry @ read
        late = noise.command_s**2 * (self.late @ self.late.T)
        ones = sparse.eye_array(ticks)
        seen = sparse.eye_array(ticks).tocsr()[self.used]
        # Σ x = b with f = L⁻¹ C u, u = Vᵀ x + Cᵀ z and Lᵀ z = Gᵀ x; u counts the encoder's errors in deviations.
        # For the commands w = M⁻¹ D Dᵀ g and Mᵀ g = Sᵀ x.
        system = sparse.block_array(
            [
                [noise.torque_nm**2 * sparse.eye_array(used), self.held, direct, None, seen, None],
                [None, self.memory, -entry, None, None, None],
                [-direct.T, None, ones, -entry.T, None, None],
                [-self.held.T, None, None, self.memory.T, None, None],
                [None, None, None, None, self.lag, -late],
                [-seen.T, None, None, None, None, self.lag.T],
            ],
            format="csc",
        )
        right = np.zeros((system.shape[0], len(columns)))
        right[:used] = columns.T
        return np.asarray(splu(system).solve(right)[:used].T)


def _lateness(signals: Signals, at: Linearised) -> tuple[sparse.csr_array, sparse.dia_array]:
    """M and D: a command that acts by δ later leaves out gain · step · δ of the torque's rise, at its tick and, as the
    lag forgets, at those behind it."""
    network, ticks = at.network, signals.time_s.size
    kept = float(np.exp(-network.amplifier_bandwidth_rad_s * signals.tick_s))
    tick = np.rint((signals.sent_s + at.command_delay_s - signals.time_s[0]) / signals.tick_s).astype(np.int64)
    inside = (tick >= 0) & (tick < ticks)
    steps = np.diff(signals.command, prepend=signals.command[:1])
    rate = np.sqrt(np.bincount(tick[inside], steps[inside] ** 2, ticks)) * network.torque_gain / signals.tick_s
    lag = sparse.eye_array(ticks) - kept * sparse.eye_array(ticks, k=-1)
    return lag.tocsr(), sparse.diags_array((1.0 - kept) * rate)


def information(
    stretches: tuple[Signals, ...], at: Linearised, noise: Noise, *, motion_band: Kernel | None = None
) -> FloatArray:
    """The information matrix, shape (9, 9), in the order of KNOWN.

    Friction's state after each rest and the sensor's zero are unknowns too. Slopes are taken along the motion in
    ``motion_band``, where it is more than the encoder's errors. Without noise of the position it is that of
    ``norton_bench.identification.expansion``.
    """
    slopes = Slopes.of(tuple(_smoothed(stretch, motion_band) for stretch in stretches), at)
    columns = np.concatenate([slopes.wanted, slopes.others, slopes.memory.columns()])
    products, first = np.zeros((len(columns),) * 2), 0
    for rows in slopes.regression.rows:
        last = first + rows.usable.size
        of_stretch = columns[:, first:last]
        products += of_stretch @ PathResponse.along(rows, at).weighed(noise.a_tick(rows.signals), of_stretch).T
        first = last
    wanted = len(KNOWN)
    matrix = without(products[:wanted, :wanted], products[wanted:, :wanted], products[wanted:, wanted:])
    share = (slopes if motion_band is None else Slopes.of(stretches, replace(at, band=motion_band))).motion_share()
    return np.asarray(matrix * np.outer(share, share))


def _smoothed(stretch: Signals, band: Kernel | None) -> Signals:
    """The same, its motion in a narrower band."""
    if band is None:
        return stretch
    reach = round(band.half_width * FINE)
    taps = band.taps(np.arange(-reach, reach + 1) / FINE, 0, exact_to=3)[None, :]
    smooth = loops.filter_at(stretch.position_rad, taps, -reach, 1, stretch.position_rad.size)[0]
    return replace(stretch, position_rad=np.asarray(smooth))


def _derivative(rows: Rows, order: int, count: int) -> sparse.dia_array:
    """Of a signal given at the ticks, in the band that is looked at."""
    reach = int(np.ceil(rows.kernel.half_width))
    offsets = np.arange(-reach, reach + 1)
    taps = rows.kernel.taps(offsets.astype(np.float64), order) / rows.signals.tick_s**order
    return sparse.diags_array(taps, offsets=offsets, shape=(count, count))
