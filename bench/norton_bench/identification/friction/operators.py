"""The compiled operators of friction that remembers: exact along a path of straight steps, at any sample rate.

Arrays are (n,). A contact's state is the share h of its strength in use; ``deflection`` is the displacement over which
it would come into full use. ``begin`` holds the share at which a stretch begins, NaN where one goes on.
"""

from math import exp, isnan, log, pi, sin

import numpy as np
from numba import njit

from norton_bench.arrays import FloatArray

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
