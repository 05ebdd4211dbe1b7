"""A bank of hysteresis operators and lags whose products sum up everything the data say of every member at once.

Each grid instant gives one row of all members' filtered columns at several whole-tick delays; only the rows' Gram
matrix is kept. Whatever combination of friction shape, bandwidth and delays is asked for later, members and delays
between the nodes included (Lagrange), its regression is a small piece of that matrix.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from bench.identification import loops
from bench.identification.kernels import FULL_BAND
from bench.identification.live.streams import Piece
from bench.identification.regression import Shape
from bench.identification.signals import FINE

FloatArray = npt.NDArray[np.float64]

S_NODES = np.geomspace(10.0, 2e4, 20)
BANDWIDTH_NODES = np.geomspace(40.0, 5000.0, 11)
LOG_S_NODES, LOG_BANDWIDTH_NODES = np.log(S_NODES), np.log(BANDWIDTH_NODES)
# In ticks, relative to the motion: of the command and of the torque.
COMMAND_NODES = np.arange(-2.0, 5.0)
TORQUE_NODES = np.arange(-3.0, 4.0)
REACH = int(FULL_BAND.half_width)
SPAN = 5  # rows kept back on either side, for the delays

# Where each group of columns begins in a row.
VELOCITY, ACCELERATION = 0, 1
SLIDING = 2
SLIDING_RATE = SLIDING + S_NODES.size
LAG = SLIDING_RATE + S_NODES.size
TORQUE = LAG + BANDWIDTH_NODES.size * COMMAND_NODES.size
ONE = TORQUE + TORQUE_NODES.size
WIDTH = ONE + 1


@dataclass
class LiveBank:
    """Turns pieces of the grid into rows."""

    tick_s: float
    _h: FloatArray = field(default_factory=lambda: np.zeros(S_NODES.size), init=False)
    _lag: FloatArray = field(default_factory=lambda: np.zeros(BANDWIDTH_NODES.size), init=False)
    _last: float = field(default=0.0, init=False)
    _end_s: float = field(default=float("nan"), init=False)
    _fine: FloatArray = field(default_factory=lambda: np.empty((0, 0)), init=False)
    _coarse: FloatArray = field(default_factory=lambda: np.empty((3, 0)), init=False)  # time, moving, torque
    _rows: FloatArray = field(default_factory=lambda: np.empty((0, 0)), init=False)
    _row_times: FloatArray = field(default_factory=lambda: np.empty((2, 0)), init=False)  # time, moving

    def __post_init__(self) -> None:
        offsets = np.arange(-REACH * FINE, REACH * FINE + 1) / FINE
        self._taps = [FULL_BAND.taps(offsets, order) / self.tick_s**order for order in range(3)]
        self._coarse_taps = FULL_BAND.taps(np.arange(-REACH, REACH + 1, dtype=float), 0)

        # The covariance of velocity and acceleration for readings with white errors of variance 1, one a tick.
        phases = np.exp(-2j * np.pi * np.outer(np.linspace(-0.5, 0.5, 1001), offsets))
        response = phases @ np.stack(self._taps[1:]).T
        self._noise_of_motion = np.real(response.conj().T @ response) / len(phases)

    def noise(self, count_variance_rad2: float) -> FloatArray:
        """The covariance of a row that comes from the encoder's counts alone, shape (WIDTH, WIDTH)."""
        noise = np.zeros((WIDTH, WIDTH))
        noise[:SLIDING, :SLIDING] = count_variance_rad2 * self._noise_of_motion
        return noise

    def rows(self, piece: Piece) -> tuple[FloatArray, FloatArray]:
        """Instants [s] and rows, shapes (n,) and (n, WIDTH), of what is complete by now and moves."""
        if not (np.all(np.isfinite(piece.path_rad)) and np.all(np.isfinite(piece.position_rad))):
            # Friction and lags would remember it for ever: begin anew with what follows.
            self._end_s = float("nan")
            return np.empty(0), np.empty((0, WIDTH))
        if not abs(piece.time_s[0] - self._end_s) < 0.5 * self.tick_s:
            self._restart(piece)
        self._extend(piece)
        self._filter()
        return self._spread()

    def _restart(self, piece: Piece) -> None:
        self._fine = np.empty((1 + S_NODES.size + BANDWIDTH_NODES.size, 0))
        self._coarse, self._row_times = np.empty((3, 0)), np.empty((2, 0))
        self._rows = np.empty((3 + 2 * S_NODES.size + BANDWIDTH_NODES.size, 0))
        self._h[:] = 0.0
        self._lag[:] = piece.command[max(0, int(np.searchsorted(piece.sent_s, piece.time_s[0])) - 1)]
        self._end_s = float(piece.time_s[0])
        self._last = float(piece.path_rad[0])

    def _extend(self, piece: Piece) -> None:
        fine_s = np.asarray(piece.time_s[0] + np.arange(piece.path_rad.size) * (self.tick_s / FINE), dtype=np.float64)
        sliding = loops.friction_bank(piece.path_rad, self._last, S_NODES, self._h)
        lag = loops.lag_bank(
            piece.sent_s,
            piece.command,
            BANDWIDTH_NODES,
            fine_s,
            self._end_s,
            self._lag,
            piece.released_at_zero,
        )
        self._last = float(piece.path_rad[-1])
        self._end_s = float(piece.time_s[-1] + self.tick_s)
        # The lags stand at the last fine instant; the next piece goes on from the end of this one.
        held = piece.command[max(0, int(np.searchsorted(piece.sent_s, fine_s[-1], side="right")) - 1)]
        self._lag[:] = held + (self._lag - held) * np.exp(-BANDWIDTH_NODES * (self._end_s - fine_s[-1]))
        new = np.concatenate([piece.position_rad[None, :], sliding, lag])
        self._fine = np.concatenate([self._fine, new], axis=1)
        coarse = np.stack([piece.time_s, piece.moving, piece.torque_nm])
        self._coarse = np.concatenate([self._coarse, coarse], axis=1)

    def _filter(self) -> None:
        """Filter what has enough on both sides; keep what the next piece needs."""
        count = self._coarse.shape[1] - 2 * REACH
        if count <= 0:
            return
        smooth, rate, bend = self._taps
        at = (0, FINE, count)
        motion = loops.filter_at(self._fine[0], np.stack([rate, bend]), *at)
        sliding = loops.filter_many(self._fine[1 : 1 + S_NODES.size], np.stack([smooth, rate]), *at)
        lag = loops.filter_many(self._fine[1 + S_NODES.size :], smooth[None, :], *at)
        torque = loops.filter_at(self._coarse[2], self._coarse_taps[None, :], 0, 1, count)
        slow_rate = sliding[1::2] / S_NODES[:, None]
        new = np.concatenate([motion, sliding[0::2], slow_rate, lag, torque])
        self._rows = np.concatenate([self._rows, new], axis=1)
        self._row_times = np.concatenate([self._row_times, self._coarse[:2, REACH : REACH + count]], axis=1)
        self._fine, self._coarse = self._fine[:, count * FINE :], self._coarse[:, count:]

    def _spread(self) -> tuple[FloatArray, FloatArray]:
        """Lay the delayed copies side by side."""
        count = self._row_times.shape[1] - 2 * SPAN
        if count <= 0:
            return np.empty(0), np.empty((0, WIDTH))
        full = np.empty((WIDTH, count))
        full[:LAG] = self._rows[:LAG, SPAN : SPAN + count]
        for k, delay in enumerate(COMMAND_NODES.astype(int)):
            first = SPAN - delay
            full[LAG + k : TORQUE : COMMAND_NODES.size] = self._rows[LAG:-1, first : first + count]
        for k, delay in enumerate(TORQUE_NODES.astype(int)):
            full[TORQUE + k] = self._rows[-1, SPAN - delay : SPAN - delay + count]
        full[ONE] = 1.0
        times, moves = self._row_times[:, SPAN : SPAN + count]
        self._rows, self._row_times = self._rows[:, count:], self._row_times[:, count:]
        return times[moves > 0.5], full.T[moves > 0.5]


