"""The compiled inner loops of the identification: resampling, filtering, the amplifier's lag, the friction's path."""

from math import exp

import numpy as np
from numba import njit

from norton_bench.arrays import ComplexArray, FloatArray, IntArray

# A sum that may be taken in any order takes several terms at a time; NaN and infinity stay what they are.
SUM_IN_ANY_ORDER = {"reassoc", "contract"}


@njit(cache=True, nogil=True, inline="always")
def _looked_up(table: FloatArray, point: float) -> float:
    """A kernel in a table, at so many points from its middle."""
    at = min(abs(point), table.size - 2.0)
    index = int(at)
    return float(table[index] + (at - index) * (table[index + 1] - table[index]))


@njit(cache=True, nogil=True, inline="always")
def _moved_on(times: FloatArray, at: float, reach_s: float, first: int, after: int) -> tuple[int, int]:
    """The first reading within ``reach_s`` of ``at``, and that after the last: from those of an earlier instant."""
    while first < times.size - 1 and times[first] < at - reach_s:
        first += 1
    while after < times.size and times[after] <= at + reach_s:
        after += 1
    return first, after


@njit(cache=True, nogil=True)
def resample(
    times: FloatArray, values: FloatArray, period: float, grid: FloatArray, table: FloatArray, per_unit: int
) -> FloatArray:
    """Values at ``grid`` from readings at ``times`` (sorted), by the symmetric kernel in ``table``.

    ``table`` holds the kernel at ``per_unit`` points a period. Sums run over differences from the nearest reading, so
    that a position far from zero loses no digits.
    """
    points_s = per_unit / period
    reach_s = (table.size - 2) / points_s
    output = np.empty(grid.size)
    first, after = 0, 0
    for k in range(grid.size):
        first, after = _moved_on(times, grid[k], reach_s, first, after)
        reference = values[first]
        total, weighted = 0.0, 0.0
        for i in range(first, after):
            weight = _looked_up(table, (times[i] - grid[k]) * points_s)
            total += weight
            weighted += weight * (values[i] - reference)
        output[k] = reference + weighted / total if total > 0.2 else np.nan
    return output


@njit(cache=True, nogil=True)
def resample_both(
    times: FloatArray,
    values: FloatArray,
    others: FloatArray,
    period: float,
    grid: FloatArray,
    table: FloatArray,
    per_unit: int,
) -> FloatArray:
    """The same of two streams read at the same instants, (2, grid), in little more time than of one."""
    points_s = per_unit / period
    reach_s = (table.size - 2) / points_s
    output = np.empty((2, grid.size))
    first, after = 0, 0
    for k in range(grid.size):
        first, after = _moved_on(times, grid[k], reach_s, first, after)
        reference, other = values[first], others[first]
        total, weighted, of_others = 0.0, 0.0, 0.0
        for i in range(first, after):
            weight = _looked_up(table, (times[i] - grid[k]) * points_s)
            total += weight
            weighted += weight * (values[i] - reference)
            of_others += weight * (others[i] - other)
        output[0, k] = reference + weighted / total if total > 0.2 else np.nan
        output[1, k] = other + of_others / total if total > 0.2 else np.nan
    return output


@njit(cache=True, nogil=True, fastmath=SUM_IN_ANY_ORDER)
def filter_at(values: FloatArray, taps: FloatArray, first: int, stride: int, count: int) -> FloatArray:
    """``out[q, k] = Σ_j taps[q, j] · values[first + k·stride + j]``, shape (q, count); the ends repeat."""
    filters, length = taps.shape
    output = np.empty((filters, count))
    last = values.size - 1
    for k in range(count):
        start = first + k * stride
        inside = start >= 0 and start + length - 1 <= last
        for q in range(filters):
            total = 0.0
            if inside:
                for j in range(length):
                    total += taps[q, j] * values[start + j]
            else:
                for j in range(length):
                    total += taps[q, j] * values[min(max(start + j, 0), last)]
            output[q, k] = total
    return output


