"""The compiled operators of friction that remembers: exact along a path of straight steps, at any sample rate.

Arrays are (n,). A contact's state is the share h of its strength in use; ``deflection`` is the displacement over which
it would come into full use. ``begin`` holds the share at which a stretch begins, NaN where one goes on.
"""

from math import exp, isnan, log, pi, sin

import numpy as np
from numba import njit
from scipy.optimize import nnls

from norton_bench.arrays import BoolArray, FloatArray, IntArray

# Of the elasto-plastic flow: nodes of its table, in the logarithm of what is left to full sliding.
NODE = 0.02
NODES = 1500


@njit(cache=True, nogil=True)
def bristle(position: FloatArray, begin: FloatArray, strength: FloatArray, deflection: float) -> FloatArray:
    """Dahl's and LuGre's contact: ``dh/dx = (1 − s h/γ)/deflection``, s the side moved to, γ the ``strength``.

    The strength at k holds for the step that leads there.
    """
    share = np.zeros(position.size)
    h = 0.0
    for k in range(position.size):
        if not isnan(begin[k]):
            h = begin[k]
        else:
            step = position[k] - position[k - 1]
            goal = strength[k] if step > 0.0 else -strength[k]
            h = goal + (h - goal) * exp(-abs(step) / (deflection * strength[k]))
        share[k] = h
    return share


@njit(cache=True, nogil=True)
def stops(position: FloatArray, begin: FloatArray, deflections: FloatArray) -> FloatArray:
    """Elements that stick elastically and slip beyond their deflection (Prandtl), shape (elements, n)."""
    share = np.zeros((deflections.size, position.size))
    for element in range(deflections.size):
        h, stiffness = 0.0, 1.0 / deflections[element]
        for k in range(position.size):
            going_on = isnan(begin[k])
            h = min(max(h + (position[k] - position[k - 1]) * stiffness, -1.0), 1.0) if going_on else begin[k]
            share[element, k] = h
    return share


@njit(cache=True, nogil=True)
def plasticity(share: float, breakaway: float) -> float:
    """Dupont's α for a share of the steady deflection, in the direction of motion: 0 elastic, 1 plastic."""
    if share <= breakaway:
        return 0.0
    if share >= 1.0:
        return 1.0
    return 0.5 + 0.5 * sin(pi * (share - 0.5 * (1.0 + breakaway)) / (1.0 - breakaway))


@njit(cache=True, nogil=True)
def travel_table(breakaway: float) -> FloatArray:
    """Travel, in deflections, from breakaway to each node of w = −log[(1 − u)/(1 − breakaway)], shape (NODES,)."""
    travel = np.zeros(NODES)
    # At breakaway nothing slips yet: du/dξ is 1.
    before = 1.0 - breakaway
    for node in range(1, NODES):
        left = (1.0 - breakaway) * exp(-node * NODE)
        slope = left / (1.0 - plasticity(1.0 - left, breakaway) * (1.0 - left))
        travel[node] = travel[node - 1] + 0.5 * NODE * (before + slope)
        before = slope
    return travel


@njit(cache=True, nogil=True)
def advance(share: float, travel: float, breakaway: float, table: FloatArray) -> float:
    """The flow of ``du/dξ = 1 − α(u) u`` over ``travel`` deflections towards sliding."""
    if share >= 1.0:
        return 1.0 + (share - 1.0) * exp(-travel)
    if share < breakaway:
        elastic = breakaway - share
        if travel <= elastic:
            return share + travel
        share, travel = breakaway, travel - elastic
    w = log((1.0 - breakaway) / (1.0 - share))
    at = w / NODE
    node = int(at)
    if node >= NODES - 1:
        return 1.0 - (1.0 - share) * exp(-travel)
    reached = table[node] + (at - node) * (table[node + 1] - table[node]) + travel
    if reached >= table[-1]:
        return 1.0 - (1.0 - breakaway) * exp(-(NODES - 1) * NODE - (reached - table[-1]))
    node = int(np.searchsorted(table, reached, side="right")) - 1
    w = (node + (reached - table[node]) / (table[node + 1] - table[node])) * NODE
    return 1.0 - (1.0 - breakaway) * exp(-w)


@njit(cache=True, nogil=True)
def elasto_plastic(position: FloatArray, begin: FloatArray, deflection: float, breakaway: float) -> FloatArray:
    """Dupont's contact: purely elastic below ``breakaway`` (a share of the steady deflection), so that it never drifts.

    Returns h and α, shape (2, n).
    """
    table = travel_table(breakaway)
    output = np.zeros((2, position.size))
    h = 0.0
    for k in range(position.size):
        if not isnan(begin[k]):
            h = begin[k]
            output[0, k], output[1, k] = h, plasticity(abs(h), breakaway)
            continue
        step = position[k] - position[k - 1]
        side = 1.0 if step > 0.0 else -1.0
        share = advance(side * h, abs(step) / deflection, breakaway, table)
        h = side * share
        output[0, k], output[1, k] = h, plasticity(share, breakaway)
    return output


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _dot(a: FloatArray, b: FloatArray, first: int, end: int) -> float:
    total = 0.0
    for k in range(first, end):
        total += a[k] * b[k]
    return total