def combination(shape: Shape, tick_s: float) -> tuple[FloatArray, FloatArray]:
    """How the columns of one regression are combined from a row: (WIDTH, 6) and the target's (WIDTH,).

    Columns are those of LINEAR, then the bias. The shape's delays are relative to the motion here: the command's, and
    (as ``motion_delay_s``) that by which motion comes later than torque.
    """
    columns, target = np.zeros((WIDTH, 6)), np.zeros(WIDTH)
    s = lagrange(LOG_S_NODES, float(np.log(shape.s_per_rad)), 6)
    bandwidth = lagrange(LOG_BANDWIDTH_NODES, float(np.log(shape.bandwidth_rad_s)), 6)
    delay = lagrange(COMMAND_NODES, shape.command_delay_s / tick_s, 6)
    columns[LAG:TORQUE, 0] = np.outer(bandwidth, delay).ravel()
    columns[ACCELERATION, 1] = -1.0
    columns[VELOCITY, 2] = -1.0
    columns[SLIDING:SLIDING_RATE, 3] = -s
    columns[SLIDING_RATE:LAG, 4] = -s
    columns[ONE, 5] = 1.0
    target[TORQUE:ONE] = lagrange(TORQUE_NODES, shape.motion_delay_s / tick_s, 6)
    return columns, target


def lagrange(nodes: FloatArray, at: float, count: int) -> FloatArray:
    """Weights of polynomial interpolation between the ``count`` nodes around ``at``; zero elsewhere."""
    return np.asarray(loops.lagrange(nodes, at, count))