@njit(cache=True, nogil=True, inline="always")
def _kept(way: float) -> tuple[float, float]:
    """What is left of a difference after a ``way``, and its mean on the way."""
    retained = exp(-way)
    return retained, (1.0 - retained) / way if way > 1e-6 else 1.0 - 0.5 * way


@njit(cache=True, nogil=True)
def lag_of_held(
    sent: FloatArray, command: FloatArray, bandwidth: float, grid: FloatArray, released: bool = False
) -> FloatArray:
    """A first-order lag of a command held from each instant in ``sent`` on, exactly, at the times in ``grid``.

    Before the first instant the lag is taken as settled at the first command. With ``released`` a command of zero ends
    it at once, as a drive does that then switches its bridge off.
    """
    output = np.empty(grid.size)
    state, held, now, event = command[0], command[0], grid[0], 0
    for k in range(grid.size):
        while event < sent.size and sent[event] <= grid[k]:
            if sent[event] > now:
                state = held + (state - held) * exp(-bandwidth * (sent[event] - now))
                now = sent[event]
            held = command[event]
            if released and held == 0.0:
                state = 0.0
            event += 1
        state = held + (state - held) * exp(-bandwidth * (grid[k] - now))
        now = grid[k]
        output[k] = state
    return output


@njit(cache=True, nogil=True)
def lag_of(values: FloatArray, turn: float) -> FloatArray:
    """A first-order lag of a signal that is straight between its samples (n,), exactly at them; settled at the first.

    ``turn`` is the bandwidth by the time between two samples.
    """
    output = np.empty(values.size)
    state, before = values[0], values[0]
    kept, mean = _kept(turn)
    for k in range(values.size):
        state = kept * state + (mean - kept) * before + (1.0 - mean) * values[k]
        before = values[k]
        output[k] = state
    return output


@njit(cache=True, nogil=True)
def mean_lag_of_held(
    sent: FloatArray,
    command: FloatArray,
    bandwidth: float,
    start: float,
    cell: float,
    count: int,
    released: bool = False,
) -> FloatArray:
    """The exact mean of the same lag over each cell of time; cell k is centred at ``start + k · cell``."""
    output = np.empty(count)
    now, event = start - 0.5 * cell, 0
    state, held = command[0], command[0]
    while event < sent.size and sent[event] <= now:
        held = command[event]
        state = held
        event += 1
    whole = exp(-bandwidth * cell)
    mean_of_whole = (1.0 - whole) / (bandwidth * cell)
    for k in range(count):
        end, area = start + (k + 0.5) * cell, 0.0
        if event == sent.size or sent[event] > end:
            # Nothing arrives, as in most cells.
            output[k] = held + (state - held) * mean_of_whole
            state, now = held + (state - held) * whole, end
            continue
        while now < end:
            arrived = event < sent.size and sent[event] <= end
            until = sent[event] if arrived else end
            retained = exp(-bandwidth * (until - now))
            area += held * (until - now) + (state - held) * (1.0 - retained) / bandwidth
            state = held + (state - held) * retained
            now = until
            if arrived:
                held = command[event]
                if released and held == 0.0:
                    state = 0.0
                event += 1
        output[k] = area / cell
    return output


@njit(cache=True, nogil=True)
def _turning(
    output: FloatArray, k: int, way: float, bend: float, s: float, strength: float, h: float, left: float
) -> tuple[float, float]:
    """A step within which the path turns round: its halves parted once more, before and behind the turn."""
    turn = 0.5 - way / bend
    first, second = min(turn, 0.5), max(turn, 0.5)
    u = 0.0
    for v in (first, second, 1.0):
        if v <= u:
            continue
        displacement = way * (v - u) + 0.5 * bend * ((v * v - v) - (u * u - u))
        retained, mean = _kept(s * abs(displacement))
        side = strength if displacement > 0.0 else -strength
        cell = k - 1 if u < 0.5 else k
        output[0, cell] += (v - u) * (side + (h - side) * mean)
        output[1, cell] += (v - u) * left * mean
        h, left = side + (h - side) * retained, left * retained
        u = v
    return h, left


