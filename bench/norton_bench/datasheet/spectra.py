"""The port's torque as two linear paths, from command and from velocity, at every frequency: an empirical estimate.

Averaged, windowed periodograms (Welch's method) with two inputs at once, because a held shaft still moves a little
under the command: Bendat and Piersol, "Random Data", 4th edition, chapters 7 and 9. The load's drive closes a loop
about the port, so that noise of the torque comes back as motion; what was asked for, command and reference motion, is
not disturbed by it and serves as instrument (Söderström and Stoica, "System Identification", chapters 8 and 10). The
estimate knows nothing of the model, so it can speak against it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter1d
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann

from norton_bench.arrays import ComplexArray, FloatArray
from norton_bench.distributions import f_tail
from norton_bench.models.network import NortonNetwork
from norton_bench.models.terms import DRAG, STRIBECK, STRIBECK_VELOCITY

PIECE_S = 1.0
# Where the signals stand.
INPUTS, TORQUE, ASKED = slice(0, 2), 2, slice(3, 5)
# An instrument's line that is weaker than Hann's first side lobe (−31 dB) of what stands within so many lines, or than
# the side lobes beyond them, is not one that was asked for: it leaked.
LEAKED, FAR_LEAKED, NEAR_LINES = 1e-3, 1e-6, 10
LEAST_PIECES = 8
# Pieces under Hann's window that overlap by half count for so many independent ones each (Welch 1967: 1/(1 + 2/36)).
INDEPENDENT = 18 / 19
# A line of the multisine whose partial coherence chance alone reaches this often is no point.
CHANCE = 0.01
LEVEL = 1.96
# An instrument this weak (Staiger and Stock 1997: F below 10) would leave the bias in that it is there to take out.
STRONG = 10.0


@dataclass(frozen=True)
class Piece:
    """A stretch of a multisine, arrays (n,): command, velocity [rad/s], torque [N m], and the velocity asked for."""

    command: FloatArray
    velocity_rad_s: FloatArray
    torque_nm: FloatArray
    reference_rad_s: FloatArray


@dataclass(frozen=True)
class Transfer:
    """From one input to the torque, arrays (frequencies,): where something can be told. ``half_width`` is half of the
    95 % interval of the magnitude, ``coherence`` the share of the torque that goes with this input, the other's part
    taken off both."""

    frequency_hz: FloatArray
    response: ComplexArray
    half_width: FloatArray
    coherence: FloatArray


@dataclass(frozen=True)
class Spectra:
    """``torque`` is torque over command [N m per its unit], ``impedance`` torque over velocity [N m s/rad], less the
    sign: what it takes to move the port. ``velocity_rms_rad_s`` is how fast that was; ``averages`` the pieces."""

    torque: Transfer
    impedance: Transfer
    velocity_rms_rad_s: float
    averages: int


def spectra(pieces: Sequence[Piece], tick_s: float, delay_s: float) -> Spectra | None:
    """Of imposed multisines under a command; None where they are too short, or nothing stands out.

    ``delay_s`` is by how much the torque comes later than the command on the wires: it is no phase of the machine.
    """
    long = [piece for piece in pieces if piece.command.size * tick_s >= PIECE_S]
    if not long:
        return None
    every = np.concatenate([_periodograms(_signals(piece), tick_s) for piece in long], axis=2)
    averages = every.shape[2]
    if averages < LEAST_PIECES:
        return None
    cross = np.einsum("ifk,jfk->fij", every, every.conj()) / averages
    frequency_hz = np.asarray(np.fft.rfftfreq(round(PIECE_S / tick_s), tick_s), dtype=np.float64)
    torque, motion = _paths(frequency_hz, cross, averages * INDEPENDENT)
    if not torque.frequency_hz.size and not motion.frequency_hz.size:
        return None
    velocity_rms = float(np.sqrt(np.mean(np.concatenate([piece.velocity_rad_s for piece in long]) ** 2)))
    advanced = replace(torque, response=torque.response * np.exp(2j * pi * torque.frequency_hz * delay_s))
    return Spectra(advanced, replace(motion, response=-motion.response), velocity_rms, averages)


def torque_line(network: NortonNetwork, frequency_hz: FloatArray) -> ComplexArray:
    """Torque over command with the port held, as the network has it: a first-order lag."""
    s, beta = 2j * pi * frequency_hz, network.amplifier_bandwidth_rad_s
    return np.asarray(network.torque_gain * beta / (s + beta))


def impedance_line(network: NortonNetwork, frequency_hz: FloatArray, velocity_rms_rad_s: float) -> ComplexArray:
    """The best linear approximation of the network's impedance while it slides back and forth [N m s/rad].

    Under a velocity that is normally distributed, as a multisine's nearly is, friction τc·sgn ω looks like a damping of
    √(2/π)·τc/σ_ω (Bussgang 1952; Pintelon and Schoukens, "System Identification", 2nd edition, chapter 3).
    By the same average E[R(ω)·ω]/σ_ω², Stribeck's friction is 1/(1 + 2(σ_ω/v_s)²) of what it would be if it did not
    fade, and quadratic drag D looks like a damping of 2·√(2/π)·D·σ_ω. Other terms average to nothing, but for friction
    that grows with the torque at the port, which is not in it.
    """
    row, jump = network.row, sqrt(2 / pi) * network.coulomb_torque_nm / velocity_rms_rad_s
    friction = jump * (1.0 + row[STRIBECK] / (1.0 + 2.0 * (velocity_rms_rad_s / row[STRIBECK_VELOCITY]) ** 2))
    damping = network.viscous_damping_nms_rad * (1.0 + 2.0 * sqrt(2 / pi) * row[DRAG] * velocity_rms_rad_s)
    s = 2j * pi * frequency_hz
    return np.asarray(s * network.inertia_kgm2 + damping + friction)


def contact_line(network: NortonNetwork, frequency_hz: FloatArray) -> ComplexArray:
    """The impedance to motions so small that the contact does not slide [N m s/rad]."""
    s = 2j * pi * frequency_hz
    contact = network.presliding_damping_nms_rad + network.presliding_stiffness_nm_rad / s
    return np.asarray(s * network.inertia_kgm2 + network.viscous_damping_nms_rad + contact)


def _signals(piece: Piece) -> FloatArray:
    """Inputs, torque, instruments: (signals, n). The command, which no noise reaches, is its own instrument."""
    return np.stack([piece.command, piece.velocity_rad_s, piece.torque_nm, piece.command, piece.reference_rad_s])


def _periodograms(signals: FloatArray, tick_s: float) -> ComplexArray:
    """Windowed pieces of signals (signals, n), (signals, frequencies, pieces); each piece without its mean."""
    length = round(PIECE_S / tick_s)
    window = ShortTimeFFT(hann(length, sym=False), length // 2, 1.0 / tick_s)
    first, last = window.lower_border_end[1], window.upper_border_begin(signals.shape[1])[1]
    return np.asarray(window.stft_detrend(signals, "constant", p0=first, p1=max(first + 1, last)))


def _paths(frequency_hz: FloatArray, cross: ComplexArray, averages: float) -> tuple[Transfer, Transfer]:
    """``cross`` (frequencies, 5, 5) are the averaged products of inputs, torque and instruments."""
    # The first lines of a piece hold what its mean leaked into them.
    told = np.flatnonzero((_strength(cross, averages) > STRONG) & (frequency_hz > 1.5 / PIECE_S))
    cross, freedom = cross[told], averages - 2
    inputs, instruments = cross[:, INPUTS, INPUTS], cross[:, ASKED, ASKED]
    inverse = np.linalg.inv(cross[:, INPUTS, ASKED])
    response = np.einsum("fj,fji->fi", cross[:, TORQUE, ASKED], inverse)
    explained = np.einsum("fi,fi->f", response, cross[:, INPUTS, TORQUE]).real
    both = np.einsum("fi,fij,fj->f", response, inputs, response.conj()).real
    left = np.maximum(cross[:, TORQUE, TORQUE].real - 2 * explained + both, 0.0) * averages / freedom
    own = np.einsum("fji,fjk,fki->fi", inverse.conj(), instruments.conj(), inverse).real / averages
    paths = [_path(frequency_hz[told], response[:, k], left * own[:, k], averages) for k in range(2)]
    return paths[0], paths[1]


def _path(frequency_hz: FloatArray, response: ComplexArray, variance: FloatArray, averages: float) -> Transfer:
    """``variance`` is that of the complex response; its real and imaginary part share it evenly."""
    power = np.abs(response) ** 2
    clear = f_tail(power / np.maximum(variance, 1e-300), 2, 2 * (averages - 2)) < CHANCE
    coherence = power / (power + averages * variance)
    return Transfer(frequency_hz[clear], response[clear], LEVEL * np.sqrt(variance[clear] / 2), coherence[clear])


def _strength(cross: ComplexArray, averages: float) -> FloatArray:
    """F of the reference motion for the measured velocity, with what the command explains taken off both; 0 where one
    of the instruments is silent."""
    c, v, r = 0, 1, 4
    command = np.maximum(cross[:, c, c].real, 0.0)
    loud = _asked(command) & _asked(cross[:, r, r].real)
    command = np.where(loud, command, 1.0)
    velocity = cross[:, v, v].real - np.abs(cross[:, v, c]) ** 2 / command
    reference = cross[:, r, r].real - np.abs(cross[:, r, c]) ** 2 / command
    shared = np.abs(cross[:, v, r] - cross[:, v, c] * cross[:, c, r] / command) ** 2
    coherence = np.clip(shared / np.maximum(velocity * reference, 1e-300), 0.0, 1.0 - 1e-12)
    return np.where(loud, coherence / (1.0 - coherence) * (averages - 2), 0.0)


def _asked(power: FloatArray) -> npt.NDArray[np.bool_]:
    """Which lines an instrument has of its own."""
    near = maximum_filter1d(power, 2 * NEAR_LINES + 1)
    return np.asarray((power > LEAKED * near) & (power > FAR_LEAKED * np.max(power)))