@njit(cache=True, nogil=True)
def part_sums(columns: FloatArray, target: FloatArray, part: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Normal equations over parts of the rows, compiled: they are summed for every shape that is tried.

    Over the rows of each part (numbered from 0, others left out): columns by columns, by target, target by target.

    ``columns`` (columns, n) and ``target`` (n,); shapes (parts, columns, columns), (parts, columns) and (parts,).
    """
    count = part.max() + 1
    size = columns.shape[0]
    gram = np.zeros((count, size, size))
    moment = np.zeros((count, size))
    power = np.zeros(count)
    first = 0
    while first < part.size:
        end = first + 1
        while end < part.size and part[end] == part[first]:
            end += 1
        which = part[first]
        if which >= 0:
            for i in range(size):
                for j in range(i + 1):
                    gram[which, i, j] += _dot(columns[i], columns[j], first, end)
                moment[which, i] += _dot(columns[i], target, first, end)
            power[which] += _dot(target, target, first, end)
        first = end
    for i in range(size):
        for j in range(i):
            gram[:, j, i] = gram[:, i, j]
    return gram, moment, power


# What may stand in an equation of motion beside friction, as linear columns: cogging, temperature, and hats for slow
# drift.
#
# Every column has the sign of what it takes off the exertion, and is on the path's own rate.
def cogging(position: FloatArray, period: float) -> dict[str, FloatArray]:
    """Exertion that repeats with the position, every ``period`` rad or m; arrays (n,)."""
    phase = 2 * np.pi * position / period
    return {"cogging_sine": -np.sin(phase), "cogging_cosine": -np.cos(phase)}


def linear_basis(time_s: FloatArray, knots: int) -> FloatArray:
    """Lines that are one at one of equally spaced knots and zero at all others, shape (knots, n)."""
    at_s = np.linspace(np.min(time_s), np.max(time_s), knots)
    return np.stack([np.interp(time_s, at_s, one) for one in np.eye(knots)])


def temperature(
    velocity: FloatArray, temperature_c: FloatArray, trained: BoolArray | slice = slice(None)
) -> dict[str, FloatArray]:
    """What a degree more than the mean of ``trained`` adds to friction, viscous and Coulomb: oil thins as it warms.

    Arrays (n,).
    """
    warmer = temperature_c - np.mean(temperature_c[trained])
    return {
        "viscous_damping_per_degree": -velocity * warmer,
        "coulomb_torque_per_degree": -np.sign(velocity) * warmer,
    }


# Directions that carry less than this share of the strongest say nothing.
WEAKEST = 1e-9
# A coefficient; columns nearly alike change places more often than scipy expects.
MOST_EXCHANGES = 100


def bounded_solution(gram: FloatArray, moment: FloatArray, nonnegative: BoolArray) -> FloatArray:
    """Linear least squares from its normal equations, some of the coefficients held at or above zero.

    Minimises ``c·gram·c − 2 c·moment`` with ``c[nonnegative] >= 0``; columns that say nothing get zero.

    Free coefficients are eliminated first (a Schur complement), so that the rest is plain non-negative least
    squares.
    """
    scale = np.sqrt(np.maximum(np.diag(gram), 0.0))
    silent = scale == 0.0
    scale[silent] = 1.0
    gram, moment = gram / np.outer(scale, scale), moment / scale
    free = ~nonnegative
    inverse = np.linalg.pinv(gram[np.ix_(free, free)], rcond=WEAKEST, hermitian=True)
    coupling = inverse @ gram[np.ix_(free, nonnegative)]
    solution = np.zeros(moment.size)
    if nonnegative.any():
        left = gram[np.ix_(nonnegative, nonnegative)] - gram[np.ix_(nonnegative, free)] @ coupling
        value, vector = np.linalg.eigh(left)
        # A trace of ridge: columns that are alike share what they explain. Rounding may leave less than nothing of one.
        root = np.sqrt(np.maximum(value, 0.0) + WEAKEST)
        right = vector.T @ (moment[nonnegative] - coupling.T @ moment[free]) / root
        solution[nonnegative] = nnls(root[:, None] * vector.T, right, maxiter=MOST_EXCHANGES * len(right))[0]
    solution[free] = inverse @ moment[free] - coupling @ solution[nonnegative]
    solution[silent] = 0.0
    return np.asarray(solution / scale)