@njit(cache=True, nogil=True)
def friction_path_of(position: FloatArray, s: float, starts: IntArray, strengths: FloatArray) -> FloatArray:
    """The sliding share h = s·φ of the Dahl friction along a path, shape (2, n), each in -γ .. γ.

    ``strengths`` (n,) is γ: the strength at k holds for the step that leads there. One value holds throughout.

    Values are means over cells of time centred at the samples, with the path a parabola between samples: where it turns
    round, what it travels beyond them counts. Row 0 begins at h = 0; row 1 is what is left of a difference of 1 in h
    since the last of ``starts`` (the flow is affine in h, so any other start is row 0 plus its multiple of row 1).
    """
    output = np.zeros((2, position.size))
    h, left, event, many = 0.0, 1.0, 0, strengths.size > 1
    for k in range(position.size):
        if k > 0:
            strength = strengths[k] if many else strengths[0]
            slope = s / strength
            way = position[k] - position[k - 1]
            bend = 0.0
            if 1 < k < position.size - 1:
                bend = 0.5 * (position[k + 1] - position[k] - position[k - 1] + position[k - 2])
            if abs(way) >= 0.5 * abs(bend):
                # Its halves, for the cells on either side.
                retained, mean = _kept(0.5 * slope * abs(way))
                side = strength if way > 0.0 else -strength
                for cell in (k - 1, k):
                    output[0, cell] += 0.5 * (side + (h - side) * mean)
                    output[1, cell] += 0.5 * left * mean
                    h, left = side + (h - side) * retained, left * retained
            else:
                h, left = _turning(output, k, way, bend, slope, strength, h, left)
        if event < starts.size and starts[event] == k:
            output[1, k], left = 0.5, 1.0
            event += 1
    for edge in (0, -1):
        output[0, edge] *= 2.0
        output[1, edge] *= 2.0
    return output


EVEN = np.ones(1)


def friction_path(position: FloatArray, s: float, starts: IntArray) -> FloatArray:
    """The same of a contact as strong everywhere as the Coulomb torque: h in -1 .. 1."""
    return np.asarray(friction_path_of(position, s, starts, EVEN))


@njit(cache=True, nogil=True)
def later(values: FloatArray, cells: float) -> FloatArray:
    """``values`` (n,) so many cells later, straight in between; the ends are held."""
    output = np.empty(values.size)
    last = values.size - 1
    for k in range(values.size):
        at = min(max(k + cells, 0.0), float(last))
        index = min(int(at), last - 1)
        output[k] = values[index] + (at - index) * (values[index + 1] - values[index])
    return output


@njit(cache=True, nogil=True, fastmath=SUM_IN_ANY_ORDER)
def without_memory(values: FloatArray, left: FloatArray, edges: IntArray, power: FloatArray) -> FloatArray:
    """What no multiple of ``left`` could have made of ``values`` (rows, n) between each two of ``edges``."""
    output = np.empty_like(values)
    for row in range(values.shape[0]):
        for rest in range(power.size):
            total = 0.0
            for k in range(edges[rest], edges[rest + 1]):
                total += values[row, k] * left[k]
            factor = total / power[rest]
            for k in range(edges[rest], edges[rest + 1]):
                output[row, k] = values[row, k] - factor * left[k]
    return output


