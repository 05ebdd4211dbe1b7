"""Excitations, known ahead tick by tick: multisines, staircases and smooth motions."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from norton_bench.arrays import FloatArray
from norton_bench.records import Measured
from norton_bench.rig.rig import Rig
from norton_bench.segments import PRESCRIBED_MOTION, ZERO_TORQUE, LoadMode, Segment, Use

# Level of clipping as a share of the peak; far below it works best from random phases.
CLIP_AT = 0.6
# Of the loop's rate, and at most: where multisines end.
HIGHEST_SHARE, HIGHEST_HZ = 0.2, 200.0
EDGE_S = 0.2  # duration of the speeding up and slowing down of a sweep
# Waves in the cache: a plan is made once to be checked and once more to be carried out.
CACHED_WAVES = 32


@dataclass(frozen=True)
class Motion:
    """A reference motion; arrays of shape (ticks,), position beginning at 0."""

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray

    def scaled(self, factor: float) -> "Motion":
        return Motion(self.position_rad * factor, self.velocity_rad_s * factor, self.acceleration_rad_s2 * factor)


def ticks_in(duration_s: float, tick_s: float) -> int:
    """At least one tick."""
    return max(1, round(duration_s / tick_s))


def hold(value: float, duration_s: float, tick_s: float) -> FloatArray:
    """The same value throughout."""
    return np.full(ticks_in(duration_s, tick_s), value)


def ramp(start: float, stop: float, duration_s: float, tick_s: float) -> FloatArray:
    """From ``start`` to ``stop`` along half a cosine: no step at either end."""
    phase = np.arange(1, ticks_in(duration_s, tick_s) + 1) / ticks_in(duration_s, tick_s)
    return start + (stop - start) * 0.5 * (1 - np.cos(np.pi * phase))


def growth(limit: float, duration_s: float, tick_s: float, *, decades: float = 2.0) -> FloatArray:
    """From ``limit`` / 10^decades up to ``limit``, by the same factor every second.

    A search by growth overshoots by a fixed share of its result, however small that is.
    """
    return limit * np.logspace(-decades, 0.0, ticks_in(duration_s, tick_s))


def staircase(levels: FloatArray, dwell_s: float, tick_s: float) -> FloatArray:
    """Each level held for ``dwell_s``."""
    return np.repeat(levels, ticks_in(dwell_s, tick_s))


def highest_hz(tick_s: float) -> float:
    """The highest frequency of a multisine: a fifth of the loop's rate, at most that of a loop at 1 kHz.

    Above, a bench has little response, and amplitude spent there is missing below.
    """
    return min(HIGHEST_SHARE / tick_s, HIGHEST_HZ)


@lru_cache(maxsize=CACHED_WAVES)
def multisine(
    duration_s: float,
    tick_s: float,
    *,
    low_hz: float,
    high_hz: float,
    seed: int,
    slope: float = 0.0,
    lines: int = 60,
    clippings: int = 0,
) -> FloatArray:
    """A multisine with peak 1 that begins and ends at zero; shape (ticks,).

    ``lines`` frequencies, evenly spread over the logarithm of frequency, with amplitudes ~ frequency^slope. Phases are
    random, and improved by so many ``clippings``: the wave has a low crest factor. The array is cached, and
    read-only.
    """
    time_s = _instants(duration_s, tick_s)
    frequency, amplitude, phase = _lines(low_hz, high_hz, seed, slope, lines)
    if clippings:
        phase = flat_phases(frequency, amplitude, phase, time_s, clippings)
    wave = amplitude @ np.sin(2 * np.pi * np.outer(frequency, time_s) + phase[:, None])
    wave = wave * _window(time_s, duration_s)[0]
    return _read_only(wave / np.max(np.abs(wave)))


@lru_cache(maxsize=CACHED_WAVES)
def multisine_motion(
    duration_s: float, tick_s: float, *, low_hz: float, high_hz: float, seed: int, slope: float = 0.0, lines: int = 40
) -> Motion:
    """A multisine motion with a peak velocity of 1 rad/s; ``slope`` shapes the velocity's spectrum. Cached and
    read-only.
    """
    time_s = _instants(duration_s, tick_s)
    frequency, amplitude, phase = _lines(low_hz, high_hz, seed, slope, lines)
    omega = 2 * np.pi * frequency
    angle = np.outer(omega, time_s) + phase[:, None]
    position = (amplitude / omega) @ np.sin(angle)
    velocity = amplitude @ np.cos(angle)
    acceleration = -(amplitude * omega) @ np.sin(angle)
    # The window multiplies the position; product rule, so that the three stay exact derivatives of each other.
    w, w1, w2 = _window(time_s, duration_s)
    motion = Motion(w * position, w1 * position + w * velocity, w2 * position + 2 * w1 * velocity + w * acceleration)
    unit = motion.scaled(1.0 / np.max(np.abs(motion.velocity_rad_s)))
    return Motion(_read_only(unit.position_rad), _read_only(unit.velocity_rad_s), _read_only(unit.acceleration_rad_s2))


def _read_only(values: FloatArray) -> FloatArray:
    """The same array, which can no longer be written to."""
    values.setflags(write=False)
    return values


def flat_phases(
    frequency_hz: FloatArray, amplitude: FloatArray, phase: FloatArray, time_s: FloatArray, clippings: int
) -> FloatArray:
    """Phases, shape (lines,), with which the sum of sines has a low crest.

    The wave is clipped, the clipped wave's phases are kept and the amplitudes put back, again and again (Van der
    Ouderaa, Schoukens and Renneboog, IEEE Trans. Instrum. Meas. 37(1), 1988). The flattest wave met on the way counts.
    """
    angle = 2 * np.pi * np.outer(frequency_hz, time_s)
    sine, cosine = np.sin(angle), np.cos(angle)
    best, least = phase, np.inf
    for _ in range(clippings + 1):
        wave = (amplitude * np.cos(phase)) @ sine + (amplitude * np.sin(phase)) @ cosine
        peak = float(np.max(np.abs(wave)))
        if peak < least:
            best, least = phase, peak
        clipped = np.clip(wave, -CLIP_AT * peak, CLIP_AT * peak)
        phase = np.arctan2(cosine @ clipped, sine @ clipped)
    return best


def velocity_steps(velocities_rad_s: FloatArray, change_s: float, dwell_s: float, tick_s: float) -> Motion:
    """From rest through each velocity, held for ``dwell_s``, and back to rest, changing along half cosines."""
    stops = np.concatenate([[0.0], velocities_rad_s, [0.0]])
    velocity = np.concatenate(
        [
            np.concatenate([ramp(before, after, change_s, tick_s), hold(after, dwell_s, tick_s)])
            for before, after in pairwise(stops)
        ]
    )
    return from_velocity(velocity, tick_s)


def sine_motion(amplitude_rad: float, frequency_hz: float, cycles: int, tick_s: float) -> Motion:
    """``cycles`` of a sine that fades in over the first and out over the last cycle."""
    duration_s = cycles / frequency_hz
    time_s = _instants(duration_s, tick_s)
    omega = 2 * np.pi * frequency_hz
    w, w1, w2 = _window(time_s, duration_s, fade_s=1 / frequency_hz)
    position = amplitude_rad * np.sin(omega * time_s)
    velocity = amplitude_rad * omega * np.cos(omega * time_s)
    acceleration = -(omega**2) * position
    return Motion(w * position, w1 * position + w * velocity, w2 * position + 2 * w1 * velocity + w * acceleration)


def sines_motion(frequency_hz: FloatArray, amplitude_rad: FloatArray, duration_s: float, tick_s: float) -> Motion:
    """Sines that fade in and out together, of phases that keep the peak low; ``frequency_hz`` has shape (lines,)."""
    time_s = _instants(duration_s, tick_s)
    omega = 2 * np.pi * frequency_hz
    phase = -np.pi * np.arange(omega.size) * (np.arange(omega.size) - 1) / omega.size  # Schroeder's
    angle = np.outer(omega, time_s) + phase[:, None]
    position = amplitude_rad @ np.sin(angle)
    velocity = (amplitude_rad * omega) @ np.cos(angle)
    acceleration = -(amplitude_rad * omega**2) @ np.sin(angle)
    w, w1, w2 = _window(time_s, duration_s)
    return Motion(w * position, w1 * position + w * velocity, w2 * position + 2 * w1 * velocity + w * acceleration)


def displaced(displacement_rad: float, duration_s: float, tick_s: float) -> Motion:
    """From rest to rest over a displacement, along 10p³ − 15p⁴ + 6p⁵."""
    p = np.arange(1, ticks_in(duration_s, tick_s) + 1) / ticks_in(duration_s, tick_s)
    return Motion(
        displacement_rad * p**3 * (10 - 15 * p + 6 * p**2),
        displacement_rad / duration_s * 30 * p**2 * (1 - p) ** 2,
        displacement_rad / duration_s**2 * 60 * p * (1 - p) * (1 - 2 * p),
    )


def sweep(distance_rad: float, speed_rad_s: float, tick_s: float) -> Motion:
    """A motion over a distance at constant speed, with ramps of speed before and after."""
    fastest_rad_s = abs(distance_rad) / (2 * EDGE_S)
    speed = float(np.copysign(min(speed_rad_s, fastest_rad_s), distance_rad))
    steady = hold(speed, distance_rad / speed - EDGE_S if speed else EDGE_S, tick_s)
    edges = ramp(0.0, speed, EDGE_S, tick_s), ramp(speed, 0.0, EDGE_S, tick_s)
    return from_velocity(np.concatenate([edges[0], steady, edges[1]]), tick_s)


def from_velocity(velocity_rad_s: FloatArray, tick_s: float) -> Motion:
    """The motion with this velocity (trapezoidal integral, central derivative)."""
    middle = 0.5 * (velocity_rad_s[1:] + velocity_rad_s[:-1]) * tick_s
    return Motion(np.concatenate([[0.0], np.cumsum(middle)]), velocity_rad_s, np.gradient(velocity_rad_s, tick_s))


def _instants(duration_s: float, tick_s: float) -> FloatArray:
    return np.asarray(np.arange(ticks_in(duration_s, tick_s)) * tick_s, dtype=np.float64)


def _lines(low_hz: float, high_hz: float, seed: int, slope: float, count: int) -> tuple[FloatArray, ...]:
    random = np.random.default_rng(seed)
    # Each line is shifted at random within its share of the band, so that no line is a harmonic of another.
    edges = np.geomspace(low_hz, high_hz, count + 1)
    frequency = edges[:-1] * (edges[1:] / edges[:-1]) ** random.random(count)
    return frequency, (frequency / low_hz) ** slope, random.uniform(0, 2 * np.pi, count)


def _window(time_s: FloatArray, duration_s: float, fade_s: float = 0.25) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A window that rises and falls as 10p³ − 15p⁴ + 6p⁵ over ``fade_s``, with its first two derivatives."""
    fade_s = min(fade_s, duration_s / 2)
    rising, falling = time_s / fade_s, (duration_s - time_s) / fade_s
    p = np.clip(np.minimum(rising, falling), 0.0, 1.0)
    sign = np.where(rising <= falling, 1.0, -1.0)
    inside = p < 1.0
    value = p**3 * (10 - 15 * p + 6 * p**2)
    first = np.where(inside, sign * 30 * p**2 * (1 - p) ** 2 / fade_s, 0.0)
    second = np.where(inside, 60 * p * (1 - p) * (1 - 2 * p) / fade_s**2, 0.0)
    return value, first, second


