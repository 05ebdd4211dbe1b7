"""A servo's source: the angle of its goal, how near to it friction lets it rest, and how a step settles."""

from math import inf

import numpy as np

from norton_bench.models.network import NortonNetwork

# A step of the goal by this many times what friction may leave, seen for so long.
STEP_GAPS, DWELL_S, TICK_S = 20.0, 0.4, 1e-3
# Of the step, still to come in the last quarter: as little as this where it settles.
SETTLED = 0.1


def gap_rad(network: NortonNetwork) -> float:
    """How far from its goal friction may hold the free shaft, to either side."""
    return network.coulomb_torque_nm / abs(network.torque_gain)


def still_to_come(network: NortonNetwork) -> float:
    """Of a step of the goal at zero torque, what comes in the last quarter of DWELL_S; infinite where it runs away."""
    ticks = round(DWELL_S / TICK_S)
    step_rad = STEP_GAPS * gap_rad(network)
    place = network.dissipative().free_motion(np.full(ticks, step_rad), TICK_S)[0]
    return float(np.ptp(place[-ticks // 4 :]) / step_rad) if np.isfinite(place).all() else inf


def zero_in_words(network: NortonNetwork) -> str:
    """Where its torque vanishes."""
    return (
        f"the torque pulls to the goal; at rest friction may hold the shaft within ± {1e3 * gap_rad(network):.3g} mrad "
        "of it"
    )


def settling_in_words(left: float) -> str:
    """Whether a step settles."""
    settles = "settles" if left <= SETTLED else "does not settle"
    return f"with no torque at the port, a step of the goal {settles} within {DWELL_S:g} s"