@njit(cache=True, nogil=True)
def kalman_gains(kept: FloatArray, kicks: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of a filter of one state behind rows with noise of variance 1: its gains, and 1 over the innovations' widths."""
    gain, scale = np.empty(kept.size), np.empty(kept.size)
    variance = 0.0
    for k in range(kept.size):
        variance = variance * kept[k] ** 2 + kicks[k]
        gain[k] = variance / (variance + 1.0)
        scale[k] = 1.0 / np.sqrt(variance + 1.0)
        variance = gain[k]
    return gain, scale


@njit(cache=True, nogil=True)
def innovations(values: FloatArray, kept: FloatArray, gain: FloatArray, scale: FloatArray) -> FloatArray:
    """What such a filter does not predict of each row of ``values`` (rows, n), scaled."""
    output = np.empty_like(values)
    state = np.zeros(values.shape[0])
    for k in range(kept.size):
        for row in range(values.shape[0]):
            predicted = state[row] * kept[k]
            error = values[row, k] - predicted
            output[row, k] = error * scale[k]
            state[row] = predicted + gain[k] * error
    return output


@njit(cache=True, nogil=True)
def delayed(spectrum: ComplexArray, turn_rad: float) -> ComplexArray:
    """A spectrum (n,) of a signal that comes later, by this angle more at each frequency than at the one before."""
    output, turn, turned = np.empty_like(spectrum), np.exp(-1j * turn_rad), 1.0 + 0.0j
    for k in range(spectrum.size):
        output[k] = spectrum[k] * turned
        turned *= turn
    return output


@njit(cache=True, nogil=True)
def oscillator_with_contact(driving: FloatArray, across: FloatArray, contact: FloatArray, substeps: int) -> FloatArray:
    """Displacement and velocity (2, n) of an oscillator, driven by an acceleration (n,), that a friction contact holds.

    The acceleration is a line within a step, and ``across`` (2, 4) takes displacement, velocity and the acceleration at
    both ends across one of the ``substeps`` of a step. ``contact`` (n - 1, 4) is what the contact does within half a
    substep of each step: what is left of its deflection and what the velocity adds to it, what is left of the velocity
    and what the deflection takes off it. One half lies before, one after the oscillator's own substep (Strang, SIAM
    Journal on Numerical Analysis 5, 1968).
    """
    output = np.zeros((2, driving.size))
    place, speed, deflection = 0.0, 0.0, 0.0
    for k in range(driving.size - 1):
        left, added, kept, back = contact[k, 0], contact[k, 1], contact[k, 2], contact[k, 3]
        rise = (driving[k + 1] - driving[k]) / substeps
        for part in range(substeps):
            a, b = driving[k] + part * rise, driving[k] + (part + 1) * rise
            deflection = left * deflection + added * speed
            speed = kept * speed - back * deflection
            moved = across[0, 0] * place + across[0, 1] * speed + across[0, 2] * a + across[0, 3] * b
            speed = across[1, 0] * place + across[1, 1] * speed + across[1, 2] * a + across[1, 3] * b
            place = moved
            speed = kept * (speed - back * deflection)
            deflection = left * deflection + added * speed
        output[0, k + 1], output[1, k + 1] = place, speed
    return output


@njit(cache=True, nogil=True)
def friction_bank(position: FloatArray, last: float, s: FloatArray, h: FloatArray) -> FloatArray:
    """The sliding shares of many frictions along one path, shape (members, n), going on from ``h``, in place."""
    output = np.empty((s.size, position.size))
    for k in range(position.size):
        displacement = position[k] - last
        last = position[k]
        side = 1.0 if displacement > 0.0 else -1.0
        for member in range(s.size):
            h[member] = side + (h[member] - side) * exp(-s[member] * abs(displacement))
            output[member, k] = h[member]
    return output


@njit(cache=True, nogil=True)
def count_readings(lag: FloatArray, period: float) -> FloatArray:
    """Numbers of readings on their device's clock, (n,).

    ``lag`` [s] is how much later each came than by their count alone, without what was only late. A lost reading delays
    all that follow.
    """
    numbers = np.empty(lag.size)
    skipped, baseline = 0.0, lag[0]
    for k in range(lag.size):
        left = lag[k] - skipped * period
        lost = round((left - baseline) / period)
        if lost > 0:
            skipped += lost
            left -= lost * period
        # The two clocks drift apart slowly, and the period is not known to the last digit.
        baseline += 0.02 * (left - baseline)
        numbers[k] = k + skipped
    return numbers