UNENDING = float("inf")
SLOWLY = 3.0  # times as long as the rest that follows


def coasting(
    procedure: str, name: str, use: Use, command: FloatArray, *, stop_at_velocity_rad_s: float = UNENDING
) -> Segment:
    """A segment where the load coasts, or without a load."""
    return Segment(procedure, name, use, command, stop_at_velocity_rad_s=stop_at_velocity_rad_s)


def pushed(
    procedure: str,
    name: str,
    use: Use,
    load_torque_nm: FloatArray,
    command: FloatArray | None = None,
    *,
    stop_at_velocity_rad_s: float = UNENDING,
) -> Segment:
    """A segment where the load follows a torque, the actuator its command (none: zero)."""
    return Segment(
        procedure,
        name,
        use,
        command if command is not None else np.zeros(len(load_torque_nm)),
        LoadMode.TORQUE,
        load_torque_nm=load_torque_nm,
        stop_at_velocity_rad_s=stop_at_velocity_rad_s,
    )


def back(procedure: str, name: str, rig: Rig, before: Measured, duration_s: float) -> Segment:
    """Both drives go from where they were to zero, and rest for ``duration_s``.

    At once for a motor, which then coasts; slowly otherwise: an actuator without a model may be a spring, a pendulum,
    or a positioner.
    """
    if rig.is_motor or not len(before.ticks):
        return coasting(procedure, name, Use.PREPARE, hold(0.0, duration_s, rig.tick_s))
    last = before.ticks[-1]
    still = hold(0.0, duration_s, rig.tick_s)
    load_nm, command = (
        np.concatenate([ramp(float(last[column]), 0.0, SLOWLY * duration_s, rig.tick_s), still])
        for column in ("load_torque_nm", "command")
    )
    if rig.wiring.load is None:
        return coasting(procedure, name, Use.PREPARE, command)
    return pushed(procedure, name, Use.PREPARE, load_nm, command)


def zero_torque(
    procedure: str,
    name: str,
    use: Use,
    command: FloatArray,
    rig: Rig,
    *,
    stop_at_velocity_rad_s: float = UNENDING,
) -> Segment:
    """Zero torque at the port: imposed by the load drive, or because nothing is on the shaft."""
    if rig.wiring.load is None:
        return coasting(procedure, name, use, command, stop_at_velocity_rad_s=stop_at_velocity_rad_s)
    return Segment(
        procedure,
        name,
        use,
        command,
        LoadMode.ADMITTANCE,
        ZERO_TORQUE,
        stop_at_velocity_rad_s=stop_at_velocity_rad_s,
    )


def imposed(procedure: str, name: str, use: Use, command: FloatArray, motion: Motion | None = None) -> Segment:
    """Prescribed motion at the port; None holds it still."""
    still = np.zeros(len(command))
    reference = motion if motion is not None else Motion(still, still, still)
    return Segment(
        procedure,
        name,
        use,
        command,
        LoadMode.ADMITTANCE,
        PRESCRIBED_MOTION,
        reference.position_rad,
        reference.velocity_rad_s,
        reference.acceleration_rad_s2,
    )
